"""Bounced light averaged over the neighbours of each vertex, as far as their difference is noise of the rays.

What surfaces send to one another changes slowly along them, and every ring of vertices has shot several times the rays
of one. How much each vertex takes from its ring depends on the geometry alone: it is measured by light that is known,
a sky in each of six directions as surfaces reflect it. There the difference of a vertex from its ring is compared with
the noise that the spread of the single rays predicts. So the average is linear in the light, and one for all lights.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from .neighbors import Neighbors

STRATIFIED = 16.0, 0.28
"""Variance of the mean of R stratified rays over that of independent ones: (16 / R)^.28. The error of bounced light
falls with R^-.64 in a parlour and on a patio, with R^-.70 on a tabletop."""

LEAST_VARIANCE, LEAST_HIDDEN = 1e-20, 1e-6

FIELDS = 6


class RingMeans(NamedTuple):
    """The nodes of a scene and their rings.

    vertices: (N,) that stand for nodes. node: (V,) of each vertex. mean: (N, N) sparse rows that average the ring about
    a node, each neighbour by its rays that met something and by how alike both are; rows of zeros where none counts.
    squares: the same with squared weights. smooth: the same of a node and its ring, whatever they met. alike: (N,) how
    alike the ring is, in [0, 1]. met: (N,) how many rays of each met something, at least 1.
    """

    vertices: NDArray[np.int64]
    node: NDArray[np.int64]
    mean: csr_array
    squares: csr_array
    smooth: csr_array
    alike: NDArray[np.float64]
    met: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        neighbors: Neighbors,
        hits: NDArray[np.int32],  # (V,) how many rays met something
        fronts: NDArray[np.int32],  # (V,) how many of these the front of a face
        hidden: NDArray[np.float32],  # (V,) fraction of the cosine lobe
    ) -> "RingMeans":
        """Nodes are alike where surfaces hide as much from them: the smaller share over the larger, squared.

        A node that meets more backs than fronts is inside a body: it neither gives nor takes.
        """
        vertices, columns = neighbors.vertices, neighbors.columns
        count, met, own = len(vertices), hits[vertices].astype(np.float64), hidden[vertices].astype(np.float64)
        row = np.repeat(np.arange(count), np.diff(neighbors.starts))
        most = np.maximum(np.maximum(own[row], own[columns]), LEAST_HIDDEN)
        likeness = np.square(np.minimum(own[row], own[columns]) / most)
        outside = 2 * fronts[vertices] >= hits[vertices]
        counted = neighbors.weights * (outside * met)[columns]
        mean = csr_array((counted * likeness, columns, neighbors.starts), (count, count))
        weight = np.asarray(mean.sum(axis=1)).ravel()
        alike = outside * weight / np.maximum(np.bincount(row, counted, count), LEAST_VARIANCE)
        smooth = csr_array((neighbors.weights.astype(np.float64), columns, neighbors.starts), (count, count))
        smooth = smooth + diags_array(np.ones(count)).tocsr()
        mean, smooth = (
            diags_array(1.0 / np.maximum(np.asarray(each.sum(axis=1)).ravel(), LEAST_VARIANCE)).tocsr() @ each
            for each in (mean, smooth)
        )
        return cls(vertices, neighbors.node, mean, mean.power(2), smooth, alike, np.maximum(met, 1.0))


class BounceBlend:
    """The linear average of what the rays of vertices met in the mean.

    rings: RingMeans. mean, mean_of_squares: (V, FIELDS), what rays met of the known lights and of their squares, over
    those that met something. rays: from each vertex.
    """

    def __init__(
        self, rings: RingMeans, mean: NDArray[np.float32], mean_of_squares: NDArray[np.float32], rays: int
    ) -> None:
        self._rings = rings
        own = mean[rings.vertices].astype(np.float64)
        spread = np.maximum(mean_of_squares[rings.vertices] - own**2, 0.0).sum(axis=1) / rings.met
        noise = spread * (STRATIFIED[0] / rays) ** STRATIFIED[1]
        off = np.square(rings.mean @ own - own).sum(axis=1)
        of_own, of_ring = rings.smooth @ noise, rings.squares @ noise
        bias = np.maximum(rings.smooth @ off - of_own - of_ring, 0.0)
        share = of_own / np.maximum(of_own + of_ring + bias, LEAST_VARIANCE)
        self._share = (rings.alike * share)[:, None]

    def __call__(self, mean: NDArray[np.float32]) -> NDArray[np.float32]:
        """(V, C) float32 of means (V, C) over what rays met: each vertex's own and, for its share, that of its ring."""
        rings = self._rings
        own = mean[rings.vertices].astype(np.float64)
        own += self._share * (rings.mean @ own - own)
        return own.astype(np.float32)[rings.node]


def known_lights(visible: NDArray[np.floating], normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """(V, FIELDS) what vertices that see so much of the sky, (V,), reflect of one that is bright on one side."""
    sides = np.concatenate([1.0 + normals, 1.0 - normals], axis=1) / 2.0
    return (np.asarray(visible)[:, None] * sides).astype(np.float32)
