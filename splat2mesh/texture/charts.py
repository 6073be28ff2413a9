"""Cut a surface into charts, pieces that project onto a plane without overlap, and pack them into one square.

Charts grow face by face while the surface stays within an angle of their plane. The size of each in the square follows
its surface: texels follow the detail of the capture, which varies over a place. It takes 2 s for 700,000 faces; xatlas
takes half a minute for half as many.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Directions, Floats, Indices, Integers, Points
from ..base.kernels import kernel

STEEPEST = 0.55
"""Cosine between a face and the plane of its chart, at least: there a texel is stretched to twice its width."""

GUTTER = 1
"""Texels around each chart that repeat its border, for what bilinear filtering mixes in."""


class Charts(NamedTuple):
    """Charts of a surface, C of them, as large as requested and not placed yet.

    across: (W, 2) float64 in texels, from the corner of its chart. chart: (W,). vertex: (W,) that each is a copy of.
    faces: (F, 3) of these. extent: (C, 2) sides, none wider than high. order: (C,) the highest first.
    """

    across: NDArray[np.float64]
    chart: Indices
    vertex: NDArray[np.int64]
    faces: NDArray[np.int64]
    extent: NDArray[np.float64]
    order: Indices

    def packed(self, size: int, least: float = 0.0) -> tuple[NDArray[np.float64], float] | None:
        """Place the charts in a square of size x size texels: (W, 2) texels from its top left corner, and their scale,
        at most 1 and as large as fits; None where that is below `least`."""
        corner = np.zeros((len(self.extent), 2))
        if least > 0.0 and not _pack(self.extent * least, self.order, size, corner):
            return None
        low, high = least, 1.0
        if _pack(self.extent, self.order, size, corner):
            low = 1.0
        else:
            while (high - low) * size > 1.0:  # a texel
                middle = (low + high) / 2
                if _pack(self.extent * middle, self.order, size, corner):
                    low = middle
                else:
                    high = middle
            _pack(self.extent * low, self.order, size, corner)
        return self.across * low + corner[self.chart] + GUTTER + 0.5, low


def charts_of(points: Points, faces: Integers, density: Floats) -> Charts:
    """The Charts of a surface. points: (V, 3). faces: (F, 3). density: (F,) texels wanted along a unit of each."""
    corners = points[faces].astype(np.float64)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    neighbors = _neighbors(faces)
    areas = np.linalg.norm(crosses, axis=1)
    normals = crosses / np.maximum(areas, 1e-300)[:, None]
    label = np.full(len(faces), -1, np.int64)
    axes = np.zeros((len(faces), 3))
    count = _grow(normals, neighbors, density, label, axes)
    plane = _planes(label, count, crosses, normals, axes[:count])
    wanted = np.bincount(label, areas * density, count) / np.maximum(np.bincount(label, areas, count), 1e-300)
    bare = np.bincount(label, density, count) / np.bincount(label, minlength=count)
    wanted = np.where(wanted > 0, wanted, bare)
    key, inverse = np.unique(label[:, None] * len(points) + faces, return_inverse=True)
    vertex, chart = key % len(points), key // len(points)
    places = points[vertex].astype(np.float64)
    across = np.stack([(places * plane[chart, row]).sum(axis=1) for row in range(2)], axis=1) * wanted[chart, None]
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, chart, across)
    np.maximum.at(high, chart, across)
    across -= low[chart]
    extent = high - low
    upright = extent[:, 0] < extent[:, 1]
    across[upright[chart]] = across[upright[chart]][:, ::-1]
    extent[upright] = extent[upright][:, ::-1]
    order = np.lexsort((-extent[:, 0], -extent[:, 1]))
    return Charts(across, chart, vertex, inverse.reshape(-1, 3).astype(np.int64), extent, order)


def _neighbors(faces: Integers) -> NDArray[np.int64]:
    """(F, 3) the face across each edge, -1 for none. Of more than two faces at an edge, pairs are neighbours."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2).astype(np.int64), axis=1)
    key = edges[:, 0] * (int(faces.max(initial=0)) + 1) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    found = np.full(len(key), -1, np.int64)
    _pair(key[order], order, found)
    return found.reshape(-1, 3)


@kernel
def _pair(key: Integers, order: Indices, found: NDArray[np.int64]) -> None:
    i = 0
    while i + 1 < len(key):
        if key[i] == key[i + 1]:
            found[order[i]], found[order[i + 1]] = order[i + 1] // 3, order[i] // 3
            i += 2
        else:
            i += 1


@kernel
def _grow(normals: Directions, neighbors: Integers, density: Floats, label: NDArray[np.int64], axes: Floats) -> int:
    """Give each face the number of its chart, and each chart the normal of its plane; returns the number of charts."""
    count = 0
    queue = np.empty(len(label), np.int64)
    for seed in range(len(label)):
        if label[seed] >= 0:
            continue
        x, y, z = normals[seed, 0], normals[seed, 1], normals[seed, 2]
        axes[count, 0], axes[count, 1], axes[count, 2] = x, y, z
        queue[0], label[seed] = seed, count
        first, last, finest = 0, 1, density[seed]
        while first < last:
            f = queue[first]
            first += 1
            for side in range(3):
                g = neighbors[f, side]
                if g < 0 or label[g] >= 0:
                    continue
                if normals[g, 0] * x + normals[g, 1] * y + normals[g, 2] * z < STEEPEST:
                    continue
                if density[g] > 2.0 * finest or finest > 2.0 * density[g]:
                    continue
                label[g] = count
                queue[last] = g
                last += 1
        count += 1
    return count


def _planes(label: Indices, count: int, crosses: Floats, normals: Directions, axes: Directions) -> Floats:
    """(C, 2, 3) two directions that span the plane of each chart: across its mean normal where all faces allow that."""
    total = np.stack([np.bincount(label, crosses[:, k], count).astype(float) for k in range(3)], axis=1)
    mean = total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, label, (normals * mean[label]).sum(axis=1))
    axis = np.where((lowest < 0.5 * STEEPEST)[:, None], axes, mean)
    helper = np.eye(3)[np.abs(axis).argmin(axis=1)]
    first = np.cross(axis, helper)
    first /= np.maximum(np.linalg.norm(first, axis=1), 1e-300)[:, None]
    return np.stack([first, np.cross(axis, first)], axis=1)


@kernel
def _pack(extent: Floats, order: Indices, size: int, corner: Floats) -> bool:
    """Set rectangles, the highest first, in rows from left to right, from the top; returns whether all fit."""
    x, y, row = 0.0, 0.0, 0.0
    for c in order:
        width, height = np.ceil(extent[c, 0]) + 2 * GUTTER + 1, np.ceil(extent[c, 1]) + 2 * GUTTER + 1
        if width > size:
            return False
        if x + width > size:
            x, y, row = 0.0, y + row, 0.0
        if row == 0.0:
            row = height
        if y + row > size:
            return False
        corner[c, 0], corner[c, 1] = x, y
        x += width
    return True
