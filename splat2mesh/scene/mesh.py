"""A triangle mesh as arrays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh with one normal and one colour per vertex.

    vertices: (V, 3) float32. normals: (V, 3) float32, unit, or zero where undefined.
    faces: (F, 3) int32, counter-clockwise seen from outside. colors_srgb: (V, 3) uint8.
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    faces: NDArray[np.int32]
    colors_srgb: NDArray[np.uint8]


def vertex_normals(points: ArrayLike, faces: ArrayLike) -> NDArray[np.float32]:
    """Unit normals (V, 3) of points (V, 3) and faces (F, 3): the mean of the face normals, as open3d takes it."""
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(points), o3d.utility.Vector3iVector(faces))
    mesh.compute_vertex_normals()
    return np.asarray(mesh.vertex_normals).astype(np.float32)
