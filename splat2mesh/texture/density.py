"""The required resolution of a texture: the size of the smallest splats, at each point of a surface."""

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Integers, Points
from ..render.opacitygrid import SCALES_PER_PIXEL
from ..splats.splats import Splats
from ..surface.volume import NEIGHBORS

SOLID = 0.5
"""Opacity of the splats that count, as for the pixel of a whole capture."""

SAMPLES, PERCENTILE = 40_000, 10
"""Faces at which splats are looked up, about, and which of their sizes is the training pixel there."""

SMOOTHED = 4
"""Samples whose mean, that of logarithms, a face takes."""


def local_pixel(splats: Splats, points: Points, faces: Integers) -> NDArray[np.float64]:
    """Size of a training pixel at faces (F, 3) of points (V, 3), in the frame of the splats: (F,) float64."""
    centers = points[faces].mean(axis=1)
    solid = splats.opacities > SOLID
    solid = solid if solid.any() else np.ones(len(splats), bool)
    sizes = splats.scales[solid].max(axis=1) / SCALES_PER_PIXEL
    sampled = centers[:: max(1, len(centers) // SAMPLES)]
    near = _nearest(splats.means[solid], sampled, NEIGHBORS)
    pixel = np.log(np.maximum(np.percentile(sizes[near], PERCENTILE, axis=1), 1e-30))
    return np.exp(pixel[_nearest(sampled, centers, SMOOTHED)].mean(axis=1))


def _nearest(points: Points, places: Points, count: int) -> NDArray[np.intp]:
    """(N, count) the nearest points of each place, or all where there are fewer."""
    found = scipy.spatial.cKDTree(points).query(places, min(count, len(points)), workers=-1)[1]
    return found.reshape(len(places), -1)
