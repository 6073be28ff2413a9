"""Bounced light averaged over the neighbours of each vertex, as far as their difference is noise of the rays.

What surfaces send to one another changes slowly along them, and every ring of vertices has shot several times the rays
of one. How much each vertex takes from its ring depends on the geometry alone: it is measured by light that is known,
a sky in each of six directions as surfaces reflect it. There the difference of a vertex from its ring is compared with
the noise that the spread of the single rays predicts. So the average is linear in the light, and one for all lights.
"""

import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices

from .neighbors import Neighbors

STRATIFIED = 16.0, 0.28
"""Variance of the mean of R stratified rays over that of independent ones: (16 / R)^.28. The error of bounced light
falls with R^-.64 in a parlour and on a patio, with R^-.70 on a tabletop."""

TINY = sys.float_info.min


class Met(NamedTuple):
    """What the rays of V vertices met. hits: (V,) how many met something. fronts: (V,) how many of these the front of a
    face. hidden: (V,) fraction of the cosine lobe. rays: from each."""

    hits: NDArray[np.int32]
    fronts: NDArray[np.int32]
    hidden: NDArray[np.float32]
    rays: int


class BounceBlend:
    """The linear average of what the rays of vertices met in the mean, over the N nodes of a scene and their rings.

    A ring is averaged each neighbour by its rays that met something and by how alike both are: where surfaces hide as
    much from them, the smaller share over the larger, squared. A node that meets more backs than fronts is inside a
    body: it neither gives nor takes. share: (N,) float64, how much each takes from its ring.
    """

    def __init__(
        self,
        neighbors: Neighbors,
        rays: Met,
        known: NDArray[np.float32],  # (V, 2 F) what rays met of F `known_lights`, and of their squares
    ) -> None:
        """Measure the share, (N,), that each node takes from its ring."""
        rows = self._vertices = neighbors.vertices
        self._node, self._starts, self._columns = neighbors.node, neighbors.starts, neighbors.columns
        met, outside = rays.hits[rows].astype(np.float64), 2 * rays.fronts[rows] >= rays.hits[rows]
        self._weights, alike = np.empty(len(self._columns)), np.empty(len(rows))
        ring = self._starts, self._columns, neighbors.weights
        in_slices(_weigh, len(rows), *ring, met, outside, rays.hidden[rows].astype(np.float64), self._weights, alike)
        mean = known[rows]
        own, square = np.split(mean.astype(np.float64), 2, axis=1)
        spread = np.maximum(square - own**2, 0.0).sum(axis=1) / np.maximum(met, 1.0)
        noise = spread * (STRATIFIED[0] / rays.rays) ** STRATIFIED[1]
        self.share, off = np.empty(len(rows)), np.empty(len(rows))
        in_slices(_apart, len(rows), *ring[:2], self._weights, own, off)
        in_slices(_shares, len(rows), *ring, self._weights, off, noise, alike, self.share)

    def __call__(self, mean: NDArray[np.float32]) -> NDArray[np.float32]:
        """(V, C) float32 of means (V, C) over what rays met: each vertex's own and, for its share, that of its ring."""
        own = mean[self._vertices].astype(np.float64)
        blended = np.empty(own.shape, np.float32)
        in_slices(_blend, len(own), self._starts, self._columns, self._weights, self.share, own, blended)
        return blended[self._node]


def known_lights(visible: NDArray[np.floating], normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """(V, 6) what vertices that see so much of the sky, (V,), reflect of one that is bright on one side."""
    sides = np.concatenate([1.0 + normals, 1.0 - normals], axis=1) / 2.0
    return (np.asarray(visible)[:, None] * sides).astype(np.float32)


@kernel
def _weigh(
    begin: int,
    end: int,
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    weights: NDArray[np.float32],
    met: NDArray[np.float64],
    outside: Mask,
    hidden: NDArray[np.float64],
    shares: NDArray[np.float64],
    alike: NDArray[np.float64],
) -> None:
    """The shares of its neighbours in each ring, whose sum is 1, or 0 where none counts, and how alike they are."""
    for i in range(begin, end):
        total, counted = 0.0, 0.0
        for k in range(starts[i], starts[i + 1]):
            j = columns[k]
            part = weights[k] * (met[j] if outside[j] else 0.0)
            most = max(max(hidden[i], hidden[j]), TINY)
            likeness = min(hidden[i], hidden[j]) / most
            shares[k] = part * (likeness * likeness)
            total += shares[k]
            counted += part
        scale = 1.0 / max(total, TINY)
        for k in range(starts[i], starts[i + 1]):
            shares[k] *= scale
        alike[i] = total / max(counted, TINY) if outside[i] else 0.0


@kernel
def _apart(
    begin: int,
    end: int,
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    shares: NDArray[np.float64],
    own: NDArray[np.float64],
    off: NDArray[np.float64],
) -> None:
    """The squared difference of each node's known lights (N, F) from those of its ring."""
    for i in range(begin, end):
        off[i] = 0.0
        for c in range(own.shape[1]):
            ring = 0.0
            for k in range(starts[i], starts[i + 1]):
                ring += shares[k] * own[columns[k], c]
            off[i] += (ring - own[i, c]) * (ring - own[i, c])


@kernel
def _shares(
    begin: int,
    end: int,
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    weights: NDArray[np.float32],
    shares: NDArray[np.float64],
    off: NDArray[np.float64],
    noise: NDArray[np.float64],
    alike: NDArray[np.float64],
    found: NDArray[np.float64],
) -> None:
    """How much each node takes from its ring: as far as its difference, in the mean of both, is noise."""
    for i in range(begin, end):
        total, of_own, apart, of_ring = 1.0, noise[i], off[i], 0.0
        for k in range(starts[i], starts[i + 1]):
            j = columns[k]
            total += weights[k]
            of_own += weights[k] * noise[j]
            apart += weights[k] * off[j]
            of_ring += shares[k] * shares[k] * noise[j]
        of_own, apart = of_own / total, apart / total
        bias = max(apart - of_own - of_ring, 0.0)
        found[i] = alike[i] * (of_own / max(of_own + of_ring + bias, TINY))


@kernel
def _blend(
    begin: int,
    end: int,
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    shares: NDArray[np.float64],
    share: NDArray[np.float64],
    own: NDArray[np.float64],
    blended: NDArray[np.float32],
) -> None:
    for i in range(begin, end):
        for c in range(own.shape[1]):
            ring = 0.0
            for k in range(starts[i], starts[i + 1]):
                ring += shares[k] * own[columns[k], c]
            blended[i, c] = own[i, c] + share[i] * (ring - own[i, c])
