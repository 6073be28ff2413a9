"""Responses in a few bytes: clustered principal components.

A row is the mean of its cluster and a few weights times the cluster's own components. Source: Sloan, Hall, Hart,
Snyder, "Clustered Principal Components for Precomputed Radiance Transfer" (2003).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Integers
from splat2mesh.base.errors import InputError
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices

TRAINED_ON = 2**15
"""Rows in the sample that determines clusters; then all rows choose a cluster and contribute to its components."""

ROUNDS = 8
"""Iterations of k-means; each further one lowers the error by less than 1%."""

CANDIDATES = 4
"""Nearest clusters among which a row takes the best: 8% less error than with the nearest alone."""

REFITS = 2
"""Iterations in which rows choose again and components are refitted."""

LARGEST = np.iinfo(np.int8).max
"""Weights and components are signed bytes."""

ROUNDING = 0.02
"""Part of the squared error that rounding of weights may add: the error grows by 1%, and rows of 8 bytes pack to 5."""


class CompressionLevel(NamedTuple):
    """The size of the compressed data. bytes: per row, 2 for the cluster and 1 for each weight. clusters, weights:
    their numbers."""

    clusters: int
    weights: int

    @property
    def bytes(self) -> int:
        return 2 + self.weights


CHOICES = tuple(CompressionLevel(clusters, weights) for weights in (2, 6, 14) for clusters in (64, 256, 1024))
"""4, 8 and 16 bytes a row, which a shader reads as whole texels."""


COMPONENT = 52
"""Bytes of a component, and of its scale."""


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


def choices_for(count: int) -> list[CompressionLevel]:
    """The CHOICES for a number of rows, the fewest bytes first, components included."""
    return sorted(CHOICES, key=lambda choice: choice.bytes * count + choice.clusters * (choice.weights + 2) * COMPONENT)


def compress(
    rows: NDArray[np.float32],
    counts: Floats,
    choice: CompressionLevel,
    seed: int = 0,
    centers: NDArray[np.float32] | None = None,
) -> Compressed:
    """Compress rows (N, D) float32 with weights (N,) float32.

    centers: of `cluster_centers`, if known from another choice of as many clusters.
    Reduces the weighted sum of squared errors over the D columns. Raises InputError without rows.
    """
    if rows.ndim != 2 or not len(rows) or len(counts) != len(rows):
        raise InputError(f"expected rows (N, D) and counts (N,), found {rows.shape} and {np.shape(counts)}")
    rows, counts = np.ascontiguousarray(rows, np.float32), np.ascontiguousarray(counts, np.float32)
    if centers is None:
        centers = cluster_centers(rows, counts, choice.clusters, seed)
    near = np.zeros((len(rows), min(CANDIDATES, len(centers))), np.int32)
    in_slices(_nearest, len(rows), rows, *_columns(centers), near)
    cluster = near[:, 0].copy()
    means, axes = _axes(rows, counts, cluster, len(centers), choice.weights)
    for _ in range(REFITS):
        in_slices(_best, len(rows), rows, near, means, axes, cluster)
        means, axes = _axes(rows, counts, cluster, len(centers), choice.weights)
    weights, left = np.zeros((len(rows), choice.weights), np.float32), np.zeros(len(rows), np.float32)
    in_slices(_weigh, len(rows), rows, cluster, means, axes, weights, left)
    largest = np.full((len(centers), choice.weights), 1e-20, np.float32)
    np.maximum.at(largest, cluster, np.abs(weights))
    error = float(counts.astype(np.float64) @ left) / max(float(counts.sum(dtype=np.float64)), 1e-30)
    step = np.sqrt(12.0 * ROUNDING * max(error, 0.0) / choice.weights)  # whose even errors are that part of it
    levels = np.ceil(np.minimum(largest / max(step, 1e-20), LARGEST)).astype(np.float32)
    packed = np.rint(weights * (levels / largest)[cluster]).astype(np.int8)
    components = axes * (largest / levels)[:, :, None]
    return Compressed(cluster.astype(np.uint16), packed, means, components)


def cluster_centers(rows: NDArray[np.float32], counts: Floats, clusters: int, seed: int = 0) -> NDArray[np.float32]:
    """Centres (C, D) float32 by k-means. A centre that loses all its rows takes the row with the largest error."""
    step = -(-len(rows) // TRAINED_ON)
    rows, counts = np.ascontiguousarray(rows[::step], np.float32), counts[::step]
    clusters = min(clusters, len(rows))
    pick = np.sort(np.random.default_rng(seed).choice(len(rows), clusters, replace=False))
    centers = rows[pick].copy()
    near = np.zeros((len(rows), 1), np.int32)
    for _ in range(ROUNDS):
        in_slices(_nearest, len(rows), rows, *_columns(centers), near)
        cluster = near[:, 0]
        total = np.bincount(cluster, counts, clusters)
        sums = np.stack([np.bincount(cluster, counts * column, clusters) for column in rows.T], axis=1)
        centers = np.where(total[:, None] > 0.0, sums / np.maximum(total, 1e-30)[:, None], centers).astype(np.float32)
        empty = np.flatnonzero(total == 0.0)
        if len(empty):
            off = counts * np.square(rows - centers[cluster]).sum(axis=1)
            centers[empty] = rows[np.argsort(-off, kind="stable")[: len(empty)]]
    return centers


def _axes(
    rows: NDArray[np.float32], counts: Floats, cluster: Integers, clusters: int, weights: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Means (C, D) and the first components (C, W, D) of every cluster, float32."""
    order = np.argsort(cluster, kind="stable")
    ends = np.searchsorted(cluster[order], np.arange(clusters + 1))
    means = np.zeros((clusters, rows.shape[1]), np.float32)
    axes = np.zeros((clusters, weights, rows.shape[1]), np.float32)
    for c in range(clusters):
        of = order[ends[c] : ends[c + 1]]
        if len(of):
            share = counts[of].astype(np.float64) + 1e-12
            mean, found = principal(rows[of], share, weights)
            means[c], axes[c, : len(found)] = mean, found
    return means, axes


def _columns(centers: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Centres as the kernel reads them: (D, C) and half their squared lengths (C,)."""
    return np.ascontiguousarray(centers.T), 0.5 * np.square(centers).sum(axis=1)


def _signed(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions (P, D), each with its largest entry positive, so that equal input has equal output."""
    top = np.take_along_axis(directions, np.abs(directions).argmax(axis=1)[:, None], axis=1)
    return directions * np.where(top < 0.0, -1.0, 1.0)


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _nearest(
    begin: int,
    end: int,
    rows: NDArray[np.float32],
    centers: NDArray[np.float32],
    half: NDArray[np.float32],
    near: Integers,
) -> None:
    """The nearest centres, (N, k), nearest first."""
    score = np.zeros(centers.shape[1], np.float32)
    for n in range(begin, end):
        for c in range(len(score)):  # a slice would have Numba compile the printing of shapes, which takes seconds
            score[c] = half[c]
        for d in range(centers.shape[0]):
            x = rows[n, d]
            line = centers[d]
            for c in range(len(score)):
                score[c] -= x * line[c]
        for k in range(near.shape[1]):
            best = 0
            for c in range(1, len(score)):
                if score[c] < score[best]:
                    best = c
            near[n, k] = best
            score[best] = np.float32(3e38)


@kernel
def _best(
    begin: int,
    end: int,
    rows: NDArray[np.float32],
    near: Integers,
    means: NDArray[np.float32],
    axes: NDArray[np.float32],
    cluster: Integers,
) -> None:
    """Choose, among the nearest clusters, the one whose components leave the least error."""
    dimensions, weights = rows.shape[1], axes.shape[1]
    off = np.zeros(dimensions, np.float32)
    for n in range(begin, end):
        least = np.float32(3e38)
        for k in range(near.shape[1]):
            c = near[n, k]
            error = np.float32(0)
            for d in range(dimensions):
                off[d] = rows[n, d] - means[c, d]
                error += off[d] * off[d]
            for w in range(weights):
                along = np.float32(0)
                for d in range(dimensions):
                    along += off[d] * axes[c, w, d]
                error -= along * along
            if error < least:
                least = error
                cluster[n] = c


@kernel
def _weigh(
    begin: int,
    end: int,
    rows: NDArray[np.float32],
    cluster: Integers,
    means: NDArray[np.float32],
    axes: NDArray[np.float32],
    weights: NDArray[np.float32],
    left: NDArray[np.float32],
) -> None:
    """Weights (N, W) of the components, and the squared error that they leave, (N,)."""
    for n in range(begin, end):
        c = cluster[n]
        left[n] = 0.0
        for d in range(rows.shape[1]):
            left[n] += (rows[n, d] - means[c, d]) ** 2
        for w in range(axes.shape[1]):
            along = np.float32(0)
            for d in range(rows.shape[1]):
                along += (rows[n, d] - means[c, d]) * axes[c, w, d]
            weights[n, w] = along
            left[n] -= along * along
