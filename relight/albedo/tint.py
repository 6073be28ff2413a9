"""The colour of captured light that no picture shows: clipped sky, sun, and the unseen part.

A clipped sky is white in the file, whatever its colour was. The surfaces under it show more: soil, stone, wood and
concrete reflect more red than blue, by much the same amount, while leaves, green paint, brick and tiles differ.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Mask
from splat2mesh.scene.color import luminance
from splat2mesh.scene.measured import CapturedSky

from ..light import projections
from ..light.environment import Environment
from . import skylight
from .captured import CapturedScene
from .patches import PATCHES

USUAL_HUE = np.array([1.19, 1.0, 0.79])
"""Albedo over its green of what lies around people outdoors and is neither green nor of unusual warmth. Of twelve
generated gardens 1.14 to 1.23, 0.74 to 0.81, geometric means over what is seen; of a patio 1.25, 0.86 in all."""

GREENEST = 1.35
"""Green over the root of red times blue, above which an albedo is that of leaves or green paint."""

WARMTH, SHIFTS = 0.5, 3
"""Log red over blue by which an albedo may differ from the usual one of its place and still count, and rounds in which
the mean of these, from the median of all, becomes the usual one. A house of brick made light 15% too red over blue."""

TRUST = 0.8
"""In that hue, where all of the light is free: it spreads by .1 between places, the light of captures by .2."""

LEAST_SHARE = 0.1
"""Least share of the visible surface that is not green."""

MOST_TINT = 1.6
"""Largest factor on a colour, and one over the least."""

STEPS = 40
"""Bisections of a factor, each of which halves its range."""


class _Received(NamedTuple):
    """Irradiance of sample points, (N, 3): fixed is from other surfaces and the known sky, free is the rest."""

    fixed: NDArray[np.float64]
    free: NDArray[np.float64]


def balanced(
    scene: CapturedScene, sky: CapturedSky, environment: Environment, volume: Floats | None = None
) -> Environment:
    """The light of a CapturedScene, with the colour of its free part that makes surfaces usual.

    environment: as estimated, in captured units and the frame of the scene, all of it not turned. volume: (V,) how far
    each vertex is of leaves. What of the CapturedSky binds stays, and so does the luminance of the rest.
    """
    places = scene.places
    parts = skylight.SkyParts.at(skylight.unmixed(sky), places.directions)
    bound = np.minimum(parts.known - parts.clipped, environment.lookup(places.directions))
    rest = environment.lookup(places.directions) - bound
    received = _Received(scene.bounced() + places.sky @ bound, places.sky.astype(np.float64) @ rest)
    captured = scene.captured[places.vertices].astype(np.float64)
    factor = _factor(captured, received, None if volume is None else volume[places.vertices])
    height, width = environment.radiance.shape[:2]
    texels = projections.texel_directions(height, width).reshape(-1, 3)
    parts = skylight.SkyParts.looked_up(skylight.unmixed(sky), texels)
    kept = np.minimum((parts.known - parts.clipped).reshape(height, width, 3), environment.radiance)
    radiance = kept + (environment.radiance - kept) * factor
    return Environment(radiance.astype(np.float32), environment.name, environment.rotation_deg)


def _factor(captured: NDArray[np.float64], received: _Received, volume: Floats | None) -> NDArray[np.float64]:
    """(3,) factor on the free light, from sample points in these colours (N, 3)."""
    whole = received.fixed + received.free
    lit = (whole.min(axis=1) > 0.0) & (captured.min(axis=1) > 0.0)
    albedo = captured / np.maximum(whole, 1e-9)
    lit &= albedo[:, 1] < GREENEST * np.sqrt(np.maximum(albedo[:, 0] * albedo[:, 2], 0.0))
    if volume is not None:
        lit &= volume < PATCHES.most_volume
    if lit.mean() < LEAST_SHARE:
        return np.ones(3)
    lit &= _of_usual_warmth(albedo, lit)
    fixed, free = received.fixed[lit], received.free[lit]
    own = _hue(np.log(whole[lit]).mean(axis=0))
    share = float(luminance(free.mean(axis=0)) / luminance(whole[lit].mean(axis=0)))
    usual = _hue(np.log(captured[lit]).mean(axis=0) - np.log(USUAL_HUE))
    wanted = own + TRUST * share * (usual - own)
    level = np.log(whole[lit]).mean(axis=0)
    aim = wanted + (level - own).mean()
    low, high = np.full(3, -np.log(MOST_TINT)), np.full(3, np.log(MOST_TINT))
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        over = np.log(fixed + free * np.exp(middle)).mean(axis=0) > aim
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    factor = np.exp(0.5 * (low + high))
    light = free.mean(axis=0)
    return np.asarray(factor * luminance(light) / luminance(factor * light))


def _of_usual_warmth(albedo: NDArray[np.float64], counted: Mask) -> Mask:
    """Which albedos (N, 3) are as warm as most of those counted, (N,) bool: brick and tiles say little about light."""
    warmth = np.log(np.maximum(albedo[:, 0], 1e-9) / np.maximum(albedo[:, 2], 1e-9))
    middle = np.median(warmth[counted])
    for _ in range(SHIFTS):
        middle = warmth[counted & (np.abs(warmth - middle) < WARMTH)].mean()
    return np.asarray(np.abs(warmth - middle) < WARMTH)


def _hue(log_color: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(log_color - log_color.mean())
