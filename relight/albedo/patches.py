"""Patches of surfaces in the capture, and how well a light explains their colours within each material.

Noise in the irradiance of a place does not change which light its colours correlate with.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Integers, Mask, Transfer
from splat2mesh.base.calibration import NOT_RECORDED, Provenance
from splat2mesh.scene.color import luminance

from ..transfer.bounces import visible_fraction
from ..transfer.occluder import Occluder
from .seen import SeenPoints


@dataclass(frozen=True)
class PatchCalibration:
    """Thresholds for patches of a surface, and for patches of one material.

    cell: side of a patch over the median distance from which patches are seen.
    most_volume, least_visible, smooth: of surfaces in view, the largest share of leaves or grass, the least visible
    part of the sky, and the least length of a normal between those of a face's corners.
    alike, material: log chroma that a patch, and a material, spans.
    level, beneath: height of a normal from which a surface counts as level, and below which it hangs. A material counts
    once for each: floors and walls of one hue are not of one paint.
    least_patches: fewer show nothing.
    outlier: of log colour within a material; larger deviations count less than half.
    """

    provenance: ClassVar = Provenance(
        script=NOT_RECORDED,
        fitted_on="three generated nooks and four generated gardens, one trained garden (docs/albedo.md)",
        held_out=NOT_RECORDED,
    )

    cell: float = 0.04
    most_volume: float = 0.35
    least_visible: float = 0.15
    smooth: float = 0.9
    alike: float = 0.15
    material: float = 0.12
    level: float = 0.7
    beneath: float = -0.3
    least_patches: int = 200
    outlier: float = 0.5


PATCHES = PatchCalibration()


@dataclass(frozen=True, eq=False)
class ColorPatches:
    """N patches of surfaces. log_captured: (N,) of luminance. transfer: (N, K). bounced: (N,) luminance. material:
    (N,) numbers. weight: (N,)."""

    log_captured: NDArray[np.float64]
    transfer: NDArray[np.float64]
    bounced: NDArray[np.float64]
    material: Integers
    weight: NDArray[np.float64]

    def thinned(self, count: int) -> "ColorPatches":
        """At most so many of them, evenly."""
        if len(self.weight) <= count:
            return self
        rows = np.arange(count) * len(self.weight) // count
        _, material = np.unique(self.material[rows], return_inverse=True)
        others = self.log_captured[rows], self.transfer[rows], self.bounced[rows]
        return ColorPatches(*others, material.reshape(-1), self.weight[rows])

    @cached_property
    def within(self) -> "_Within":
        """The _Within of them."""
        return _Within(self)


def patches_of(
    looks: SeenPoints,
    occluder: Occluder,
    captured: NDArray[np.float32],  # (V, 3) linear
    usable: Mask,  # (V,) bool, neither black nor clipped
    transfer: Transfer,  # (V, K)
    bounce: NDArray[np.float32],  # (V, 3)
    volume: Floats | None = None,  # (V,) in [0, 1]
) -> ColorPatches | None:
    """The ColorPatches of the surfaces in view, or None if they are too few."""
    normal = looks.at(occluder.normals)
    good = usable[looks.corners].all(axis=1) & (np.linalg.norm(normal, axis=1) > PATCHES.smooth)
    good &= looks.at(visible_fraction(transfer)[:, None])[:, 0] > PATCHES.least_visible
    if volume is not None:
        good &= looks.at(volume[:, None])[:, 0] < PATCHES.most_volume
    if np.count_nonzero(good) < PATCHES.least_patches:
        return None
    some = looks.of(good)
    logs, normal, points = np.log(some.at(captured)), normal[good], some.at(occluder.origins)
    chroma = (logs - logs.mean(axis=1, keepdims=True))[:, :2]
    cell = PATCHES.cell * float(np.median(some.distance))
    index = numbered([points / cell, 1.2 * normal + 0.5, chroma / PATCHES.alike])
    count = np.bincount(index)
    shape = len(count), len(captured)
    means = scipy.sparse.csr_array(
        ((some.shares / count[index][:, None]).ravel(), (np.repeat(index, 3), some.corners.ravel())), shape
    )
    height = means @ occluder.normals[:, 1]
    side = np.where(height > PATCHES.level, 0.0, np.where(height < PATCHES.beneath, 2.0, 1.0))
    hue = np.stack([np.bincount(index, column) / count for column in chroma.T], axis=1)
    return ColorPatches(
        np.log(np.maximum(luminance(means @ captured), 1e-9)),
        (means @ transfer).astype(np.float64),
        np.asarray(luminance(means @ bounce), np.float64),
        numbered([hue / PATCHES.material, side[:, None]]),
        np.sqrt(count),
    )


def explained(patches: ColorPatches, log_received: NDArray[np.float64]) -> float:
    """Part of the variance of log colour within materials that a log irradiance explains, 0 where they are opposed."""
    across, colors, light = _moments(patches, log_received)
    return float(np.clip(across, 0.0, None) ** 2 / (colors * light)) if colors * light > 0.0 else 0.0


def slope(patches: ColorPatches, received: NDArray[np.float64]) -> float:
    """Slope of log colour against the logarithm of an irradiance (N,) within materials; at least a small number."""
    across, _, light = _moments(patches, np.log(np.maximum(received, 1e-9)))
    return max(float(across / light), 1e-3) if light > 0.0 else 1.0


def _moments(patches: ColorPatches, log_received: NDArray[np.float64]) -> tuple[float, float, float]:
    """Within materials: the weighted sums of log colour times log irradiance, and of the squares of both."""
    within = patches.within
    light = within.off(log_received)
    return float(within.weight @ (within.colors * light)), within.own, float(within.weight @ light**2)


class _Within:
    """Log colours less the mean of their material, in weights (N,) that count outliers less: what patches show under
    any light. own: their weighted square."""

    def __init__(self, patches: ColorPatches) -> None:
        self.weight, self._groups = patches.weight, patches.material
        self._total = np.bincount(self._groups, self.weight)
        off = self.off(patches.log_captured)
        self.weight = self.weight / (1.0 + (off / PATCHES.outlier) ** 2)
        self._total = np.bincount(self._groups, self.weight)
        self.colors = self.off(patches.log_captured)
        self.own = float(self.weight @ self.colors**2)

    def off(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values (N,) less the weighted mean of their group."""
        return values - (np.bincount(self._groups, self.weight * values) / self._total)[self._groups]


def numbered(columns: Sequence[Floats]) -> NDArray[np.int64]:
    """Numbers (N,) from 0 for rows that fall into the same cell of side 1: a list of (N, C)."""
    cells = np.floor(np.concatenate(columns, axis=1)).astype(np.int64)
    cells -= cells.min(axis=0)
    key = np.zeros(len(cells), np.int64)
    for column in cells.T:
        key = np.unique(key * (int(column.max()) + 1) + column, return_inverse=True)[1].reshape(-1)
    return key
