"""Averaging over neighbours of a moving mesh: neighbours stay, and only changed vertices are averaged again.

Neighbours are those of the first pose, whatever the motion does to the angles between them: a pair that now differs by
more than `neighbors.MIN_COSINE` stays in the rows, with weight 0, which adds nothing to any sum.
So the result is that of `filtering.average` over the whole mesh, to the bit.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Integers, Mask

from .filtering import average
from .neighbors import Neighbors, Rows

WHOLE = 0.5
"""Where more than this part of the nodes would be averaged again, all are: to pick them out costs more than it
saves."""

_FAR = np.int8(np.iinfo(np.int8).max)


class Rings(Neighbors):
    """Neighbors whose rows hold every pair, and whose weights follow the normals (`bend`)."""

    def __init__(
        self, origins: NDArray[np.float32], normals: NDArray[np.float32], faces: Integers, ranks: Integers | None = None
    ) -> None:
        """Like Neighbors, with the nodes in the order of their ranks, (V,) integers, or along a curve through the
        pose."""
        super().__init__(origins, normals, faces, every=True)
        if ranks is not None:
            order = np.argsort(ranks[self.vertices], kind="stable")
            self.vertices, self.node = self.vertices[order], np.argsort(order)[self.node]
            self.starts, self.columns, self.weights = self._cut(order)[1:]

    def averaged(
        self,
        normals: NDArray[np.float32],  # (N, 3) float32, unit
        seen: tuple[NDArray[np.float32], NDArray[np.float32]],  # model (N, 4) and rest (N, K) of `sampling.gather`
        rays: int,
        steps: int,
        changed: Mask,  # (N,) bool, nodes whose model, rest or normal is new
    ) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]:
        """Nodes whose average is new, sorted (M,), and their model (M, 4) and rest (M, K): see `filtering.average`."""
        model, rest = seen
        if steps == 0 or not changed.any():
            nodes = np.flatnonzero(changed)
            return nodes, model[nodes], rest[nodes]
        # A step looks at the ring of a node, at how much shadow there is around each of those, and so at two rings.
        reach = steps + 1
        level = np.where(changed, np.int8(0), _FAR)
        for ring in range(0 if changed.all() else 2 * reach):
            level = self._grown(level, ring)
        nodes = np.flatnonzero(level <= reach)
        needed = np.flatnonzero(level < _FAR)
        if len(needed) > WHOLE * len(level):
            needed = np.arange(len(level))
        part = self._cut(needed)
        part_model, part_rest = model[needed], rest[needed]
        average(part, normals[needed], part_model, part_rest, rays, steps)
        own = np.searchsorted(needed, nodes)
        return nodes, part_model[own], part_rest[own]

    def _grown(self, level: NDArray[np.int8], ring: int) -> NDArray[np.int8]:
        """Nodes beside one of level `ring` get the next, unless they have a lower one."""
        rows = scipy.sparse.csr_array((np.ones(len(self.columns), bool), self.columns, self.starts), 2 * level.shape)
        return np.where((level > ring + 1) & (rows @ (level == ring)), np.int8(ring + 1), level)

    def _cut(self, nodes: Indices) -> Rows:
        """The rows of some nodes, in their order, without what is not among them."""
        rows = self.matrix[nodes][:, nodes]
        rows.sort_indices()
        return Rows(np.arange(len(nodes)), rows.indptr.astype(np.int64), rows.indices.astype(np.int32), rows.data)
