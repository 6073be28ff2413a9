"""The captured sky as evidence: the part that was seen, the part that was clipped, and the part that nobody saw."""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats
from splat2mesh.base.quantiles import weighted_quantile
from splat2mesh.base.sphere import row_solid_angles, texel_directions
from splat2mesh.scene.color import luminance
from splat2mesh.scene.measured import CapturedSky

from ..light.environment import Environment
from .evidence import SeenSky, upper_sky

GROUND = 0.2
"""Ratio of invisible light below the horizon to that above: the albedo of the ground around."""

LEAST_VISIBLE = 0.05
"""Least visible part of the upper hemisphere for a sky to be used: windows show less."""

LEAST_OPEN = 0.3
"""Mean part of the sky that the surfaces of a scene see, from which a captured sky is its light: a garden's see 0.59,
those of a room no more than its windows and the holes of its mesh let in."""

LEAST_SEEN = 0.1
"""Part of a direction that must have been seen unclipped for its radiance to count."""


MOSTLY = 0.5
"""Part of a texel that must bind for the exposure to be read off it."""


class SkyParts(NamedTuple):
    """A sky's parts at directions (K, 3). known: (K, 3) radiance that binds, with 1 for what was clipped. unseen,
    clipped: (K, 3) shares of the direction; below the horizon the unseen counts as GROUND."""

    known: NDArray[np.float64]
    unseen: NDArray[np.float64]
    clipped: NDArray[np.float64]

    @classmethod
    def at(cls, sky: CapturedSky, directions: Directions) -> "SkyParts":
        """The parts of a CapturedSky around directions (K, 3) that share the sphere evenly, means over each's cell."""
        height, width = sky.bound.shape[:2]
        texels = texel_directions(height, width).reshape(-1, 3)
        areas = np.repeat(row_solid_angles(height, width), width)
        owner = scipy.spatial.cKDTree(directions).query(texels)[1]
        total = np.bincount(owner, areas, len(directions))

        def mean(values: Floats) -> NDArray[np.float64]:
            columns = values.reshape(-1, 3).astype(np.float64).T
            sums = np.stack([np.bincount(owner, areas * column, len(directions)) for column in columns], axis=1)
            return sums / np.maximum(total, 1e-12)[:, None]

        bound, clipped = mean(sky.bound), mean(sky.clipped)
        known = mean(sky.bound * sky.radiance) + clipped
        return cls(known, _unseen(bound, clipped, directions), clipped)

    @classmethod
    def looked_up(cls, sky: CapturedSky, directions: Directions) -> "SkyParts":
        """The parts at any directions (D, 3): those of the texel that each falls into."""
        height, width = sky.bound.shape[:2]
        x, y, z = np.asarray(directions, np.float64).T
        row = (0.5 - np.arctan2(y, np.hypot(x, z)) / np.pi) * height
        column = (0.5 - np.arctan2(x, z) / (2.0 * np.pi)) * width
        at = np.clip(row.astype(np.int64), 0, height - 1), column.astype(np.int64) % width
        bound, clipped = sky.bound[at].astype(np.float64), sky.clipped[at].astype(np.float64)
        return cls(bound * sky.radiance[at] + clipped, _unseen(bound, clipped, directions), clipped)


def seen_sky(sky: CapturedSky, directions: Directions) -> SeenSky:
    """The SeenSky of a CapturedSky on directions (K, 3) that share the sphere evenly."""
    parts = SkyParts.at(sky, directions)
    below = np.where(directions[:, 1:2] < 0.0, GROUND, 1.0)
    seen = np.clip(1.0 - parts.unseen / below - parts.clipped, 0.0, 1.0)
    radiance = np.clip(parts.known - parts.clipped, 0.0, None) / np.maximum(seen, 1e-6)
    weight = upper_sky(directions) / 3.0
    counted = seen * (seen > LEAST_SEEN)
    return SeenSky(np.log(np.maximum(radiance, 1e-4)), weight * counted, weight * parts.clipped)


def visible_part(sky: CapturedSky) -> float:
    """Visible part of the upper hemisphere, weighted as it lights level ground: in [0, 1]."""
    height, width = sky.bound.shape[:2]
    weight = np.maximum(texel_directions(height, width)[..., 1], 0.0) * row_solid_angles(height, width)
    return float(((sky.bound + sky.clipped).mean(axis=2) * weight).sum() / weight.sum())


def exposure_of(sky: CapturedSky, environment: Environment) -> np.float32 | None:
    """Captured colour per radiance of a known Environment: the median over the pixels of a CapturedSky that bind,
    weighted by the square of their height, since trees stand low; None where no pixel binds."""
    height, width = sky.bound.shape[:2]
    directions = texel_directions(height, width)
    areas = np.repeat(row_solid_angles(height, width), width, axis=1)
    binds = (sky.bound.min(axis=2) > MOSTLY) & (directions[..., 1] > 0.0) & (sky.radiance.min(axis=2) > 0.0)
    shown = environment.lookup(directions[binds])
    lit = luminance(shown) > 0.0
    if not lit.any():
        return None
    ratio = luminance(sky.radiance[binds][lit]) / luminance(shown[lit])
    return np.float32(weighted_quantile(ratio, areas[binds][lit] * directions[binds][lit, 1] ** 2))


def _unseen(bound: Floats, clipped: Floats, directions: Directions) -> NDArray[np.float64]:
    """Shares (D, 3) of directions that were not seen, less the light that the ground around does not send back."""
    below = np.where(directions[:, 1:2] < 0.0, GROUND, 1.0)
    return below * np.clip(1.0 - bound - clipped, 0.0, 1.0)
