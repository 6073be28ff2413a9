"""The foreground of a capture, and the far background of an open one: which splats belong to it."""

import numpy as np

from ..base.arrays import Mask, Vector
from ..base.quantiles import weighted_quantile
from .splats import SOLID, Splats

RADII = 4.0
"""Radii, each holding half of the detail, beyond which splats may be background."""

COARSER = 3.0
"""Size of the median splat out there over that of the foreground's, from which it is background: cameras among the
foreground see far things coarsely, while a long object is as fine at its end as in its middle. A guitar on its stand,
which reaches 4.6 radii, has 0.4; of four captures with a background the least has 4.7. Set before these were counted,
and fitted to nothing."""

LEAST_SHARE = 0.01
"""Of the solid splats, the part that a background has at least; fewer are floaters. Those four have .07 to .23."""

ENVIRONMENT_FROM = 5.0
"""Percentile of the distances of the environment that a capture keeps apart, above which the background begins."""


def far_background(splats: Splats) -> Mask:
    """Which splats are the far background of an open scene, (N,) bool: none, unless it clearly has one."""
    return foreground_ball(splats)[2]


def foreground_ball(splats: Splats) -> tuple[Vector, float, Mask]:
    """The ball beyond which the far background of an open scene lies: its centre (3,) and radius, inf unless there
    clearly is one, and which splats lie out there or belong to the capture's environment, (N,) bool."""
    apart = np.zeros(len(splats), bool) if splats.environment is None else splats.environment
    solid = (splats.opacities > SOLID) & ~apart
    if solid.sum() < 100:
        return np.zeros(3), np.inf, apart
    size = splats.scales.max(axis=1)
    detail = 1.0 / np.maximum(size[solid], np.percentile(size[solid], 5) + 1e-30).astype(np.float64) ** 2
    center = np.array([weighted_quantile(splats.means[solid, axis], detail) for axis in range(3)])
    distance = np.linalg.norm(splats.means - center, axis=1)
    radius = RADII * weighted_quantile(distance[solid], detail)
    far = distance > radius
    out, here = solid & far, solid & ~far
    few = out.sum() < LEAST_SHARE * solid.sum()
    if few or np.median(size[out]) < COARSER * np.median(size[here]):
        far, radius = np.zeros(len(splats), bool), np.inf
    if apart.any():
        radius = min(radius, float(np.percentile(distance[apart], ENVIRONMENT_FROM)))
    return center, radius, far | apart
