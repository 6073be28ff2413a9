"""Leaves and grass: a change of light that is that of a neighbourhood, where a vertex's own normal means nothing.

Every blade would take the light of its own noisy normal: grass turns into a patchwork. In a volume the normals of a
neighbourhood face every way, and what they receive together is what a wide phase function would.
"""

import numpy as np
from scipy.spatial import cKDTree

NEIGHBORS = 48
"""Vertices of a volume that share a change of light; a patchwork of fewer is seen as blotches."""

LEAST = 0.02
"""Volume from which a vertex is asked at all: less is a rounding of a surface."""

_BATCH = 1 << 15


class Neighborhoods:
    """Who shares the light of a volume, for M nodes: geometry alone."""

    def __init__(
        self,
        points,  # (M, 3)
        volume,  # (M,) in [0, 1], 0 for surfaces
    ):
        self._rows = np.flatnonzero(volume > LEAST)
        self._share = volume[self._rows, None].astype(np.float32)
        count = min(NEIGHBORS, len(self._rows))
        if count > 1:
            places = points[self._rows].astype(np.float64)
            _, near = cKDTree(places).query(places, count, workers=-1)
            self._near = np.sort(near, axis=1)  # sums in one order, whatever the tree's

    def shared(self, values):
        """Values (M, C) float32 with each volume's drawn towards the mean around it, as far as it is one."""
        if len(self._rows) < 2:
            return values
        result, own = values.copy(), values[self._rows]
        for start in range(0, len(self._rows), _BATCH):
            part = slice(start, start + _BATCH)
            near = self._near[part]
            weight = self._share[near]
            mean = (weight * own[near]).sum(axis=1) / weight.sum(axis=1)
            result[self._rows[part]] += self._share[part] * (mean - own[part])
        return result
