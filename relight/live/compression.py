"""Responses in a few bytes: clustered principal components.

A row is the mean of its cluster and a few weights times the cluster's own components. Source: Sloan, Hall, Hart,
Snyder, "Clustered Principal Components for Precomputed Radiance Transfer" (2003).
"""

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

from splat2mesh.base.arrays import Floats, Indices, Integers
from splat2mesh.base.errors import InputError
from splat2mesh.base.threads import in_batches

TRAINED_ON = 2**15
"""Rows in the sample that determines clusters; then all rows choose a cluster and contribute to its components."""

ROUNDS = 8
"""Iterations of k-means; each further one lowers the error by less than 1%."""

CANDIDATES = 4
"""Nearest clusters among which a row takes the best: 20% less error than with the nearest alone."""

REFITS = 2
"""Iterations in which rows choose again and components are refitted."""

LARGEST = np.iinfo(np.int8).max
"""Weights and components are signed bytes."""

ROUNDING = 0.02
"""Part of the squared error that rounding of weights may add: the error grows by 1%, and rows of 8 bytes pack to 5."""


CLUSTERS = 256

WEIGHTS = 2, 6, 14
"""Their numbers to choose from: 4, 8 and 16 bytes a row with the 2 of its cluster, which a shader reads as whole
texels."""


class Compressed(NamedTuple):
    """cluster: (N,) uint16. weights: (N, W) int8. means: (C, D), components: (C, W, D) float32, to be multiplied with
    the weights as bytes: row = means[cluster] + weights @ components[cluster]."""

    cluster: NDArray[np.uint16]
    weights: NDArray[np.int8]
    means: NDArray[np.float32]
    components: NDArray[np.float32]

    def rows(self, part: slice = slice(None)) -> NDArray[np.float32]:
        """The decoded rows: (N, D) float32."""
        cluster = self.cluster[part]
        return self.means[cluster] + np.einsum(
            "nw,nwd->nd", self.weights[part].astype(np.float32), self.components[cluster]
        )


def principal(values: Floats, counts: Floats, most: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean (D,) and orthonormal directions (P, D), P <= most, that hold most of the variance of rows (V, D) with
    weights (V,). float64."""
    counts = counts / counts.sum()
    mean, second = np.zeros(values.shape[1]), np.zeros((values.shape[1],) * 2)
    for start in range(0, len(values), 4096):
        block = values[start : start + 4096].astype(np.float64)
        mean += counts[start : start + 4096] @ block
        second += (block * counts[start : start + 4096, None]).T @ block
    spread, directions = np.linalg.eigh(second - np.outer(mean, mean))
    return mean, _signed(directions[:, np.argsort(-spread, kind="stable")[:most]].T)


def compress(rows: NDArray[np.float32], counts: Floats, weights: int, near: Indices) -> Compressed:
    """Compress rows (N, D) float32 with weights (N,) float32.

    weights: numbers of a row beside its cluster. near: (N, k) of `near_clusters`. Reduces the weighted sum of squared
    errors over the D columns.
    """
    rows, counts = np.ascontiguousarray(rows, np.float32), np.ascontiguousarray(counts, np.float32)
    cluster = near[:, 0]
    means, axes = _components(rows, counts, cluster, weights)
    for _ in range(REFITS):
        cluster = _best(rows, near, means, axes)
        means, axes = _components(rows, counts, cluster, weights)
    along, left = np.zeros((len(rows), weights), np.float32), np.zeros(len(rows))

    def weigh(part: slice) -> None:
        off = rows[part] - means[cluster[part]]
        along[part] = np.einsum("nd,nwd->nw", off, axes[cluster[part]])
        left[part] = np.square(off).sum(axis=1) - np.square(along[part]).sum(axis=1)

    in_batches(weigh, len(rows))
    largest = np.full((len(means), weights), 1e-20, np.float32)
    np.maximum.at(largest, cluster, np.abs(along))
    error = float(counts @ left) / max(float(counts.sum(dtype=np.float64)), 1e-30)
    step = np.sqrt(12.0 * ROUNDING * max(error, 0.0) / weights)  # whose even errors are that part of it
    levels = np.ceil(np.minimum(largest / max(step, 1e-20), LARGEST)).astype(np.float32)
    packed = np.rint(along * (levels / largest)[cluster]).astype(np.int8)
    components = axes * (largest / levels)[:, :, None]
    return Compressed(cluster.astype(np.uint16), packed, means, components)


def near_clusters(rows: NDArray[np.float32], seed: int = 0) -> NDArray[np.int64]:
    """The nearest clusters of each row, (N, k), nearest first, by k-means. Raises InputError without rows."""
    if not len(rows):
        raise InputError("there are no splats to light")
    some = np.ascontiguousarray(rows[:: -(-len(rows) // TRAINED_ON)], np.float32)
    clusters = min(CLUSTERS, len(some))
    first = some[np.sort(np.random.default_rng(seed).choice(len(some), clusters, replace=False))]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a centre that loses all its rows, which stays
        centers, _ = kmeans2(some, first, ROUNDS, minit="matrix")
    return _nearest(rows, centers, min(CANDIDATES, clusters))


def _nearest(rows: NDArray[np.float32], centers: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """The nearest centres of each row, (N, count), nearest first."""
    half, found = 0.5 * np.square(centers).sum(axis=1), np.zeros((len(rows), count), np.int64)

    def find(part: slice) -> None:
        away = half - rows[part] @ centers.T
        for k in range(count):
            found[part, k] = away.argmin(axis=1)
            np.put_along_axis(away, found[part, k, None], np.inf, axis=1)

    in_batches(find, len(rows))
    return found


def _best(
    rows: NDArray[np.float32], near: NDArray[np.int64], means: NDArray[np.float32], axes: NDArray[np.float32]
) -> NDArray[np.int64]:
    """For each row that of some clusters (N, count) whose components leave the least error, (N,)."""
    least, found = np.full(len(rows), np.inf, np.float32), near[:, 0].copy()
    for c, of in enumerate(_rows_of(near.ravel(), int(near.max()) + 1)[: len(means)]):
        of = of // near.shape[1]
        off = rows[of] - means[c]
        left = np.square(off).sum(axis=1) - np.square(off @ axes[c].T).sum(axis=1)
        better = left < least[of]
        least[of[better]], found[of[better]] = left[better], c
    return found


def _rows_of(cluster: Integers, clusters: int) -> list[Indices]:
    """The rows of each cluster."""
    order = np.argsort(cluster, kind="stable")
    return np.split(order, np.searchsorted(cluster[order], np.arange(1, clusters)))


def _components(
    rows: NDArray[np.float32], counts: Floats, cluster: Integers, weights: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Means (C, D) and the first components (C, W, D) of every cluster, float32."""
    clusters = int(cluster.max()) + 1
    means = np.zeros((clusters, rows.shape[1]), np.float32)
    axes = np.zeros((clusters, weights, rows.shape[1]), np.float32)
    for c, of in enumerate(_rows_of(cluster, clusters)):
        if len(of):
            mean, found = principal(rows[of], counts[of].astype(np.float64) + 1e-12, weights)
            means[c], axes[c, : len(found)] = mean, found
    return means, axes


def _signed(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions (P, D), each with its largest entry positive, so that equal input has equal output."""
    top = np.take_along_axis(directions, np.abs(directions).argmax(axis=1)[:, None], axis=1)
    return directions * np.where(top < 0.0, -1.0, 1.0)
