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
    """Gather P spots of light into clusters that may each shine as a point.

    bands: of the light without them. scale: root mean square radiance, to which errors are relative. allowed: sum of
    squared relative errors that may remain. most: clusters at most. Returns the cluster of each spot, (P,) int64 from
    0, their number, and the relative error of letting each shine as a point.

    The cluster with the largest error is halved at its centroid, across its longest axis, until the squares sum to
    `allowed` or there are `most`.
    """
    toward, weights, variance = spots
    bright, held, factor = luminance(weights), _SPREAD_HELD / bands, _EDGE_ERROR / scale**2

    def error_of(part: NDArray[np.int64]) -> float:
        """Squared relative error of a cluster that shines as one point."""
        away = np.square(_off(toward[part], bright[part])).sum(axis=1) + variance[part]
        spread = min(math.sqrt(0.5 * (bright[part] * away).sum() / bright[part].sum()), held)
        return factor * spread * float(np.square(weights[part].sum(axis=0)).sum())

    parts = [np.arange(len(toward))]
    errors = [error_of(parts[0])]
    while sum(errors) > allowed and len(parts) < most:
        worst = int(np.argmax(errors))
        part = parts[worst]
        off = _off(toward[part], bright[part])
        longest = np.linalg.eigh(np.einsum("n,ni,nj->ij", bright[part], off, off))[1][:, -1]
        ahead = np.einsum("ni,i->n", off, longest) > 0.0
        if ahead.all() or not ahead.any():  # a single spot, or several in one place
            break
        parts[worst : worst + 1] = part[ahead], part[~ahead]
        errors[worst : worst + 1] = map(error_of, parts[worst : worst + 2])
    label = np.zeros(len(toward), np.int64)
    for number, part in enumerate(parts):
        label[part] = number
    return label, len(parts), math.sqrt(sum(errors))


def _off(toward: Directions, bright: Floats) -> NDArray[np.float64]:
    """Offsets (P, 3) of spots from their centroid."""
    return np.asarray(toward - (bright[:, None] * toward).sum(axis=0) / bright.sum(), np.float64)
