"""Marching tetrahedra: the zero level of values on a grid as a closed mesh, whatever the values."""

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Integers, Mask

NEAREST = 1e-3
"""Least distance of a vertex from the ends of its edge, in edges: at an end, several would be one."""


def _tetrahedra() -> Integers:
    """(6, 4, 3): corners of the six tetrahedra of a cube, all along its diagonal from 0 0 0 to 1 1 1, so that cubes
    side by side cut their common square by the same diagonal."""
    steps = np.eye(3, dtype=int)
    return np.array([np.cumsum([np.zeros(3, int), *steps[list(order)]], axis=0) for order in permutations(range(3))])


TETRAHEDRA = _tetrahedra()


def mesh_of_signs(
    field: NDArray[np.floating],  # (X, Y, Z), below 0 inside
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) in steps of the grid and faces (F, 3), wound counter-clockwise seen from outside.

    Where the border of the grid is outside, every edge has exactly two faces. Doi and Koide, An efficient method of
    triangulating equi-valued surfaces by using tetrahedral cells, 1991.
    """
    inside = field < 0.0
    shape = np.array(field.shape)
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    cubes = _mixed(inside) @ strides
    edges, sides = [], []
    for corners in TETRAHEDRA @ strides:
        tetrahedra = cubes[:, None] + corners
        within = inside.ravel()[tetrahedra]
        count = within.sum(axis=1)
        for wanted in (1, 2, 3):
            chosen, which = tetrahedra[count == wanted], within[count == wanted]
            order = np.argsort(~which, axis=1, kind="stable")  # the corners inside first
            corner = np.take_along_axis(chosen, order, axis=1)
            for triangle in _TRIANGLES[wanted]:
                edges.append(np.stack([corner[:, list(edge)] for edge in triangle], axis=1))
                sides.append(np.stack([corner[:, :wanted].T[0], corner[:, -1]], axis=1))
    edge, side = np.concatenate(edges), np.concatenate(sides)
    outward = _outward(edge, side, shape)
    edge[~outward] = edge[~outward][:, ::-1]
    low, high = edge.min(axis=-1).astype(np.int64), edge.max(axis=-1).astype(np.int64)
    keys, faces = np.unique(low * field.size + high, return_inverse=True)
    low, high = keys // field.size, keys % field.size
    values = field.ravel().astype(np.float64)
    share = np.clip(values[low] / (values[low] - values[high]), NEAREST, 1.0 - NEAREST)[:, None]
    places = np.stack(np.unravel_index(low, field.shape), axis=1) * (1.0 - share)
    places += np.stack(np.unravel_index(high, field.shape), axis=1) * share
    return places, faces.reshape(-1, 3)


_TRIANGLES = {
    1: [((0, 1), (0, 2), (0, 3))],
    2: [((0, 2), (0, 3), (1, 3)), ((0, 2), (1, 3), (1, 2))],
    3: [((0, 3), (1, 3), (2, 3))],
}
"""Corners inside -> triangles, as edges between one of those, which come first, and one outside."""


def _mixed(inside: Mask) -> Integers:
    """(M, 3) lowest corners of the cubes that have corners on both sides."""
    count = np.zeros(np.array(inside.shape) - 1, np.int8)
    for x, y, z in np.ndindex(2, 2, 2):
        nx, ny, nz = inside.shape
        count += inside[x : nx - 1 + x, y : ny - 1 + y, z : nz - 1 + z]
    return np.argwhere((count > 0) & (count < 8))


def _outward(edge: Integers, side: Integers, shape: Integers) -> Mask:
    """Whether triangles face away from a corner inside: by the middles of their edges, which suffices and is exact."""
    corners = np.stack(np.unravel_index(edge, tuple(shape)), axis=-1)
    middles = corners.sum(axis=2)  # twice the middle: whole numbers
    normal = np.cross(middles[:, 1] - middles[:, 0], middles[:, 2] - middles[:, 0])
    within = 2 * np.stack(np.unravel_index(side[:, 0], tuple(shape)), axis=-1)
    return np.einsum("nk,nk->n", normal, middles[:, 0] - within) > 0
