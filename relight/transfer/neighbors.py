"""Neighbours: the vertices of a scene as ordered nodes, and the ring around each.

Vertices that agree in position and normal are one node (seams of chunks); vertices that share a position are neighbours
of each other, and of everything one edge away from any of them (seams of textures). The nodes are ranked along a curve
through space by their own bits, so nothing here depends on the order of vertices or faces.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Integers, Mask, Points
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices

SHARPNESS = np.float32(8.0)
"""The weight of a neighbour falls by exp(-8 (1 - n.n')): light does not bleed over edges. 4 to 12 do as well."""

MIN_COSINE = np.float32(0.5)
"""Normals further apart than 60 degrees are no neighbours at all: the faces of a box stay apart exactly."""

_CELLS = np.float32(2**20)  # of the space-filling curve along the unit frame: 60 bits in all


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
        every: bool = False,  # whether pairs whose normals are too far apart stay, with weight 0
    ) -> None:
        order, new_node, new_place = ranked_nodes(origins, normals) if ranked is None else ranked
        node_ranked = np.cumsum(new_node) - 1
        self.vertices = order[new_node]
        self.node = np.zeros(len(order), np.int64)
        self.node[order] = node_ranked
        first = np.append(np.flatnonzero(new_place[new_node]), len(self.vertices))  # node of each place, and an end
        place = (np.cumsum(new_place[new_node]) - 1).astype(np.int32)  # of each node
        rows = _nodes_beside(place[self.node][faces], first)
        self.starts, self.columns = rows.indptr.astype(np.int64), rows.indices.astype(np.int32)
        self.weights = np.zeros(len(self.columns), np.float32)
        self.bend(np.ascontiguousarray(normals[self.vertices]))
        if not every:
            kept = self.weights > 0.0
            self.starts = np.append(0, np.cumsum(kept))[self.starts]
            self.columns, self.weights = self.columns[kept], self.weights[kept]

    def bend(self, normals: NDArray[np.float32]) -> None:
        """Set the weights for unit normals of the nodes, (N, 3) float32."""
        in_slices(_weights, len(normals), self.starts, self.columns, normals, self.weights)

    @property
    def matrix(self) -> "scipy.sparse.csr_array":
        """The rows as a sparse matrix of weights, (N, N)."""
        count = len(self.starts) - 1
        return scipy.sparse.csr_array((self.weights, self.columns, self.starts), (count, count))


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


def _nodes_beside(corners: Integers, first: Integers) -> "scipy.sparse.csr_array":
    """Which nodes are neighbours, (N, N), no node its own. corners: (F, 3), places of faces. first: (P + 1,), the node
    that each place begins with, and an end."""
    count = len(first) - 1
    ends = corners[:, [0, 1, 2, 1, 2, 0]].ravel(), corners[:, [1, 2, 0, 0, 1, 2]].ravel()
    rows = scipy.sparse.coo_array((np.ones(len(ends[0]), bool), ends), (count, count)).tocsr()
    if first[-1] > count:
        nodes = np.arange(first[-1])
        held = scipy.sparse.csr_array((np.ones(len(nodes), bool), nodes, first), (count, len(nodes)))
        rows = held.T @ (rows + scipy.sparse.eye_array(count, dtype=bool)) @ held
    rows = rows.tocsr()
    rows.setdiag(False)
    rows.eliminate_zeros()
    rows.sort_indices()
    return rows


@kernel
def _weights(
    begin: int,
    end: int,
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    normals: NDArray[np.float32],
    weights: NDArray[np.float32],
) -> None:
    for i in range(begin, end):
        for at in range(starts[i], starts[i + 1]):
            j = columns[at]
            cosine = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
            weights[at] = np.float32(0)
            if cosine > MIN_COSINE:
                weights[at] = np.exp(SHARPNESS * min(cosine - np.float32(1), np.float32(0)))
