"""The side of a face that a ray met. The vertex normals define the front, not the winding."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Integers, Mask
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices
from splat2mesh.render.raycaster import Hits

from .occluder import Occluder


def met_in_front(occluder: Occluder, hits: Hits, directions: Directions) -> Mask:
    """Which rays meet a face, and from its front.

    occluder: what the rays were shot at. hits: of N rays, as `Occluder.first_hits` returns them. directions: (N, 3), of
    the rays, unit frame. Returns (N,) bool: false for the back of a face, and for rays that meet nothing.
    """
    front = np.zeros(len(hits.faces), bool)
    toward = np.ascontiguousarray(directions, np.float32)
    in_slices(_fronts, len(front), hits.faces, hits.normals, toward, occluder.faces, occluder.normals, front)
    return front


@kernel
def is_front(
    normal: NDArray[np.float32], toward: NDArray[np.float32], corners: Integers, vertex_normals: NDArray[np.float32]
) -> bool:
    """Whether a ray along `toward` (3,) meets the front of a face with this normal (3,) and these corners (3,)."""
    a, b, c = corners
    outward, facing = np.float32(0), np.float32(0)
    for axis in range(3):
        outward += normal[axis] * (vertex_normals[a, axis] + vertex_normals[b, axis] + vertex_normals[c, axis])
        facing += normal[axis] * toward[axis]
    return bool((facing if outward >= 0 else -facing) < 0)


@kernel
def _fronts(
    begin: int,
    end: int,
    faces: Integers,
    normals: NDArray[np.float32],
    directions: NDArray[np.float32],
    corners: Integers,
    vertex_normals: NDArray[np.float32],
    front: Mask,
) -> None:
    for ray in range(begin, end):
        if faces[ray] >= 0:
            front[ray] = is_front(normals[ray], directions[ray], corners[faces[ray]], vertex_normals)
