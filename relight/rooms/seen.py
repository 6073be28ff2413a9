"""The surfaces that the capture saw in a room: light is judged and reported only there."""

import numpy as np
from numpy.typing import NDArray

from ..transfer.occluder import Occluder

SHORT = 0.999
"""Share of the way to an eye that must be free."""


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
