"""Cluster spots of light into suns: the fewest clusters that may shine as single points."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from splat2mesh.scene.color import luminance

_EDGE_ERROR = (math.sqrt(2.0) - 1.0) / (2.0 * math.sqrt(math.pi)) / (6.0 * math.pi**2)
"""Mean squared error of exit radiance, per squared weight and radian of spread, when a spot shines as a point: vertices
face anywhere, so that their cosine squared has mean 1/6; a wall's edge, a great circle of any direction, passes at a
distance of density 1/2; and at a distance x the error of a normal distribution of spread s is Q(|x| / s), whose square
integrates to s (sqrt 2 - 1) / sqrt pi."""

_SPREAD_HELD = 1.36  # over B: a wider spot is as wrong as one of this spread, since the bands hold what is smoother


def clusters(spots, bands: int, scale: float, allowed: float, most: int) -> tuple[NDArray, int, float]:
    """Label (P,) of each spot, the number of clusters, and the relative error of letting each shine as a point.

    The cluster with the largest error is halved at its centroid, across its longest axis, until their squares sum
    to `allowed` or there are `most`.
    """
    toward, weights, variance = spots
    label = np.zeros(len(toward), np.int64)
    held, factor = _SPREAD_HELD / bands, _EDGE_ERROR / scale**2
    count, square = _halved(toward, weights, luminance(weights), variance, held, factor, allowed, int(most), label)
    return label, count, math.sqrt(square)


@njit(cache=True, nogil=True)
def _halved(toward, weights, bright, variance, held, factor, allowed, most, label):
    """Fill in the labels; returns the number of clusters and the sum of their squared errors."""
    order = np.arange(len(toward))  # spots, cluster by cluster
    starts, ends, errors = np.zeros(most, np.int64), np.zeros(most, np.int64), np.zeros(most)
    ends[0], errors[0], count = len(toward), _point_error(order, toward, weights, bright, variance, held, factor), 1
    side = np.zeros(len(toward), np.int64)
    while errors[:count].sum() > allowed and count < most:
        worst = np.argmax(errors[:count])
        part = order[starts[worst] : ends[worst]]
        center, total = np.zeros(3), 0.0
        for i in part:
            center += bright[i] * toward[i]
            total += bright[i]
        center /= total
        spread = np.zeros((3, 3))
        for i in part:
            offset = toward[i] - center
            for row in range(3):
                for column in range(3):
                    spread[row, column] += bright[i] * offset[row] * offset[column]
        axis = np.ascontiguousarray(np.linalg.eigh(spread)[1][:, 2])
        ahead, behind = 0, 0
        for i in part:
            offset = toward[i] - center
            if offset[0] * axis[0] + offset[1] * axis[1] + offset[2] * axis[2] > 0.0:
                part[ahead] = i
                ahead += 1
            else:
                side[behind] = i
                behind += 1
        if ahead == 0 or behind == 0:  # a single spot, or several in one place
            part[ahead:] = side[:behind]
            break
        part[ahead:] = side[:behind]
        starts[count], ends[count] = starts[worst] + ahead, ends[worst]
        ends[worst] = starts[count]
        for at in (worst, count):
            part = order[starts[at] : ends[at]]
            errors[at] = _point_error(part, toward, weights, bright, variance, held, factor)
        count += 1
    for at in range(count):
        label[order[starts[at] : ends[at]]] = at
    return count, errors[:count].sum()


@njit(cache=True, nogil=True)
def _point_error(part, toward, weights, bright, variance, held, factor):
    """Squared relative error of a cluster that shines as one point."""
    center, weight, total = np.zeros(3), np.zeros(3), 0.0
    for i in part:
        center += bright[i] * toward[i]
        weight += weights[i]
        total += bright[i]
    square = 0.0
    for i in part:
        offset = toward[i] - center / total
        square += bright[i] * (offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2 + variance[i])
    spread = min(math.sqrt(0.5 * square / total), held)
    return factor * spread * (weight[0] ** 2 + weight[1] ** 2 + weight[2] ** 2)
