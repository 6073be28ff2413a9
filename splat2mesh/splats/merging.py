"""Fewer splats: neighbours merge into one that has their mean, spread, colour and cover."""

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Integers
from .splats import FLATTEST, Splats

TOGETHER = 4
"""Splats that become one."""


def merged(splats: Splats, together: int = TOGETHER) -> Splats:
    """Merge every few successive splats, so in spatial order, to one; the last may stand for fewer. As `merged_at`."""
    return merged_at(splats, np.arange(0, len(splats), together))


def merged_at(splats: Splats, starts: Integers) -> Splats:
    """Merge successive splats, from each of some starts (G,) to the next, to one.

    splats: usable ones (`cleaning.clean`). Returns G Splats without harmonics. Mean, covariance and colour are those of
    the mixture, each splat weighing its opacity times its area, and the opacity keeps the sum of these, up to 1.

    Source: Goldberger and Roweis, "Hierarchical Clustering of a Mixture Model" (2004).
    """
    group = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(splats))))

    def sums(values: NDArray[Any]) -> NDArray[Any]:
        return np.add.reduceat(values, starts, axis=0)

    cover = covers(splats)
    share = cover / sums(cover)[group]
    means = sums(share[:, None] * splats.means)
    away = splats.means - means[group]
    spread = splats.covariances().astype(np.float64) + away[:, :, None] * away[:, None, :]
    squares, axes = np.linalg.eigh(sums(share[:, None, None] * spread))
    axes[np.linalg.det(axes) < 0, :, 0] *= -1.0
    scales = np.sqrt(np.maximum(squares, 0.0))
    scales = np.maximum(scales, FLATTEST * scales.max(axis=1, keepdims=True))
    quats = np.roll(scipy.spatial.transform.Rotation.from_matrix(axes).as_quat(), 1, axis=1)
    opacities = np.minimum(sums(cover) / np.maximum(scales[:, 1] * scales[:, 2], 1e-300), 1.0)
    colors = sums(share[:, None, None] * splats.sh[:, :1])
    return Splats(means, scales, quats, opacities, colors)


def covers(splats: Splats) -> NDArray[np.float64]:
    """(N,) opacity times area of each, which is what it weighs; never zero."""
    x, y, z = splats.scales.T.astype(np.float64)
    less, more = np.minimum(x, y), np.maximum(x, y)
    area = np.maximum(more, z) * np.maximum(less, np.minimum(more, z))  # of the two longer axes
    return np.maximum(splats.opacities * area, 1e-300)
