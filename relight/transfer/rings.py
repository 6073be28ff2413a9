"""Averaging over neighbours of a moving mesh: neighbours stay, and only changed vertices are averaged again.

Neighbours are those of the first pose, whatever the motion does to the angles between them: a pair that now differs by
more than `neighbors.MIN_COSINE` stays in the rows, with weight 0, which adds nothing to any sum.
So the result is that of `filtering.average` over the whole mesh, to the bit.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Integers, Mask
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices

from .filtering import average
from .neighbors import MIN_COSINE, SHARPNESS, Neighbors, Rows, _sort_rows

WHOLE = 0.5
"""Where more than this part of the nodes would be averaged again, all are: to pick them out costs more than it
saves."""

_FAR = np.int8(127)


class Rings(Neighbors):
    """Neighbors whose rows hold every pair, and whose weights follow the normals (`bend`)."""

    def __init__(
        self, origins: NDArray[np.float32], normals: NDArray[np.float32], faces: Integers, ranks: Integers | None = None
    ) -> None:
        """Like Neighbors, with the nodes in the order of their ranks, (V,) integers, or along a curve through the
        pose."""
        super().__init__(origins, normals, faces)
        if ranks is not None:
            self._sort(np.argsort(ranks[self.vertices], kind="stable"))
        self.bend(np.ascontiguousarray(normals[self.vertices]))

    def _sort(self, order: Indices) -> None:
        place, lengths = np.argsort(order), np.diff(self.starts)
        self.vertices, self.node = self.vertices[order], place[self.node]
        starts = np.append(0, np.cumsum(lengths[order]))
        columns = np.arange(starts[-1]) + np.repeat(self.starts[order] - starts[:-1], lengths[order])
        self.starts, self.columns = starts, place[self.columns[columns]].astype(np.int32)
        in_slices(_sort_rows, len(order), self.starts, self.columns, np.zeros(len(order), np.int64))

    def _expand(self, normals: NDArray[np.float32], *places: NDArray[Any]) -> None:
        super()._expand(np.tile(np.array([0.0, 1.0, 0.0], np.float32), (len(normals), 1)), *places)

    def bend(self, normals: NDArray[np.float32]) -> None:
        """Set the weights for new unit normals of the nodes, (N, 3) float32."""
        in_slices(_weights, len(normals), self.starts, self.columns, normals, self.weights)

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
        grown = level.copy()
        in_slices(_grow, len(level), self.starts, self.columns, level, np.int8(ring), grown)
        return grown

    def _cut(self, nodes: Indices) -> Rows:
        """The rows of some nodes, sorted, without what is not among them."""
        if len(nodes) == len(self.vertices):
            return Rows(np.arange(len(nodes)), self.starts, self.columns, self.weights)
        new = np.full(len(self.vertices), -1, np.int32)
        new[nodes] = np.arange(len(nodes), dtype=np.int32)
        used = np.zeros(len(nodes) + 1, np.int64)
        nothing = np.zeros(0, np.int32), np.zeros(0, np.float32)
        in_slices(_copy_rows, len(nodes), nodes, new, self.starts, self.columns, self.weights, used[1:], *nothing)
        starts = np.cumsum(used)
        columns, weights = np.zeros(starts[-1], np.int32), np.zeros(starts[-1], np.float32)
        rows = nodes, new, self.starts, self.columns, self.weights
        in_slices(_copy_rows, len(nodes), *rows, starts[:-1], columns, weights)
        return Rows(np.arange(len(nodes)), starts, columns, weights)


@kernel
def _weights(
    begin: int,
    end: int,
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    normals: NDArray[np.float32],
    weights: NDArray[np.float32],
) -> None:
    """Weighted as in `neighbors._node_rows`."""
    for i in range(begin, end):
        for at in range(starts[i], starts[i + 1]):
            j = columns[at]
            cosine = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
            weights[at] = np.float32(0)
            if cosine > MIN_COSINE:
                weights[at] = np.exp(SHARPNESS * min(cosine - np.float32(1), np.float32(0)))


@kernel
def _grow(
    begin: int,
    end: int,
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    level: NDArray[np.int8],
    ring: np.int8,
    grown: NDArray[np.int8],
) -> None:
    """Nodes beside one of level `ring` get the next, unless they have a lower one."""
    for i in range(begin, end):
        if level[i] > ring + 1:
            for at in range(starts[i], starts[i + 1]):
                if level[columns[at]] == ring:
                    grown[i] = ring + 1
                    break


@kernel
def _copy_rows(
    begin: int,
    end: int,
    nodes: NDArray[np.int64],
    new: NDArray[np.int32],
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    weights: NDArray[np.float32],
    ends: NDArray[np.int64],
    out_columns: NDArray[np.int32],
    out_weights: NDArray[np.float32],
) -> None:
    """Count what stays of every row into `ends` or, given arrays to fill, write it from `ends` on."""
    fill = len(out_columns) > 0
    for i in range(begin, end):
        at = ends[i] if fill else 0
        for old in range(starts[nodes[i]], starts[nodes[i] + 1]):
            column = new[columns[old]]
            if column >= 0:
                if fill:
                    out_columns[at], out_weights[at] = column, weights[old]
                at += 1
        if not fill:
            ends[i] = at
