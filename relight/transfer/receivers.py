"""The vertices that light is traced for, and how the others take theirs from neighbours.

The mesh of a place has several vertices for each splat, and unseen undersides. Where only splats are shown, light is
computed at the vertices that they use, and at some of the others, which bounces meet. The vertices in between
take the mean of the neighbours whose normals agree.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask
from splat2mesh.base.errors import InputError

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
        reached, rings, matrix = traced.copy(), [], neighbors.matrix
        for _ in range(RINGS):
            nodes = np.flatnonzero(~reached)
            rows = matrix[nodes].multiply(reached).tocsr()
            rows.eliminate_zeros()
            nodes, rows = nodes[np.diff(rows.indptr) > 0], rows[np.diff(rows.indptr) > 0]
            if not len(nodes):
                break
            weights = rows.data / np.repeat(rows.sum(axis=1), np.diff(rows.indptr))
            rings.append((nodes, rows.indptr.astype(np.int64), rows.indices, weights.astype(np.float32)))
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
            rows = scipy.sparse.csr_array((weights, columns, starts), (len(nodes), len(values)))
            values[nodes] = rows @ values
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
