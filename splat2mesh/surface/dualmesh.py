"""The zero surface of a field on the corners of octree leaves, as a mesh: dual contouring."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Faces, Floats, Indices, Integers
from ..base.kernels import kernel
from .octree import BITS, EMPTY, OCTREE_LEVELS, Corners, pack, slot


class LeafIndex(NamedTuple):
    """Where leaves are found by their keys: a hash table (T,) of keys, EMPTY where there is none, and their rows (T,);
    finest, coarsest: levels of the smallest and the largest leaf."""

    keys: NDArray[np.int64]
    rows: NDArray[np.int32]
    finest: int
    coarsest: int


def dual_mesh(
    leaves: Indices, corners: Corners, values: Floats, weights: Floats, enough: float
) -> tuple[NDArray[np.float64], Faces, NDArray[np.int8]]:
    """The zero surface: a vertex in each leaf it passes, a face across each edge of the finest cells whose ends differ.

    leaves: sorted keys. values, weights: (P,) at the corners; those of less weight than `enough` take no part.
    Returns vertices (V, 3) float64 in units of the finest cell, faces (F, 3) int32, and the level of each vertex (V,).
    Source: Ju et al., "Dual Contouring of Hermite Data" (2002), with the mean of the crossings as vertex.
    """
    size = 1 << int(np.ceil(np.log2(max(16, 2.2 * len(leaves)))))
    present = np.flatnonzero(np.bincount(leaves >> (3 * BITS), minlength=OCTREE_LEVELS))
    keys, rows = np.full(size, EMPTY, np.int64), np.zeros(size, np.int32)
    index = LeafIndex(keys, rows, int(present.min()), int(present.max()))
    _index_leaves(keys, rows, leaves)
    sums, counts = np.zeros((len(leaves), 3)), np.zeros(len(leaves), np.int32)
    arrays = leaves, corners, values, weights, np.float32(enough), index
    quads = np.zeros((len(leaves), 4), np.int32)  # more than there are crossings, but where surfaces lie like leaves
    total = _cross(*arrays, quads, sums, counts)
    if total > len(quads):
        quads = np.zeros((total, 4), np.int32)
        sums[:], counts[:] = 0, 0
        _cross(*arrays, quads, sums, counts)
    quads = quads[:total]
    used = counts > 0
    number = np.cumsum(used) - 1
    vertices = sums[used] / counts[used, None]
    quads = number[quads]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return vertices, faces[proper].astype(np.int32), (leaves[used] >> (3 * BITS)).astype(np.int8)


@kernel
def _index_leaves(keys: Indices, rows: Integers, leaves: Indices) -> None:
    for i in range(len(leaves)):
        at = slot(keys, leaves[i])
        keys[at], rows[at] = leaves[i], i


@kernel
def _leaf_at(index: LeafIndex, level: int, x: int, y: int, z: int) -> int:
    """The leaf that holds a point, given in half units of the finest cell, tried from `level` outwards; -1: none."""
    finest, coarsest = index.finest, index.coarsest
    for far in range(coarsest - finest + 1):
        for sign in range(2):
            tried = level + far if sign == 0 else level - far
            if tried < finest or tried > coarsest or (sign == 1 and far == 0):
                continue
            shift = tried + 1
            key = pack(tried, x >> shift, y >> shift, z >> shift)
            at = slot(index.keys, key)
            if index.keys[at] == key:
                return index.rows[at]
    return -1


@kernel
def _cross(
    leaves: Indices,
    corners: Corners,
    values: Floats,
    weights: Floats,
    enough: float,
    index: LeafIndex,
    quads: Integers,
    sums: Floats,
    counts: Integers,
) -> int:
    """Find every edge across which the field changes its sign; returns their number. Writes where there is room."""
    of_leaf, positions = corners.of_leaf, corners.positions
    total, found, at = 0, np.zeros(4, np.int64), np.zeros(3, np.int64)
    for i in range(len(leaves)):
        signs = 0
        for c in range(8):
            signs += values[of_leaf[i, c]] < 0
        if signs == 0 or signs == 8:
            continue
        level = leaves[i] >> (3 * BITS)
        for axis in range(3):
            step, u, v = 4 >> axis, (axis + 1) % 3, (axis + 2) % 3
            for c in range(8):
                if c & step:
                    continue
                a, b = of_leaf[i, c], of_leaf[i, c + step]
                if (values[a] < 0) == (values[b] < 0) or weights[a] <= enough or weights[b] <= enough:
                    continue
                for k in range(3):
                    at[k] = 2 * np.int64(positions[a, k])
                at[axis] += np.int64(1) << level
                owner, whole = i, True
                for q in range(4):
                    at[u] += 1 if q == 1 or q == 2 else -1
                    at[v] += 1 if q >= 2 else -1
                    other = _leaf_at(index, level, at[0], at[1], at[2])
                    at[u] -= 1 if q == 1 or q == 2 else -1
                    at[v] -= 1 if q >= 2 else -1
                    found[q] = other
                    if other < 0:
                        whole = False
                        break
                    theirs = leaves[other] >> (3 * BITS)
                    if theirs < level:
                        whole = False
                        break
                    if theirs == level and other < owner:
                        owner = other
                if not whole or owner != i:
                    continue
                if total < len(quads):
                    share = values[a] / (values[a] - values[b])
                    for q in range(4):
                        leaf = found[q]
                        counts[leaf] += 1
                        for k in range(3):
                            sums[leaf, k] += positions[a, k] + share * (positions[b, k] - positions[a, k])
                        quads[total, q if values[a] < 0 else 3 - q] = leaf
                total += 1
    return total
