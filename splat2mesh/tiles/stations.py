"""The viewpoints of a tile: free positions at every height, a spacing apart, with a way to the sky.

The inside of houses, which no capture saw, has no way to the sky.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Floats, Mask, Vector
from ..splats.splats import SOLID
from ..views.eyes import NEAR, Eye

CELLS = 14
"""Cells of the grid of what is taken, along the distance between stations."""


CLEAR_CELLS = 2.0
"""Cells between a station and the nearest taken one, at least."""

ROOMY = 0.3
"""Clearance, in distances between stations, beyond which more does not improve a place."""


def stations_of(
    means: NDArray,  # (N, 3) of the splats of a tile and its halo, scene frame
    opacities: NDArray,  # (N,)
    core: NDArray,  # (2, 2) lowest and highest x and z of the tile
    spacing: float,  # between stations
) -> list[Eye]:
    """The stations within a core, in the scene frame, column after column, from below upwards."""
    points = means[opacities > SOLID].astype(np.float64)
    if len(points) == 0:
        return []
    cell = spacing / CELLS
    margin = 0.7 * spacing
    bottom, top = np.percentile(points[:, 1], [0.2, 99.8])
    low = np.array([core[0, 0] - margin, bottom - 2 * cell, core[0, 1] - margin])
    high = np.array([core[1, 0] + margin, top + 1.5 * spacing, core[1, 1] + margin])
    shape = np.maximum(np.ceil((high - low) / cell).astype(int), 1)
    at = np.floor((points - low) / cell).astype(int)
    at = at[((at >= 0) & (at < shape)).all(axis=1)]
    taken = np.zeros(shape, bool)
    taken[tuple(at.T)] = True
    if not taken.any():
        return []
    # No station stands under the ground: all below the lowest taken cell of a column counts as taken.
    some = np.asarray(taken.any(axis=1))
    first = np.where(some, taken.argmax(axis=1), 0)
    taken |= (np.arange(shape[1])[None, :, None] < first[:, None, :]) & some[:, None, :]
    clearance = scipy.ndimage.distance_transform_edt(~taken)
    free = np.asarray(clearance >= CLEAR_CELLS)
    parts = np.asarray(scipy.ndimage.label(free)[0])
    sky = np.zeros(parts.max() + 1, bool)
    sky[parts[:, -1]] = True
    free &= sky[parts]  # what is no part is not free
    counts = np.maximum(np.round((core[1] - core[0]) / spacing).astype(int), 1)
    step, found = (core[1] - core[0]) / counts, []
    for place in np.ndindex(*counts):
        start = core[0] + step * place
        found += _in_column(np.stack([start, start + step]), low, cell, clearance, free, taken)
    return found


def _in_column(column: Floats, low: Vector, cell: float, clearance: Floats, free: Mask, taken: Mask) -> list[Eye]:
    """The stations above a square of about the spacing, (2, 2) its lowest and highest x and z, from below upwards."""
    first = np.maximum(((column[0] - low[[0, 2]]) / cell).astype(int), 0)
    last = np.maximum(np.ceil((column[1] - low[[0, 2]]) / cell).astype(int), first + 1)
    box = slice(first[0], last[0]), slice(None), slice(first[1], last[1])
    room, open_ = clearance[box], free[box]
    heights = np.flatnonzero(taken[box].any(axis=(0, 2)))
    if len(heights) == 0:
        return []
    x, z = np.meshgrid(*(np.arange(n) + 0.5 - n / 2 for n in (room.shape[0], room.shape[2])), indexing="ij")
    aside = np.hypot(x, z)[:, None, :] * 0.1
    found, bottom = [], heights[0]
    while bottom < room.shape[1]:
        slab = slice(bottom, min(bottom + CELLS, room.shape[1]))
        score = np.where(open_[:, slab], np.minimum(room[:, slab], ROOMY * CELLS) - aside, -np.inf)
        best = np.unravel_index(score.argmax(), score.shape)
        if np.isfinite(score[best]):
            i, j, k = best[0] + first[0], best[1] + bottom, best[2] + first[1]
            if clearance[i, j, k] < CELLS:  # else there is nothing near to look at
                center = low + (np.array([i, j, k]) + 0.5) * cell
                found.append(Eye(center, float(NEAR * clearance[i, j, k] * cell)))
        bottom += CELLS
    return found
