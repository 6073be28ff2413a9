"""Cluster spots of light into suns: the fewest clusters that may shine as single points."""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Radiance
from splat2mesh.base.kernels import kernel
from splat2mesh.scene.color import luminance

_EDGE_ERROR = (math.sqrt(2.0) - 1.0) / (2.0 * math.sqrt(math.pi)) / (6.0 * math.pi**2)
"""Mean squared error of exit radiance, per squared weight and radian of spread, when a spot shines as a point: vertices
face anywhere, so that their cosine squared has mean 1/6; a wall's edge, a great circle of any direction, passes at a
distance of density 1/2; and at a distance x the error of a normal distribution of spread s is Q(|x| / s), whose square
integrates to s (sqrt 2 - 1) / sqrt pi."""

_SWEEPS = 8
"""Of Jacobi's rotations; they converge quadratically, a matrix of three rows to the last digit in five."""

_SPREAD_HELD = 1.36  # over B: a wider spot is as wrong as one of this spread, since the bands hold what is smoother


Spots: TypeAlias = tuple[Directions, Radiance, Floats]
"""Directions (P, 3), weights (P, 3) and variances (P,) in rad^2 of small patches of light."""


def clusters(spots: Spots, bands: int, scale: float, allowed: float, most: int) -> tuple[NDArray[np.int64], int, float]:
    """Gather P spots of light into clusters that may each shine as a point.

    bands: of the light without them. scale: root mean square radiance, to which errors are relative. allowed: sum of
    squared relative errors that may remain. most: clusters at most. Returns the cluster of each spot, (P,) int64 from
    0, their number, and the relative error of letting each shine as a point.

    The cluster with the largest error is halved at its centroid, across its longest axis, until the squares sum to
    `allowed` or there are `most`.
    """
    toward, weights, variance = map(np.ascontiguousarray, spots)  # one type, or the kernel is compiled again
    label = np.zeros(len(toward), np.int64)
    held, factor = _SPREAD_HELD / bands, _EDGE_ERROR / scale**2
    order = np.arange(len(toward))  # spots, cluster by cluster
    arrays = toward, weights, luminance(weights), variance
    count, square = _halved(*arrays, held, factor, allowed, int(most), order, label)
    return label, count, math.sqrt(square)


@kernel
def _halved(
    toward: NDArray[np.float64],
    weights: NDArray[np.float64],
    bright: NDArray[np.float64],
    variance: NDArray[np.float64],
    held: float,
    factor: float,
    allowed: float,
    most: int,
    order: NDArray[np.int64],
    label: NDArray[np.int64],
) -> tuple[int, float]:
    """Fill in the labels; returns the number of clusters and the sum of their squared errors.

    Number by number: expressions of whole arrays take Numba five times as long to compile.
    """
    starts, ends, errors = np.zeros(most, np.int64), np.zeros(most, np.int64), np.zeros(most)
    side, center = np.zeros(len(toward), np.int64), np.zeros(3)
    spread, axes = np.zeros((3, 3)), np.zeros((3, 3))
    ends[0], count = len(toward), 1
    errors[0] = _point_error(order, toward, weights, bright, variance, held, factor)
    while True:
        square, worst = 0.0, 0
        for at in range(count):
            square += errors[at]
            if errors[at] > errors[worst]:
                worst = at
        if not (square > allowed and count < most):
            break
        part = order[starts[worst] : ends[worst]]
        _centroid(part, toward, bright, center)
        for row in range(3):
            for column in range(3):
                spread[row, column] = 0.0
                for i in part:
                    offset, other = toward[i, row] - center[row], toward[i, column] - center[column]
                    spread[row, column] += bright[i] * offset * other
        longest = _longest(spread, axes)
        ahead, behind = 0, 0
        for i in part:
            along = 0.0
            for k in range(3):
                along += (toward[i, k] - center[k]) * axes[k, longest]
            if along > 0.0:
                part[ahead] = i
                ahead += 1
            else:
                side[behind] = i
                behind += 1
        for at in range(behind):
            part[ahead + at] = side[at]
        if ahead == 0 or behind == 0:  # a single spot, or several in one place
            break
        starts[count], ends[count] = starts[worst] + ahead, ends[worst]
        ends[worst] = starts[count]
        for at in (worst, count):
            part = order[starts[at] : ends[at]]
            errors[at] = _point_error(part, toward, weights, bright, variance, held, factor)
        count += 1
    for at in range(count):
        for place in range(starts[at], ends[at]):
            label[order[place]] = at
    return count, square


@kernel
def _longest(spread: NDArray[np.float64], axes: NDArray[np.float64]) -> int:
    """Fill in the eigenvectors of a symmetric matrix (3, 3), in columns; returns the one of the largest eigenvalue.

    Overwrites the matrix with its diagonal form. np.linalg.eigh here takes Numba seconds to compile.
    Source: Golub and Van Loan, "Matrix Computations", 8.5.
    """
    for row in range(3):
        for column in range(3):
            axes[row, column] = 1.0 if row == column else 0.0
    for _ in range(_SWEEPS):
        for p in range(2):
            for q in range(p + 1, 3):
                if spread[p, q] == 0.0:
                    continue
                ratio = (spread[q, q] - spread[p, p]) / (2.0 * spread[p, q])
                tan = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(ratio * ratio + 1.0))
                cos = 1.0 / math.sqrt(tan * tan + 1.0)
                sin = tan * cos
                for k in range(3):
                    a, b = spread[k, p], spread[k, q]
                    spread[k, p], spread[k, q] = cos * a - sin * b, sin * a + cos * b
                    a, b = axes[k, p], axes[k, q]
                    axes[k, p], axes[k, q] = cos * a - sin * b, sin * a + cos * b
                for k in range(3):
                    a, b = spread[p, k], spread[q, k]
                    spread[p, k], spread[q, k] = cos * a - sin * b, sin * a + cos * b
    longest = 0
    for k in range(1, 3):
        if spread[k, k] > spread[longest, longest]:
            longest = k
    return longest


@kernel
def _centroid(
    part: NDArray[np.int64], toward: NDArray[np.float64], bright: NDArray[np.float64], center: NDArray[np.float64]
) -> float:
    """Fill in the centroid (3,) of a cluster; returns its brightness."""
    total = 0.0
    center[0] = center[1] = center[2] = 0.0
    for i in part:
        for k in range(3):
            center[k] += bright[i] * toward[i, k]
        total += bright[i]
    for k in range(3):
        center[k] /= total
    return total


@kernel
def _point_error(
    part: NDArray[np.int64],
    toward: NDArray[np.float64],
    weights: NDArray[np.float64],
    bright: NDArray[np.float64],
    variance: NDArray[np.float64],
    held: float,
    factor: float,
) -> float:
    """Squared relative error of a cluster that shines as one point."""
    center, weight = np.zeros(3), np.zeros(3)
    total, square = _centroid(part, toward, bright, center), 0.0
    for i in part:
        away = 0.0
        for k in range(3):
            weight[k] += weights[i, k]
            away += (toward[i, k] - center[k]) ** 2
        square += bright[i] * (away + variance[i])
    spread = min(math.sqrt(0.5 * square / total), held)
    return factor * spread * (weight[0] ** 2 + weight[1] ** 2 + weight[2] ** 2)
