"""The light outside a closed room, which comes in through its windows: known, or made of what was seen of it."""

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Radiance, Transfer
from splat2mesh.scene.color import luminance
from splat2mesh.scene.measured import SKY_HEIGHT, SKY_WIDTH, CapturedSky

from ..light import projections
from ..light.environment import Environment
from ..light.sun_split import split
from ..transfer.bounces import visible_fraction
from ..transfer.occluder import Occluder
from ..transfer.sunlight import sunlight
from . import received


class WindowLight(NamedTuple):
    """A known light outside, of which only brightness and tint are to be found.

    environment: it brings through the windows as much as a uniform sky of radiance 1. direct: (V, 3) float32, its
    direct light on the white scene.
    """

    environment: Environment
    direct: NDArray[np.float32]

    @classmethod
    def of(cls, light: Environment, occluder: Occluder, transfer: Transfer, weights: Floats) -> "WindowLight":
        """Return a light outside. transfer: (V, K). weights: (V,) what each vertex counts."""
        direct = direct_light(occluder, transfer, light)
        bright = float(weights @ luminance(direct))
        level = np.float32(float(weights @ visible_fraction(transfer)) / bright if bright > 0.0 else 0.0)
        return cls(Environment(light.radiance * level, light.name, light.rotation_deg), direct * level)


def direct_light(occluder: Occluder, transfer: Transfer, environment: Environment) -> NDArray[np.float32]:
    """Direct light on the white scene, (V, 3) float32, not negative."""
    bands = math.isqrt(transfer.shape[1])
    rest, suns = split(environment, bands)
    direct = transfer @ rest.sh(bands).astype(np.float32)
    if len(suns):
        direct += sunlight(occluder, slice(None), suns)
    return np.maximum(direct, np.float32(0.0), out=direct)


def capture_light(
    sky: CapturedSky | None, patches: Directions, excess: Radiance, known: WindowLight | None = None
) -> Environment:
    """The Environment that came through the windows: what was seen of it, and the excess (W, 3) of its patches; of a
    known light itself, the excess of its only patch times as bright."""
    if not len(patches):
        return Environment(np.zeros((SKY_HEIGHT, SKY_WIDTH, 3), np.float32), "no window")
    if known is not None:
        light = known.environment
        return Environment(light.radiance * excess[0].astype(np.float32), light.name, light.rotation_deg)
    directions = projections.texel_directions(SKY_HEIGHT, SKY_WIDTH).reshape(-1, 3)
    seen, unseen = received.sky_parts(sky, directions, image=True)
    radiance = seen + unseen * excess[scipy.spatial.cKDTree(patches).query(directions)[1]]
    return Environment(radiance.reshape(SKY_HEIGHT, SKY_WIDTH, 3).astype(np.float32), "windows")
