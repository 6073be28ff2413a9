"""Cluster spots of light into suns: the fewest clusters that may shine as single points."""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Radiance
from splat2mesh.scene.color import luminance

_EDGE_ERROR = (math.sqrt(2.0) - 1.0) / (2.0 * math.sqrt(math.pi)) / (6.0 * math.pi**2)
"""Mean squared error of exit radiance, per squared weight and radian of spread, when a spot shines as a point: vertices
face anywhere, so that their cosine squared has mean 1/6; a wall's edge, a great circle of any direction, passes at a
distance of density 1/2; and at a distance x the error of a normal distribution of spread s is Q(|x| / s), whose square
integrates to s (sqrt 2 - 1) / sqrt pi."""

_SPREAD_HELD = 1.36  # over B: a wider spot is as wrong as one of this spread, since the bands hold what is smoother


Spots: TypeAlias = tuple[Directions, Radiance, Floats]
"""Directions (P, 3), weights (P, 3) and variances (P,) in rad^2 of small patches of light."""


def clusters(spots: Spots, bands: int, scale: float, allowed: float, most: int) -> tuple[NDArray[np.int64], int, float]:
    """Gather spots of light into clusters that may each shine as a point.

    Parameters
    ----------
    spots : Spots
        P patches of light: directions, weights, variances.
    bands : int
        B of the light without them.
    scale : float
        Root mean square radiance, to which errors are relative.
    allowed : float
        Sum of squared relative errors that may remain.
    most : int
        Clusters at most.

    Returns
    -------
    label : ndarray of int64, (P,)
        The cluster of each spot, from 0.
    count : int
        Number of clusters.
    error : float
        Relative error of letting each shine as a point.

    Notes
    -----
    The cluster with the largest error is halved at its centroid, across its longest axis, until the squares sum to
    `allowed` or there are `most`.
    """
    toward, weights, variance = map(np.ascontiguousarray, spots)  # one type, or the kernel is compiled again
    label = np.zeros(len(toward), np.int64)
    held, factor = _SPREAD_HELD / bands, _EDGE_ERROR / scale**2
    count, square = _halved(toward, weights, luminance(weights), variance, held, factor, allowed, int(most), label)
    return label, count, math.sqrt(square)


def _halved(
    toward: Directions,
    weights: Radiance,
    bright: Floats,
    variance: Floats,
    held: float,
    factor: float,
    allowed: float,
    most: int,
    label: NDArray[np.int64],
) -> tuple[int, float]:
    """Fill in the labels; returns the number of clusters and the sum of their squared errors.

    In NumPy: a light has few clusters, and Numba took 4 s to compile this with its eigenvectors.
    """

    def error(part: NDArray[np.int64]) -> float:
        """Squared relative error of a cluster that shines as one point."""
        shine = bright[part]
        total = shine.sum()
        away = toward[part] - (shine @ toward[part]) / total
        square = float(shine @ ((away * away).sum(axis=1) + variance[part]))
        spread = min(math.sqrt(0.5 * square / total), held)
        return factor * spread * float((weights[part].sum(axis=0) ** 2).sum())

    parts = [np.arange(len(toward))]
    errors = [error(parts[0])]
    while sum(errors) > allowed and len(parts) < most:
        worst = int(np.argmax(errors))
        part = parts[worst]
        shine = bright[part]
        away = toward[part] - (shine @ toward[part]) / shine.sum()
        spread = (away * shine[:, None]).T @ away
        along = away @ np.linalg.eigh(spread)[1][:, 2]  # columns; the last is the longest
        ahead, behind = part[along > 0], part[~(along > 0)]
        if len(ahead) == 0 or len(behind) == 0:  # a single spot, or several in one place
            break
        parts[worst], errors[worst] = ahead, error(ahead)
        parts.append(behind)
        errors.append(error(behind))
    for cluster, part in enumerate(parts):
        label[part] = cluster
    return len(parts), sum(errors)
