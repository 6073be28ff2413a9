"""Loops over the rows of the bounce matrix: made of what rays hit, packed, and multiplied with radiance."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from splat2mesh.base.arrays import Integers
from splat2mesh.base.threads import in_slices


def packed(
    columns: NDArray[np.int32], weights: NDArray[np.float32], used: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]:
    """The used beginnings of the rows as row starts (N + 1,), columns and weights, end to end."""
    starts = np.append(0, np.cumsum(used, dtype=np.int64))
    parts = np.zeros(starts[-1], np.int32), np.zeros(starts[-1], np.float32)
    in_slices(_pack, len(used), columns, weights, starts, *parts)
    return starts, *parts


@njit(cache=True, nogil=True, error_model="numpy")
def merge(
    begin: int,
    end: int,
    rays: NDArray[np.float32],
    faces: Integers,
    uv: NDArray[np.float32],
    normals: NDArray[np.float32],
    corners: Integers,
    vertex_normals: NDArray[np.float32],
    grid: np.float32,
    columns: NDArray[np.int32],
    weights: NDArray[np.float32],
    used: NDArray[np.int32],
    hits: NDArray[np.int32],
    behind: NDArray[np.int32],
) -> None:
    """Rows of the matrix, unscaled: the weight of every vertex over all hits of a ray set, by first occurrence.

    The order of the rays, and so that of the sums, is the vertex's own: renaming vertices changes no bit.
    Weights are rounded to whole parts of 1 / grid, so coarse that no sum over a row rounds, in whatever order.
    """
    size = 8
    while size < 6 * rays.shape[1]:
        size *= 2
    slots = np.zeros(size, np.int32)  # open addressing, at most half full: entry number + 1, or 0
    for v in range(begin, end):
        slots[:] = 0
        count = 0
        for i in range(rays.shape[1]):
            if faces[v, i] < 0:
                continue
            hits[v] += 1
            a, b, c = corners[faces[v, i]]
            outward, facing = np.float32(0), np.float32(0)
            for axis in range(3):
                common = vertex_normals[a, axis] + vertex_normals[b, axis] + vertex_normals[c, axis]
                outward += normals[v, i, axis] * common
                facing += normals[v, i, axis] * rays[v, i, 3 + axis]
            if (facing if outward >= 0 else -facing) >= 0:
                behind[v] += 1
                continue
            # Within rounding: a hit on an edge may come with a weight just below 0.
            second = np.rint(min(max(uv[v, i, 0], np.float32(0)), np.float32(1)) * grid) / grid
            third = np.rint(min(max(uv[v, i, 1], np.float32(0)), np.float32(1) - second) * grid) / grid
            for vertex, weight in ((a, np.float32(1) - second - third), (b, second), (c, third)):
                slot = (np.int64(vertex) * np.int64(0x9E3779B1) >> 8) & (size - 1)
                while slots[slot] and columns[v, slots[slot] - 1] != vertex:
                    slot = (slot + 1) & (size - 1)
                if slots[slot] == 0:
                    columns[v, count], weights[v, count] = vertex, np.float32(0)
                    count += 1
                    slots[slot] = count
                weights[v, slots[slot] - 1] += weight
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
def _pack(
    begin: int,
    end: int,
    columns: NDArray[np.int32],
    weights: NDArray[np.float32],
    starts: NDArray[np.int64],
    packed_columns: NDArray[np.int32],
    packed_weights: NDArray[np.float32],
) -> None:
    for v in range(begin, end):
        for i in range(starts[v + 1] - starts[v]):
            packed_columns[starts[v] + i] = columns[v, i]
            packed_weights[starts[v] + i] = weights[v, i]


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
