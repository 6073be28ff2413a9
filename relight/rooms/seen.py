"""The surfaces that the capture saw in a room: light is judged and reported only there."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.render.raycaster import FREE

from ..transfer.occluder import Occluder

UPRIGHT = 0.8

UNEVEN = 0.1
"""Share of the way from the eyes to the ceiling by which a trained one is uneven."""


def seen_from(occluder: Occluder, rows: NDArray[np.int64], eyes: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which of the vertices (N,) show their front to any of the eyes (E, 3), unit frame: (N,)."""
    seen = np.zeros(len(rows), bool)
    for eye in np.asarray(eyes, np.float32):
        left = np.flatnonzero(~seen)
        toward = eye - occluder.origins[rows[left]]
        left_facing = np.einsum("ij,ij->i", toward, occluder.normals[rows[left]]) > 0.0
        left, toward = left[left_facing], toward[left_facing]
        rays = np.hstack([occluder.origins[rows[left]], toward]).astype(np.float32)
        seen[left] = ~occluder.occluded(rays, FREE)
    return seen


def below_ceiling(occluder: Occluder, eyes: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Mask (V,) of the vertices that do not lie above the ceiling, where half of the rays up from the eyes (E, 3), unit
    frame, end: there training leaves fog that shows through its holes; all where nothing is above the eyes."""
    directions = fibonacci_sphere()
    up = directions[directions[:, 1] > UPRIGHT]
    origins = np.repeat(eyes, len(up), axis=0)
    rays = np.hstack([origins, np.tile(up, (len(eyes), 1))]).astype(np.float32)
    hits = occluder.first_hits(rays)
    hit = hits.faces >= 0
    if not hit.any():
        return np.ones(len(occluder.origins), bool)
    heights = origins[hit, 1] + hits.distance[hit] * rays[hit, 4]
    level, eye = float(np.median(heights)), float(np.median(origins[:, 1]))
    return np.asarray(occluder.origins[:, 1] <= level + UNEVEN * (level - eye))
