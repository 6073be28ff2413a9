"""Rays against triangles: Embree, through open3d."""

from typing import NamedTuple

import numpy as np


class Hits(NamedTuple):
    """What rays (..., 6) meet first.

    distance: (...) float32, in lengths of the ray's direction; infinite where it meets nothing. faces: (...) int32, -1
    for none. uv: (..., 2) float32, the weights of the face's second and third vertex. normals: (..., 3) float32 unit
    normals of the faces; which of their two sides they are on follows the winding.
    """

    distance: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    normals: np.ndarray


class Closest(NamedTuple):
    """The points of a surface that are closest to some: points (N, 3) float32, faces (N,) int32, uv as of Hits."""

    points: np.ndarray
    faces: np.ndarray
    uv: np.ndarray


class RayCaster:
    """Triangles, opaque from both sides, ready for rays (..., 6) float32: an origin and a direction of any length."""

    def __init__(
        self,
        vertices,  # (V, 3)
        faces,  # (F, 3) integers
    ):
        import open3d as o3d

        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(_tensor(vertices, np.float32), _tensor(faces, np.uint32))

    def occluded(self, rays, far=np.inf):
        """Whether anything hides the rays up to `far` lengths of their directions: (...) bool."""
        return self._scene.test_occlusions(_tensor(rays, np.float32), tfar=far).numpy()

    def first_hits(self, rays):
        """What the rays meet first: Hits."""
        hits = self._scene.cast_rays(_tensor(rays, np.float32))
        faces = hits["primitive_ids"].numpy().view(np.int32)  # open3d's mark for "none" is 2^32 - 1
        return Hits(hits["t_hit"].numpy(), faces, hits["primitive_uvs"].numpy(), hits["primitive_normals"].numpy())

    def closest(self, points):
        """The points of the surface that are closest to points (N, 3): Closest."""
        found = self._scene.compute_closest_points(_tensor(points, np.float32))
        faces = found["primitive_ids"].numpy().view(np.int32)
        return Closest(found["points"].numpy(), faces, found["primitive_uvs"].numpy())


def _tensor(array, dtype):
    import open3d as o3d

    return o3d.core.Tensor.from_numpy(np.ascontiguousarray(array, dtype))
