"""Leaves and grass: the change of light of a neighbourhood, since the normal of a single vertex is meaningless.

If every blade took the light of its noisy normal, grass would turn into a patchwork. In a volume the normals of a
neighbourhood face every way, and together they receive the light of a wide phase function.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Mask, Points
from splat2mesh.base.errors import InputError
from splat2mesh.base.threads import in_batches

from ..transfer.volume import LEAST

NEIGHBORS = 48
"""Vertices of a volume that share a change of light; a patchwork of fewer is seen as blotches."""


class Neighborhoods:
    """Who shares the light of a volume, for M nodes: geometry alone. near: (A, 48) int32, what takes longest of it."""

    def __init__(
        self,
        points: Points,  # (M, 3)
        volume: Floats,  # (M,) in [0, 1], 0 for surfaces
        wanted: Mask | None = None,  # (M,) bool, whose change of light is requested: the others' stays; all without
        near: NDArray[np.int32] | None = None,  # that of one for the same, which finds it again
    ) -> None:
        self._rows = np.flatnonzero(volume > LEAST)
        self._share = volume[self._rows, None].astype(np.float32)
        self._asked = np.arange(len(self._rows)) if wanted is None else np.flatnonzero(wanted[self._rows])
        count = min(NEIGHBORS, len(self._rows))
        self.near = np.zeros((len(self._asked), count if count > 1 else 0), np.int32)
        if near is not None:
            self.near = self._require_same(near)
        elif count > 1:
            places = points[self._rows].astype(np.float64)
            tree, asked = scipy.spatial.cKDTree(places), places[self._asked]

            def ask(rows: slice) -> None:
                self.near[rows] = np.sort(tree.query(asked[rows], count)[1], axis=1)  # one order, whatever the tree's

            in_batches(ask, len(asked))

    def _require_same(self, near: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return neighbours that were kept. Raises InputError unless they can be those of these nodes."""
        if near.shape != self.near.shape or near.dtype != np.int32:
            raise InputError(f"kept neighbours are {near.dtype} of {near.shape}, expected int32 of {self.near.shape}")
        if near.min(initial=0) < 0 or near.max(initial=-1) >= len(self._rows):
            raise InputError("kept neighbours are of another scene")
        return near

    def shared(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values (M, C) float32 with each volume's drawn towards the mean around it, as far as it is one."""
        if not self.near.size:
            return values
        result, own = values.copy(), values[self._rows]

        def share(part: slice) -> None:
            near, asked = self.near[part], self._asked[part]
            weight = self._share[near]
            mean = (weight * own[near]).sum(axis=1) / weight.sum(axis=1)
            result[self._rows[asked]] += self._share[asked] * (mean - own[asked])

        in_batches(share, len(self._asked))
        return result
