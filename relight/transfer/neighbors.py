"""Neighbours: the vertices of a scene as ordered nodes, and the ring around each.

Vertices that agree in position and normal are one node (seams of chunks); vertices that share a position are neighbours
of each other, and of everything one edge away from any of them (seams of textures). The nodes are ranked along a curve
through space by their own bits, so nothing here depends on the order of vertices or faces.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Integers, Mask, Points
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices

SHARPNESS = np.float32(8.0)
"""The weight of a neighbour falls by exp(-8 (1 - n.n')): light does not bleed over edges. 4 to 12 do as well."""

MIN_COSINE = np.float32(0.5)
"""Normals further apart than 60 degrees are no neighbours at all: the faces of a box stay apart exactly."""

_CELLS = np.float32(2**20)  # of the space-filling curve along the unit frame: 60 bits in all
_SHORT_ROW = 32  # an insertion sort is quicker up to here


class Neighbors:
    """The nodes of a scene, and their neighbours as sparse rows.

    vertices: (N,) int64, the vertex that stands for each node, in the order of the curve.
    node: (V,) int64, the node of each vertex.
    starts, columns, weights: row i is columns[starts[i] : starts[i + 1]], sorted nodes other than i, int32, with
        weights in (0, 1], float32; int64 starts, (N + 1,).
    """

    def __init__(
        self,
        origins: NDArray[np.float32],  # (V, 3) float32, unit frame of the occluder
        normals: NDArray[np.float32],  # (V, 3) float32, unit
        faces: Integers,  # (F, 3) integers; faces of no area and faces given twice do no harm
        ranked: tuple[NDArray[np.int64], Mask, Mask] | None = None,  # of `ranked_nodes`, in this pose or another
    ) -> None:
        order, new_node, new_place = ranked_nodes(origins, normals) if ranked is None else ranked
        node_ranked = np.cumsum(new_node) - 1
        self.vertices = order[new_node]
        self.node = np.zeros(len(order), np.int64)
        self.node[order] = node_ranked
        first = np.append(np.flatnonzero(new_place[new_node]), len(self.vertices))  # node of each place, and an end
        place = (np.cumsum(new_place[new_node]) - 1).astype(np.int32)  # of each node
        corners = place[self.node][faces].astype(np.int32)
        starts, columns = _rings(len(first) - 1, np.ascontiguousarray(corners))
        counts = np.zeros(len(first) - 1, np.int64)
        in_slices(_sort_rows, len(counts), starts, columns, counts)
        self._expand(np.ascontiguousarray(normals[self.vertices]), place, first, starts, columns, counts)

    def _expand(self, normals: NDArray[np.float32], *places: NDArray[Any]) -> None:
        """From places beside places, as `_node_rows` takes them, to nodes beside nodes."""
        used, nothing = np.zeros(len(normals) + 1, np.int64), np.zeros(0, np.int32)
        in_slices(_node_rows, len(normals), normals, *places, used[1:], nothing, np.zeros(0, np.float32))
        self.starts = np.cumsum(used)
        self.columns = np.zeros(self.starts[-1], np.int32)
        self.weights = np.zeros(self.starts[-1], np.float32)
        in_slices(_node_rows, len(normals), normals, *places, self.starts[:-1], self.columns, self.weights)


class Rows(NamedTuple):
    """Some rows of Neighbors, as `filtering.average` needs them. Weights are in [0, 1]."""

    vertices: NDArray[np.int64]
    starts: NDArray[np.int64]
    columns: NDArray[np.int32]
    weights: NDArray[np.float32]


def ranked_nodes(origins: Floats, normals: Floats) -> tuple[NDArray[np.int64], Mask, Mask]:
    """Vertices by their place on the Z-order curve, then by their bits: order (V,) and, in that order, where the
    content and where the position differs from the one before, (V,) bool each."""
    keys = _keys(origins)
    order = np.argsort(keys)
    ranked = keys[order]
    same = ranked[1:] == ranked[:-1]
    tied = np.flatnonzero(np.append(same, False) | np.append(False, same))
    members = order[tied]
    content = [column + np.float32(0.0) for column in (*normals[members].T, *origins[members].T)]  # -0 is 0
    order[tied] = members[np.lexsort((*content, ranked[tied]))]
    new_node, new_place = np.ones(len(order), bool), np.ones(len(order), bool)
    later = tied[1:][tied[1:] == tied[:-1] + 1]
    now, before = order[later], order[later - 1]
    new_place[later] = (origins[now] != origins[before]).any(axis=1)
    new_node[later] = new_place[later] | (normals[now] != normals[before]).any(axis=1)
    return order, new_node, new_place


def along_curve(origins: Points) -> NDArray[np.int64]:
    """Order (V,) of positions (V, 3) along the curve: rays in it meet what those before them left in the caches, and
    take up to 40% less time than in the order of a mesh. Where places are the same it is any."""
    return np.argsort(_keys(origins))


def _keys(origins: Points) -> NDArray[np.uint64]:
    keys = np.zeros(len(origins), np.uint64)
    in_slices(_curve_keys, len(keys), np.ascontiguousarray(origins), keys)
    return keys


@kernel
def _curve_keys(begin: int, end: int, origins: Floats, keys: NDArray[np.uint64]) -> None:
    for v in range(begin, end):
        key = np.uint64(0)
        for axis in range(3):
            # What has faces is well inside -1 .. 1; a lost vertex may be anywhere, and counts as at the edge.
            place = min(max(origins[v, axis] + np.float32(1.0), np.float32(0.0)), np.float32(1.99999))
            bits = np.uint64(place * _CELLS) & np.uint64(0x1FFFFF)
            bits = (bits | (bits << np.uint64(32))) & np.uint64(0x1F00000000FFFF)
            bits = (bits | (bits << np.uint64(16))) & np.uint64(0x1F0000FF0000FF)
            bits = (bits | (bits << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
            bits = (bits | (bits << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
            key |= ((bits | (bits << np.uint64(2))) & np.uint64(0x1249249249249249)) << np.uint64(axis)
        keys[v] = key


@kernel
def _rings(count: int, corners: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The other two corners of every face at every place: sparse rows, unsorted, with repetitions."""
    starts = np.zeros(count + 2, np.int64)
    for f in range(len(corners)):
        for c in range(3):
            starts[corners[f, c] + 2] += 2
    for p in range(count):
        starts[p + 2] += starts[p + 1]
    columns = np.zeros(6 * len(corners), np.int32)
    for f in range(len(corners)):
        for c in range(3):
            at = starts[corners[f, c] + 1]
            columns[at], columns[at + 1] = corners[f, c - 1], corners[f, c - 2]
            starts[corners[f, c] + 1] = at + 2
    return starts[:-1], columns


@kernel
def _sort_rows(
    begin: int, end: int, starts: NDArray[np.int64], columns: NDArray[np.int32], counts: NDArray[np.int64]
) -> None:
    """Sort each row in place and drop repetitions and the place itself; what remains is counted."""
    for p in range(begin, end):
        row = columns[starts[p] : starts[p + 1]]
        gap = 1  # by insertion; long rows by gaps first (Shell, 1959), which compiles in a tenth of the time of `sort`
        while gap < len(row) // _SHORT_ROW:
            gap = 3 * gap + 1
        while gap > 0:
            for i in range(gap, len(row)):
                value, at = row[i], i
                while at >= gap and row[at - gap] > value:
                    row[at] = row[at - gap]
                    at -= gap
                row[at] = value
            gap //= 3
        kept = 0
        for i in range(len(row)):
            if row[i] != p and (kept == 0 or row[i] != row[kept - 1]):
                row[kept] = row[i]
                kept += 1
        counts[p] = kept


@kernel
def _node_rows(
    begin: int,
    end: int,
    normals: NDArray[np.float32],
    place: NDArray[np.int32],
    first: NDArray[np.int64],
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    counts: NDArray[np.int64],
    ends: NDArray[np.int64],
    out_columns: NDArray[np.int32],
    out_weights: NDArray[np.float32],
) -> None:
    """Count the neighbours of every node into `ends` or, given arrays to fill, write them from `ends` on."""
    fill = len(out_columns) > 0
    for i in range(begin, end):
        at = ends[i] if fill else 0
        here = place[i]
        # The nodes at this place belong between the neighbours below and above it: rows stay sorted.
        own_done = False
        for n in range(counts[here] + 1):
            other = columns[starts[here] + n] if n < counts[here] else np.int32(2**31 - 1)
            for turn in range(2):
                p = other
                if turn == 0:
                    if own_done or other < here:
                        continue
                    p, own_done = here, True
                elif n == counts[here]:
                    continue
                for j in range(first[p], first[p + 1]):
                    cosine = (
                        normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
                    )
                    if j != i and cosine > MIN_COSINE:
                        if fill:
                            out_columns[at] = j
                            out_weights[at] = np.exp(SHARPNESS * min(cosine - np.float32(1), np.float32(0)))
                        at += 1
        if not fill:
            ends[i] = at
