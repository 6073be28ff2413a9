"""The Gaussians that pictures of a splat draw: those finer than pixels are one for several, so work follows pixels."""

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Indices
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import shared
from splat2mesh.splats.merging import covers, merged_at
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.extract import merged_count


class Sketch:
    """G groups of N Gaussians, each its own where they are no finer than pixels.

    group: (N,) int64 number of the group of each, or None where nothing is merged.
    """

    def __init__(self, splats: Splats, side: int | None, across: float = 0.0) -> None:
        """splats: those N, usable, without harmonics. side: of the pictures that will be drawn, in pixels, which show a
        length of `across`, in the unit of the splats; None where eyes may come close, which see each."""
        self._splats, self.group = splats, None
        if side is None or merged_count(len(splats), side * side) < 2:
            return
        keys = _cells(splats, across / side)
        self._order = np.argsort(keys, kind="stable")
        new = np.append(True, np.diff(keys[self._order]) != 0)
        self._starts = np.flatnonzero(new)
        self.group = np.empty(len(splats), np.int64)
        self.group[self._order] = np.cumsum(new) - 1
        cover = covers(splats)
        self._share = (cover / np.bincount(self.group, cover)[self.group]).astype(np.float32)[self._order]

    def __len__(self) -> int:
        return len(self._splats) if self.group is None else len(self._starts)

    @cached_property
    def splats(self) -> Splats:
        """The Gaussian of each group, without harmonics."""
        return self._splats if self.group is None else merged_at(self._splats.take(self._order), self._starts)

    def mean(self, values: Floats, rows: Indices | None = None) -> NDArray[Any]:
        """Values (N, ...) of Gaussians as those of groups, (G, ...): each counts by its opacity times its area. rows:
        (N,) where theirs stand among the values."""
        if self.group is None:
            return values if rows is None else values[rows]
        order = self._order if rows is None else rows[self._order]
        found = np.zeros((len(self), *values.shape[1:]), np.float32)
        starts, flat = np.append(self._starts, len(order)), values.reshape(len(values), -1)
        _add(len(self), order, starts, self._share, flat, found.reshape(len(self), -1))
        return found

    def members(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values (G, ...) of groups as those of each of their Gaussians, (N, ...)."""
        return values if self.group is None else values[self.group]


@shared
@kernel
def _add(begin: int, end: int, order: Indices, starts: Indices, share: Floats, values: Floats, found: Floats) -> None:
    """Add to each group's row of `found`, (G, C), the values (N, C) of its members, by their shares in that order."""
    for group in range(begin, end):
        for at in range(starts[group], starts[group + 1]):
            for channel in range(values.shape[1]):
                found[group, channel] += share[at] * values[order[at], channel]


def _cells(splats: Splats, size: float) -> NDArray[np.int64]:
    """Number of the cube, of a pixel's size, in which each lies; those wider than it have numbers of their own."""
    low = splats.means.min(axis=0)
    place = np.floor((splats.means - low) / np.float32(size)).astype(np.int64)
    x, y, _ = place.max(axis=0) + 1
    keys = place @ np.array([1, x, x * y])
    wide = np.flatnonzero(np.maximum.reduce([*splats.scales.T]) > size)
    keys[wide] = -1 - wide
    return keys
