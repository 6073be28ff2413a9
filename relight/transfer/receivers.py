"""The vertices that light is traced for, and how the others take theirs from neighbours.

The mesh of a place has several vertices for each splat, and unseen undersides. Where only splats are shown, light is
computed at the vertices that they use, and at some of the others, which bounces meet. The vertices in between
take the mean of the neighbours whose normals agree.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask
from splat2mesh.base.errors import InputError
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices

from .neighbors import Neighbors
from .occluder import Occluder
from .store import array_key

SPARSE = 6
"""One in this many invisible vertices is traced, evenly along a curve through space."""

RINGS = 4
"""Steps from a vertex that is traced within which others take over its light; what lies further is traced itself."""


Ring: TypeAlias = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]
"""Sparse rows of vertices that take over: nodes, starts, columns, weights."""


EVERY = "every"
"""The key of those that are all vertices."""


class Receivers:
    """The vertices of a scene that light is traced for.

    traced: (V,) bool. rows: (S,) int64, their indices. key: short text that identifies them, EVERY for all.
    """

    def __init__(self, traced: Mask, rings: Iterable[Ring] = ()) -> None:
        """rings: of the vertices that take over, ring after ring."""
        self.traced, self.rows, self._rings = traced, np.flatnonzero(traced), list(rings)
        self.key = EVERY if traced.all() else array_key(traced)

    @classmethod
    def every(cls, count: int) -> "Receivers":
        """All of so many vertices."""
        return cls(np.ones(count, bool))

    @classmethod
    def of_shown(
        cls,
        shown: Mask,  # (V,) bool: whose light is shown
        occluder: Occluder,
    ) -> "Receivers":
        """The vertices that are shown, and a few of the others; those that agree in place and normal together."""
        neighbors = Neighbors(occluder.origins, occluder.normals, occluder.faces, occluder.ranked)
        node, count = neighbors.node, len(neighbors.vertices)
        traced = np.bincount(node, shown, count) > 0
        others = np.flatnonzero(~traced)
        traced[others[::SPARSE]] = True
        reached, rings = traced.copy(), []
        for _ in range(RINGS):
            taken = np.zeros(count, np.int64)
            in_slices(_count, count, neighbors.starts, neighbors.columns, reached, taken)
            nodes = np.flatnonzero(taken)
            if not len(nodes):
                break
            starts = np.append(0, np.cumsum(taken[nodes]))
            columns, weights = np.zeros(starts[-1], np.int32), np.zeros(starts[-1], np.float32)
            rows = neighbors.starts, neighbors.columns, neighbors.weights
            in_slices(_take, len(nodes), nodes, *rows, reached, starts, columns, weights)
            rings.append((nodes, starts, columns, weights))
            reached[nodes] = True
        traced |= ~reached
        # What was nodes is vertices from here on: one stands for each node, and its copies take their light from it.
        stands = neighbors.vertices
        rings = [
            (stands[nodes], starts, stands[columns].astype(np.int32), weights)
            for nodes, starts, columns, weights in rings
        ]
        copies = np.flatnonzero(stands[node] != np.arange(len(node)))
        copies = copies[~traced[node[copies]]]
        if len(copies):
            same = stands[node[copies]].astype(np.int32)
            rings.append((copies, np.arange(len(copies) + 1), same, np.ones(len(copies), np.float32)))
        return cls(traced[node], rings)

    @classmethod
    def restored(cls, arrays: Mapping[str, NDArray[Any]], shown: Mask) -> "Receivers":
        """Restore from cached arrays, for vertices `shown`, (V,). Raises InputError or KeyError for arrays that do not
        fit."""
        traced, count = arrays["traced"], len(shown)
        if traced.shape != (count,) or traced.dtype != bool or (shown & ~traced).any():
            raise InputError("kept receivers are of another scene")
        numbers = [number for number in range(RINGS + 1) if f"nodes{number}" in arrays]
        return cls(traced, [_kept_ring(arrays, number, count) for number in numbers])

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Dict of the arrays that `restored` takes."""
        kept: dict[str, NDArray[Any]] = {"traced": self.traced}
        for number, ring in enumerate(self._rings):
            parts: Sequence[NDArray[Any]] = ring
            kept |= {f"{name}{number}": part for name, part in zip(_PARTS, parts, strict=True)}
        return kept

    @property
    def all(self) -> bool:
        """Whether light is traced for every vertex."""
        return self.key == EVERY

    def filled(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values (V, C) float32 of which the traced rows are given, with all others filled in place."""
        for nodes, starts, columns, weights in self._rings:
            in_slices(_fill, len(nodes), nodes, starts, columns, weights, values)
        return values


_PARTS = "nodes", "starts", "columns", "weights"


def _kept_ring(arrays: Mapping[str, NDArray[Any]], number: int, count: int) -> Ring:
    """One of the rings of so many vertices. Raises InputError or KeyError for arrays that do not fit."""
    nodes, starts, columns, weights = (arrays[f"{name}{number}"] for name in _PARTS)
    whole = all(each.dtype.kind == "i" and each.ndim == 1 for each in (nodes, starts, columns))
    if not whole or weights.dtype != np.float32 or len(starts) != len(nodes) + 1:
        raise InputError("kept receivers are of another kind")
    if starts[0] != 0 or (np.diff(starts) < 1).any() or not starts[-1] == len(columns) == len(weights):
        raise InputError("kept receivers do not fit together")
    for each in (nodes, columns):
        if each.min(initial=0) < 0 or each.max(initial=-1) >= count:
            raise InputError("kept receivers are of another scene")
    if not (np.isfinite(weights).all() and (weights > 0.0).all()):
        raise InputError("kept receivers are not finite")
    return nodes, starts, columns, weights


@kernel
def _count(
    begin: int, end: int, starts: NDArray[np.int64], columns: NDArray[np.int32], reached: Mask, taken: NDArray[np.int64]
) -> None:
    """Most neighbours that an unreached node takes its light from."""
    for i in range(begin, end):
        if not reached[i]:
            for at in range(starts[i], starts[i + 1]):
                taken[i] += reached[columns[at]]


@kernel
def _take(
    begin: int,
    end: int,
    nodes: NDArray[np.int64],
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    weights: NDArray[np.float32],
    reached: Mask,
    out_starts: NDArray[np.int64],
    out_columns: NDArray[np.int32],
    out_weights: NDArray[np.float32],
) -> None:
    for n in range(begin, end):
        at, total = out_starts[n], np.float32(0)
        for i in range(starts[nodes[n]], starts[nodes[n] + 1]):
            if reached[columns[i]]:
                out_columns[at], out_weights[at] = columns[i], weights[i]
                total += weights[i]
                at += 1
        for i in range(out_starts[n], at):
            out_weights[i] /= total


@kernel
def _fill(
    begin: int,
    end: int,
    nodes: NDArray[np.int64],
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    weights: NDArray[np.float32],
    values: NDArray[np.float32],
) -> None:
    for n in range(begin, end):
        row = values[nodes[n]]
        row[:] = np.float32(0)
        for at in range(starts[n], starts[n + 1]):
            for c in range(values.shape[1]):
                row[c] += weights[at] * values[columns[at], c]
