"""The surfaces that the capture saw in a room: light is judged and reported only there."""

import numpy as np
from numpy.typing import NDArray

from ..sh.sphere import fibonacci_sphere
from ..transfer.occluder import Occluder

SHORT = 0.999
"""Share of the way to an eye that must be free."""

LOOKS = 256
"""Directions from each eye; those within UPRIGHT of straight up find the ceiling."""

UPRIGHT = 0.8

UNEVEN = 0.1
"""Share of the way from the eyes to the ceiling by which a trained one is uneven."""


def seen_from(occluder: Occluder, rows: NDArray[np.int64], eyes: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Find the vertices whose front is visible from an eye.

    Parameters
    ----------
    occluder : Occluder
        The scene to trace rays in.
    rows : ndarray of int64, (N,)
        The vertices asked about.
    eyes : ndarray of float32, (E, 3)
        Unit frame of the occluder.

    Returns
    -------
    ndarray of bool, (N,)
        Whether any eye sees each.
    """
    seen = np.zeros(len(rows), bool)
    for eye in np.asarray(eyes, np.float32):
        left = np.flatnonzero(~seen)
        toward = eye - occluder.origins[rows[left]]
        left_facing = np.einsum("ij,ij->i", toward, occluder.normals[rows[left]]) > 0.0
        left, toward = left[left_facing], toward[left_facing]
        rays = np.hstack([occluder.origins[rows[left]], toward]).astype(np.float32)
        seen[left] = ~occluder.occluded(rays, SHORT)
    return seen


def ceiling_level(occluder: Occluder, eyes: NDArray[np.float32]) -> tuple[float, float] | None:
    """Height of the ceiling, where half of the rays up from the eyes end, and that of the eyes.

    Parameters
    ----------
    occluder : Occluder
        The scene to trace rays in.
    eyes : ndarray of float32, (E, 3)
        Unit frame of the occluder.

    Returns
    -------
    tuple of two floats, or None
        Unit frame; None where nothing is above the eyes.
    """
    directions = fibonacci_sphere(LOOKS)
    up = directions[directions[:, 1] > UPRIGHT]
    origins = np.repeat(eyes, len(up), axis=0)
    rays = np.hstack([origins, np.tile(up, (len(eyes), 1))]).astype(np.float32)
    hits = occluder.first_hits(rays)
    hit = hits.faces >= 0
    if not hit.any():
        return None
    heights = origins[hit, 1] + hits.distance[hit] * rays[hit, 4]
    return float(np.median(heights)), float(np.median(origins[:, 1]))


def below_ceiling(occluder: Occluder, eyes: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Find the vertices that do not lie above the ceiling, where training leaves fog that shows through its holes.

    Parameters
    ----------
    occluder : Occluder
        The scene to trace rays in, V vertices.
    eyes : ndarray of float32, (E, 3)
        Unit frame of the occluder.

    Returns
    -------
    ndarray of bool, (V,)
        All where nothing is above the eyes.
    """
    found = ceiling_level(occluder, eyes)
    if found is None:
        return np.ones(len(occluder.origins), bool)
    level, eye = found
    return np.asarray(occluder.origins[:, 1] <= level + UNEVEN * (level - eye))
