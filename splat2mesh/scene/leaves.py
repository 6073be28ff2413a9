"""Which vertices and faces of a mesh are leaves or grass throughout, by the volume measured around them.

`relight` takes the same share for how far a vertex is lit as a volume.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Faces, Floats, Indices, Mask, Points
from .optical_depth import OpticalDepth

FEW, MANY = 0.2, 0.5
"""Mean volume about a vertex: up to the first a speck on a surface, from the second on leaves or grass throughout."""

PROBE = 2.0
"""Cells of the optical depth between the places that such means are taken at."""

CANCELLED, BOX = 0.4, 4.0
"""How far normals in a box of so many cells of the optical depth cancel, of 1, from which a mesh is crumpled as leaves
make it. Volume alone is not enough: splats of a brick wall, a teapot and the rim of a door lie without order too where
training was short, but their mesh is smooth."""

ALL_WAYS = 0.06
"""How far normals there face all ways, of 1/3, from which a face of a plant is a leaf: those of a trunk do not."""

_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))

LEAFY = 0.4
"""Mean share of a clump of crumpled faces from which it is a plant: chairs are crumpled as well, and no volume."""

SMALLEST = 12.0
"""Side, in cells of the optical depth, of the square whose area the faces of a plant have at least. What is smaller,
once plants are out of the mesh, and hangs on one or lies amid it, belongs to it."""


def throughout(
    vertices: Points,  # (V, 3) scene frame
    volume: Floats,  # (V,) in [0, 1], as measured for each
    depth: OpticalDepth,
) -> Floats:
    """How far each vertex stands in leaves or grass, (V,) in [0, 1], by the mean volume around it."""
    lattice = Lattice(vertices.astype(np.float64), PROBE * float(depth.cells[0]))
    mean = lattice.interpolate(lattice.means(volume))[:, 0]
    share = np.clip((mean - FEW) / (MANY - FEW), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def leaf_faces(vertices: Points, faces: Faces, volume: Floats, depth: OpticalDepth | None) -> Mask:
    """(F,) bool: the faces of a mesh that are leaves or grass, in whole plants.

    Crumpled faces in boxes side by side are a clump. A clump is a plant where it stands in a volume throughout. volume:
    (V,) in [0, 1]. depth: None without any. How right it is: docs/surface.md, Leaves."""
    found = np.zeros(len(faces), bool)
    if depth is None or not len(faces) or not (volume > FEW).any():
        return found
    cell = float(depth.cells[0])
    side, least = BOX * cell, (SMALLEST * cell) ** 2
    share = throughout(vertices, volume, depth)[faces].mean(axis=1)
    a, b, c = vertices[faces.T].astype(np.float64)
    across, middles = np.cross(b - a, c - a) / 2.0, (a + b + c) / 3.0
    areas = np.linalg.norm(across, axis=1)
    cancelled, all_ways = _disorder(middles, across, areas, side)
    rows = np.flatnonzero(cancelled > CANCELLED)
    if not len(rows):
        return found
    boxes, box = np.unique(np.floor(middles / side).astype(np.int64), axis=0, return_inverse=True)
    box = box.reshape(-1)
    clump = _clumps(boxes, np.unique(box[rows]))[box[rows]]
    sizes = np.bincount(clump, areas[rows])
    mean = np.bincount(clump, areas[rows] * share[rows]) / np.maximum(sizes, 1e-30)
    found[rows[((mean >= LEAFY) & (sizes >= least))[clump]]] = True
    found &= all_ways > ALL_WAYS
    rest = np.flatnonzero(~found)
    _, node = np.unique(vertices, axis=0, return_inverse=True)
    corners = node.reshape(-1)[faces]
    piece = _pieces(corners[rest])
    wholes, amid = np.bincount(piece, areas[rest]), np.isin(box[rest], box[found])
    inside = np.bincount(piece, areas[rest] * amid) > 0.5 * wholes
    inside |= np.bincount(piece, np.isin(corners[rest], corners[found]).any(axis=1)) > 0.0
    found[rest[(inside & (wholes < least))[piece]]] = True
    return found


def _disorder(middles: Floats, across: Floats, areas: Floats, side: float) -> tuple[Floats, Floats]:
    """Of faces within boxes of a side: how far their normals cancel, (F,) in [0, 1], 1 in a closed body; and how far
    they face all ways, (F,) in [0, 1/3], 0 in sheets and along a trunk: the least eigenvalue of the mean of n n^T.
    middles: (F, 3). across: (F, 3) normals as long as their areas, (F,)."""
    lattice = Lattice(middles.astype(np.float64), side)
    weight = 1.0 / np.maximum(areas, 1e-30)
    upper = [across[:, i] * across[:, j] * weight for i, j in _UPPER]
    total = np.hstack([lattice.means(part) for part in (areas, *across.T, *upper)]).astype(np.float32)
    mean = lattice.interpolate(total).astype(np.float64)
    mean /= np.maximum(mean[:, :1], 1e-30)
    tensor = np.zeros((len(mean), 3, 3))
    for k, (i, j) in enumerate(_UPPER):
        tensor[:, i, j] = tensor[:, j, i] = mean[:, 4 + k]
    return 1.0 - np.linalg.norm(mean[:, 1:4], axis=1), np.linalg.eigvalsh(tensor)[:, 0]


def _clumps(boxes: Indices, held: Indices) -> Indices:
    """The clump of each box, (B,): those side by side among the boxes that are held. boxes: (B, 3) whole numbers."""
    pairs = scipy.spatial.cKDTree(boxes[held]).query_pairs(
        1.8, output_type="ndarray"
    )  # beyond the diagonal of a box, short of two
    clumps = np.zeros(len(boxes), np.int64)
    clumps[held] = connected(pairs, len(held))
    return clumps


def _pieces(corners: Indices) -> Indices:
    """The connected piece of the mesh that each face is in, (F,). corners: (F, 3)."""
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]]])
    return connected(edges, int(corners.max(initial=0)) + 1)[corners[:, 0]]


def connected(edges: Indices, count: int) -> Indices:
    """The number of the connected part that each of `count` nodes is in. edges: (E, 2)."""
    ones = np.ones(len(edges), np.int8)
    _, part = scipy.sparse.csgraph.connected_components(
        scipy.sparse.coo_matrix((ones, edges.T), (count, count)), directed=False
    )
    return np.asarray(part, np.int64)


class Lattice:
    """Points (R, 3) gathered in cells of a side: a probe for each cell, between which points interpolate. points: (P,
    3) float64, the mean of each cell's."""

    def __init__(self, points: NDArray[np.float64], side: float) -> None:
        low = points.min(axis=0) - side
        at = (points - low) / side
        size = np.ceil(at.max(axis=0)).astype(np.int64) + 2
        keys = np.ravel_multi_index(at.astype(np.int64).T, size)
        self._keys, cell, count = np.unique(keys, return_inverse=True, return_counts=True)
        self._cell, self._held = cell, count
        self.points = np.stack([self.means(column)[:, 0] for column in points.T], axis=1)
        self._columns, self._weights = self._surrounded(at, size, cell)

    def _surrounded(self, at: Points, size: Indices, cell: Indices) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """The probes about each point, (R, 8), at its place in cells, and what they weigh; its own cell's, 0, where
        there is none."""
        low = np.floor(at - 0.5)
        part = at - 0.5 - low
        columns, weights = np.empty((len(at), 8), np.int32), np.empty((len(at), 8))
        for corner, step in enumerate(np.ndindex(2, 2, 2)):
            keys = ((low + step).astype(np.int64) * [size[1] * size[2], size[2], 1]).sum(axis=1)
            found = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
            there = self._keys[found] == keys
            columns[:, corner] = np.where(there, found, cell)
            weights[:, corner] = np.where(there, np.where(step, part, 1.0 - part).prod(axis=1), 0.0)
        return columns, (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)

    def means(self, values: Floats) -> NDArray[np.float64]:
        """Means of values (R,) of the points by their probes: (P, 1)."""
        return (np.bincount(self._cell, values) / self._held)[:, None]

    def around(self, rows: Indices) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Probes (S, 8) about some of the points, (S,), and their weights."""
        return self._columns[rows], self._weights[rows]

    def interpolate(self, values: Floats, rows: slice | Indices = slice(None)) -> NDArray[np.float32]:
        """(P, C) float32 of probes -> (R, C) float32 of the points, or of some rows of them."""
        columns, weights = self._columns[rows], self._weights[rows]
        starts = np.arange(0, columns.size + 1, columns.shape[1])
        matrix = scipy.sparse.csr_array((weights.ravel(), columns.ravel(), starts), (len(columns), len(values)))
        return np.asarray(matrix @ values)
