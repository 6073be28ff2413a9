"""Loops over the rows of the bounce matrix: made of what rays hit, packed, and multiplied with radiance."""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from splat2mesh.base.arrays import Integers
from splat2mesh.base.threads import in_slices

FINENESS = 64
"""Parts of a face's edge to which the place of a hit is rounded: next to the noise of a few dozen rays that is nothing,
and a hit in a mesh of up to a million faces takes four bytes."""

SIDE = FINENESS + 1


def starts_of(used: NDArray[np.int32]) -> NDArray[np.int64]:
    """Where rows begin that are laid end to end, (N + 1,), of how many numbers each has."""
    return np.append(0, np.cumsum(used, dtype=np.int64))


def packed(rows: NDArray[Any], starts: NDArray[np.int64]) -> NDArray[Any]:
    """The used beginnings of rows (N, M), end to end."""
    found = np.empty(starts[-1], rows.dtype)
    in_slices(_pack, len(starts) - 1, rows, starts, found)
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def merge(
    begin: int,
    end: int,
    starts: NDArray[np.int64],
    found: Integers,
    corners: Integers,
    columns: NDArray[np.int32],
    weights: NDArray[np.float32],
    used: NDArray[np.int32],
) -> None:
    """Rows of the matrix, unscaled: the weight of every vertex over all places of a row, by first occurrence.

    found: (P,), row after row: (face * SIDE + second) * SIDE + third, the weights of the second and the third vertex of
    a face in whole parts of 1 / FINENESS.

    The order of the rays, and so that of the sums, is the vertex's own: renaming vertices changes no bit.
    Weights are whole parts of 1 / FINENESS, so coarse that no sum over a row rounds, in whatever order.
    """
    size = 8
    while size < 2 * columns.shape[1]:
        size *= 2
    slots = np.zeros(size, np.int32)  # open addressing, at most half full: entry number + 1, or 0
    for v in range(begin, end):
        slots[:] = 0
        count = 0
        for i in range(starts[v], starts[v + 1]):
            place = np.int64(found[i])
            third, second = place % SIDE, place // SIDE % SIDE
            a, b, c = corners[place // (SIDE * SIDE)]
            for vertex, parts in ((a, FINENESS - second - third), (b, second), (c, third)):
                slot = (np.int64(vertex) * np.int64(0x9E3779B1) >> 8) & (size - 1)
                while slots[slot] and columns[v, slots[slot] - 1] != vertex:
                    slot = (slot + 1) & (size - 1)
                if slots[slot] == 0:
                    columns[v, count], weights[v, count] = vertex, np.float32(0)
                    count += 1
                    slots[slot] = count
                weights[v, slots[slot] - 1] += np.float32(parts) / np.float32(FINENESS)
        used[v] = count


@njit(cache=True, nogil=True)
def join(
    begin: int,
    end: int,
    used: NDArray[np.int32],
    node: NDArray[np.int32],
    copies: NDArray[np.int32],
    columns: NDArray[np.int32],
    weights: NDArray[np.float32],
) -> None:
    """Bring vertices of one node side by side in every row; all but the last of them are marked by ~vertex.

    A product of such a weight with a float32 is exact in float64, and so is the sum over a node whose vertices
    are equally bright. Whether they are one vertex or several then makes no difference.
    """
    for v in range(begin, end):
        for i in range(used[v]):
            if copies[columns[v, i]] == 1:
                continue
            for j in range(i + 1, used[v]):
                if node[columns[v, j]] == node[columns[v, i]]:
                    vertex, weight = columns[v, j], weights[v, j]
                    for k in range(j, i + 1, -1):
                        columns[v, k], weights[v, k] = columns[v, k - 1], weights[v, k - 1]
                    columns[v, i + 1], weights[v, i + 1] = vertex, weight
                    columns[v, i] = ~columns[v, i]
                    break


@njit(cache=True, nogil=True)
def _pack(begin: int, end: int, rows: NDArray[Any], starts: NDArray[np.int64], packed_rows: NDArray[Any]) -> None:
    for v in range(begin, end):
        for i in range(starts[v + 1] - starts[v]):
            packed_rows[starts[v] + i] = rows[v, i]


@njit(cache=True, nogil=True)
def gather_rgb(
    rows: NDArray[np.int32],
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    weights: NDArray[np.float32],
    scale: NDArray[np.float32],
    radiance: NDArray[np.float32],
    result: NDArray[np.float32],
) -> None:
    """Products of the rows with radiance (V, 3) into the result (V, 3), times the scale of each, (V,)."""
    for v in range(len(rows)):
        red, green, blue = 0.0, 0.0, 0.0
        node_red, node_green, node_blue = 0.0, 0.0, 0.0
        for i in range(starts[v], starts[v + 1]):
            vertex, weight = max(columns[i], ~columns[i]), np.float64(weights[i])
            node_red += weight * radiance[vertex, 0]
            node_green += weight * radiance[vertex, 1]
            node_blue += weight * radiance[vertex, 2]
            if columns[i] >= 0:
                red, green, blue = red + node_red, green + node_green, blue + node_blue
                node_red, node_green, node_blue = 0.0, 0.0, 0.0
        row = rows[v]
        result[row, 0], result[row, 1], result[row, 2] = scale[row] * red, scale[row] * green, scale[row] * blue


@njit(cache=True, nogil=True)
def gather(
    rows: NDArray[np.int32],
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    weights: NDArray[np.float32],
    scale: NDArray[np.float32],
    radiance: NDArray[np.float32],
    result: NDArray[np.float32],
) -> None:
    """The same of radiance (V, C)."""
    width = radiance.shape[1]
    total, node = np.zeros(width), np.zeros(width)
    for v in range(len(rows)):
        total[:] = 0.0
        joined = False  # to the one before
        for i in range(starts[v], starts[v + 1]):
            vertex, weight = max(columns[i], ~columns[i]), np.float64(weights[i])
            if columns[i] >= 0 and not joined:
                for c in range(width):
                    total[c] += weight * radiance[vertex, c]
                continue
            for c in range(width):
                node[c] = weight * radiance[vertex, c] + (node[c] if joined else 0.0)
            joined = columns[i] < 0
            if not joined:
                for c in range(width):
                    total[c] += node[c]
        for c in range(width):
            result[rows[v], c] = scale[rows[v]] * total[c]
