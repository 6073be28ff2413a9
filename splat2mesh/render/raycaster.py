"""Rays against triangles: Embree, through open3d."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..base.meshlibrary import open3d

FREE = 0.999
"""Part of a line of sight that nothing may block."""


class Hits(NamedTuple):
    """The first hits of rays (..., 6).

    distance: (...) float32, in lengths of the ray's direction; infinite where it meets nothing. faces: (...) int32, -1
    for none. uv: (..., 2) float32, the weights of the face's second and third vertex. normals: (..., 3) float32 unit
    normals of the faces; which of their two sides they are on follows the winding.
    """

    distance: NDArray[np.float32]
    faces: NDArray[np.int32]
    uv: NDArray[np.float32]
    normals: NDArray[np.float32]


class Closest(NamedTuple):
    """The points of a surface that are closest to some: points (N, 3) float32, faces (N,) int32, uv as of Hits."""

    points: NDArray[np.float32]
    faces: NDArray[np.int32]
    uv: NDArray[np.float32]


def corner_weights(uv: NDArray[np.float32]) -> NDArray[np.float32]:
    """Weights (N, 3) of the three vertices of a face at uv (N, 2), as of Hits."""
    second, third = uv.T
    return np.stack([np.maximum(1.0 - second - third, 0.0), second, third], axis=1)


class RayCaster:
    """Triangles, opaque from both sides, ready for rays (..., 6) float32: an origin and a direction of any length."""

    def __init__(
        self,
        vertices: ArrayLike,  # (V, 3)
        faces: ArrayLike,  # (F, 3) integers
    ) -> None:
        o3d = open3d()

        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(_tensor(vertices, np.float32), _tensor(faces, np.uint32))

    def occluded(self, rays: ArrayLike, far: float = np.inf) -> NDArray[np.bool_]:
        """Whether anything hides the rays up to `far` lengths of their directions: (...) bool."""
        return self._scene.test_occlusions(_tensor(rays, np.float32), tfar=far).numpy()

    def first_hits(self, rays: ArrayLike) -> Hits:
        """The first hits of the rays: Hits."""
        hits = self._scene.cast_rays(_tensor(rays, np.float32))
        faces = hits["primitive_ids"].numpy().view(np.int32)  # open3d's mark for "none" is 2^32 - 1
        return Hits(hits["t_hit"].numpy(), faces, hits["primitive_uvs"].numpy(), hits["primitive_normals"].numpy())

    def closest(self, points: ArrayLike) -> Closest:
        """The points of the surface that are closest to points (N, 3): Closest."""
        found = self._scene.compute_closest_points(_tensor(points, np.float32))
        faces = found["primitive_ids"].numpy().view(np.int32)
        return Closest(found["points"].numpy(), faces, found["primitive_uvs"].numpy())


def _tensor(array: ArrayLike, dtype: DTypeLike) -> Any:
    o3d = open3d()

    return o3d.core.Tensor.from_numpy(np.ascontiguousarray(array, dtype))
