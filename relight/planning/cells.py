"""An environment in cells of 2.8 degrees, in eight rotations at once, as plans use it."""

from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.base.sphere import fibonacci_sphere

from ..light import projections
from ..light.projections import pooled
from ..light.sun_split import GRID
from ..sh import harmonics

TURNS = 8
"""Rotations for which a plan must hold, 45 degrees apart. Between them errors change by a tenth or so."""


def cells_of(image: Radiance) -> NDArray[np.float64]:
    """Radiance (64, 128, 3) float64 of the cells of an unrotated lat-long image."""
    return pooled(image, GRID)


def turned(image_cells: Floats, directions: int) -> NDArray[np.float64]:
    """Radiance from D directions in every rotation of the cells: (D, TURNS, 3) float64.

    The light of each cell goes to the nearest direction; none is lost.
    """
    nearest = _nearest(directions)
    areas = np.broadcast_to(projections.row_solid_angles(*GRID).reshape(-1, 1), GRID).ravel()
    energy = image_cells.reshape(-1, 3) * areas[:, None]
    light: NDArray[np.float64] = np.zeros((directions, TURNS, 3))
    for turn in range(TURNS):
        for color in range(3):
            light[:, turn, color] = np.bincount(nearest[turn], energy[:, color], directions)
    return light * (directions / (4.0 * np.pi))


@lru_cache(4)
def basis(directions: int) -> NDArray[np.float64]:
    """SH basis at the directions: (D, K) float64, all bands."""
    return np.asarray(harmonics.evaluate(fibonacci_sphere(directions), harmonics.MAX_BANDS), np.float64)


@lru_cache(4)
def _nearest(directions: int) -> NDArray[np.int64]:
    """Index of the nearest of D directions for every cell in every rotation: (TURNS, cells)."""
    toward = projections.texel_directions(*GRID).reshape(-1, 3)
    tree = scipy.spatial.cKDTree(fibonacci_sphere(directions))
    found = []
    for turn in range(TURNS):
        angle = 2.0 * np.pi * turn / TURNS
        c, s = np.cos(angle), np.sin(angle)
        rotated = toward @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T
        found.append(tree.query(rotated, workers=-1)[1])
    return np.stack(found)
