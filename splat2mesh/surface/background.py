"""The far background of an open capture: which splats belong to it, and views of it from within."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..base.arrays import Mask, Vector
from ..base.calibration import NOT_RECORDED, Provenance
from ..base.quantiles import weighted_quantile
from ..base.sphere import level_directions
from ..render.view import View
from ..splats.splats import SOLID, Splats
from ..views.eyes import Eye, around
from ..views.viewpoints import bounds_of, near_plane


@dataclass(frozen=True)
class BackgroundCalibration:
    """Criteria for the far background of an open capture.

    radii: each holding half of the detail, beyond which splats may be background; a guitar on its stand reaches 4.6.
    coarser: how much larger than the foreground's the median splat out there must be: cameras among the foreground see
    far things coarsely, while a long object is as fine at its end as in its middle. least_share: of the solid splats
    that a background has at least; fewer are floaters.
    """

    provenance: ClassVar = Provenance(script=NOT_RECORDED, fitted_on=NOT_RECORDED, held_out=NOT_RECORDED)

    radii: float = 4.0
    coarser: float = 3.0
    least_share: float = 0.002


BACKGROUND = BackgroundCalibration()


ENVIRONMENT_FROM = 5.0
"""Percentile of the distances of the environment that a capture keeps apart, above which the background begins."""

EYES = 4
"""Places to look around from."""


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
    radius = BACKGROUND.radii * weighted_quantile(distance[solid], detail)
    far = distance > radius
    out, here = solid & far, solid & ~far
    few = out.sum() < BACKGROUND.least_share * solid.sum()
    if few or np.median(size[out]) < BACKGROUND.coarser * np.median(size[here]):
        far, radius = np.zeros(len(splats), bool), np.inf
    if apart.any():
        radius = min(radius, float(np.percentile(distance[apart], ENVIRONMENT_FROM)))
    return center, radius, far | apart


def views_from_within(foreground: Splats, pixels: int, up: Vector) -> list[View]:
    """Views all around from places in the middle of a foreground (Splats): a list of View of `pixels` squared. up: (3,)
    unit, the up direction in the splat's frame."""
    bounds = bounds_of(foreground)
    centers = bounds.mean(axis=0) + np.ptp(bounds, axis=0) / 4.0 * level_directions(up, EYES)
    return around([Eye(center, near_plane(bounds)) for center in centers], pixels, up)[0]
