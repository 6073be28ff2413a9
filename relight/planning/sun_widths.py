"""The error of a patch of light that shines as a point, measured on a sample by rays all over the patch.

The split of suns estimates it for walls that may stand anywhere; in the shade of needles it is up to eight
times larger.
"""

import math

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Indices, Points

from ..light.suns import Suns
from .sample import TURNS, Sample

RAYS = 4
"""To each patch, in two halves whose product has no noise."""

QUARTERS = TURNS // 2
"""Rotations of the light, a quarter turn apart."""

FEW = 16
"""Suns that every vertex of the sample looks at in each rotation; the more there are, the fewer of them look."""


def width_error(
    sample: Sample, tint: Floats | float, suns: Suns, variances: Floats, total: NDArray[np.float64]
) -> float:
    """Relative L2 error of exit radiance, in the worst of four rotations of the light, of suns that shine as points.

    sample: Sample. tint: (S, 3) albedo of its rows, or 1. suns: Suns of the unrotated light. variances: of their
    patches, as `sun_split.Rest` has them; patches are treated as discs. total: (TURNS,) norms of all light.
    """
    if not len(suns):
        return 0.0
    step = min(QUARTERS, 1 + len(suns) // FEW, len(sample.rows))
    tint = np.broadcast_to(np.asarray(tint, np.float64), (len(sample.rows), 3))
    worst = 0.0
    for quarter in range(QUARTERS):
        rows = np.arange(quarter % step, len(sample.rows), step)
        turned = suns.rotated(360.0 * quarter / QUARTERS)
        halves = _off(sample, rows, turned, variances) * tint[rows]
        share = sample.weights[rows] * np.square(sample.solid[rows])
        among = total[quarter * TURNS // QUARTERS] ** 2 * sample.weights[rows].sum()
        worst = max(worst, float(share @ (halves[0] * halves[1]).sum(axis=1) / among))
    return math.sqrt(worst)


def _off(sample: Sample, rows: Indices, suns: Suns, variances: Floats) -> NDArray[np.float64]:
    """By how much two halves of the rays say that exit radiance of white rows is off: (2, R, 3)."""
    cosine = sample.normals[rows] @ suns.directions.T
    row, sun = np.nonzero(cosine > 0.0)
    off = np.zeros((2, len(rows), 3))
    toward = suns.directions[sun]
    sent = (cosine[row, sun] / np.pi)[:, None] * suns.weights[sun]
    origins = sample.occluder.origins[sample.rows[rows[row]]]
    point = _free(sample, origins, toward)
    side = np.cross(toward, np.where(np.abs(toward[:, 1:2]) < 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]]))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(toward, side)
    start = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, len(row))
    for ray in range(RAYS):
        radius = np.sqrt(2.0 * variances[sun] * (ray + 0.5) / RAYS)[:, None]
        angle = (start + ray * np.pi * (3.0 - math.sqrt(5.0)))[:, None]
        aim = toward + radius * (np.cos(angle) * side + np.sin(angle) * other)
        differs = _free(sample, origins, aim / np.linalg.norm(aim, axis=1, keepdims=True)) - point
        for color in range(3):
            off[ray % 2, :, color] += np.bincount(row, differs * sent[:, color], len(rows)) * (2.0 / RAYS)
    return off


def _free(sample: Sample, origins: Points, toward: Directions) -> NDArray[np.float64]:
    """(N,) 1.0 where a ray meets nothing."""
    rays = np.concatenate([origins, toward.astype(np.float32)], axis=1)
    return 1.0 - sample.occluder.occluded(rays).astype(np.float64)
