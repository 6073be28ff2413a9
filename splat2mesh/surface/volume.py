"""Surface or volume: which splats make up leaves, grass and hair, where normals are meaningless.

Splats of a surface lie in a sheet and face one way; splats of foliage fill space and face every way. Both are measured
among the nearest neighbours: the thickness of their cloud, and the disagreement of their shortest axes.
"""

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Floats, Indices, Points
from ..splats.splats import Splats

NEIGHBORS = 16

ANCHORS = 400_000
"""Splats that are measured, evenly along a curve through space; the others take the value of the nearest."""

SOLID = 0.1
"""Opacity from which a splat is measured: fainter ones are fuzz about a surface."""

THIN, THICK = 0.25, 0.6
"""Thickness over extent of a neighbourhood: up to the first a sheet, from the second on a cloud."""

AGREED, SPREAD = 0.12, 0.4
"""Part of the neighbours' axes, squared, that is across their common one: up to the first they agree, from the second
on they do not. Axes without any order have 2/3."""

MARGIN = 2.0
"""Radius, in distances between neighbours, within which a vertex takes the values of splats."""


def splat_volume(splats: Splats) -> NDArray[np.float32]:
    """(N,) float32 in [0, 1]: 0 for splats of a surface, 1 for those of a volume. Needs finite values."""
    result = np.zeros(len(splats), np.float32)
    solid = np.flatnonzero(splats.opacities > SOLID)
    if len(solid) <= NEIGHBORS:
        return result
    anchors = solid[:: -(-len(solid) // ANCHORS)]
    means = splats.means[anchors].astype(np.float64)
    _, near = scipy.spatial.cKDTree(means).query(means, NEIGHBORS + 1, workers=-1)
    near = np.sort(near, axis=1)  # sums in one order, whatever the tree's
    measured = _measured(means, *_axes(replace(splats, sh=splats.sh[:, :1]).take(anchors)), near)
    # One splat alone decides nothing: the median of the neighbourhood.
    measured = np.median(measured[near], axis=1).astype(np.float32)
    _, nearest = scipy.spatial.cKDTree(means).query(splats.means, workers=-1)
    return measured[nearest]


def vertex_volume(points: Points, splats: Splats, volume: Floats) -> NDArray[np.float32]:
    """(V,) float32: the volume of the splats about each point (V, 3), the median of the nearest four."""
    solid = np.flatnonzero(splats.opacities > SOLID)
    if len(solid) < 4:
        return np.zeros(len(points), np.float32)
    _, near = scipy.spatial.cKDTree(splats.means[solid]).query(points, 4, workers=-1)
    return np.median(volume[solid][near], axis=1).astype(np.float32)


def _axes(splats: Splats) -> tuple[Floats, Floats]:
    """Shortest axes (N, 3), of either sign, and how flat each splat is, (N,) in [0, 1]."""
    shortest = splats.scales.argmin(axis=1)
    axes = np.take_along_axis(splats.rotation_matrices(), shortest[:, None, None], axis=2)[:, :, 0]
    ranked = np.sort(splats.scales, axis=1)
    return axes.astype(np.float64), 1.0 - ranked[:, 0] / np.maximum(ranked[:, 1], 1e-30)


def _measured(means: Points, axes: Floats, flat: Floats, near: Indices) -> Floats:
    result = np.zeros(len(means))
    for start in range(0, len(means), 1 << 15):
        some = near[start : start + (1 << 15)]
        offset = means[some] - means[some].mean(axis=1, keepdims=True)
        spread = np.sqrt(np.maximum(np.linalg.eigvalsh(np.einsum("nki,nkj->nij", offset, offset)), 0.0))
        thickness = spread[:, 0] / np.maximum(np.sqrt(spread[:, 1] * spread[:, 2]), 1e-30)
        weight = flat[some] + 1e-3
        tensor = np.einsum("nk,nki,nkj->nij", weight, axes[some], axes[some])
        across = 1.0 - np.linalg.eigvalsh(tensor)[:, 2] / weight.sum(axis=1)
        result[start : start + len(some)] = _ramp(thickness, THIN, THICK) * _ramp(across, AGREED, SPREAD)
    return result


def _ramp(values: Floats, low: float, high: float) -> Floats:
    share = np.clip((values - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)
