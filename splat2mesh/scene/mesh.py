"""A triangle mesh as arrays."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh with one normal and one colour per vertex.

    vertices: (V, 3) float32. normals: (V, 3) float32, unit, or zero where undefined.
    faces: (F, 3) int32, counter-clockwise seen from outside. colors_srgb: (V, 3) uint8.
    """

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    colors_srgb: np.ndarray


def vertex_normals(points, faces):
    """Unit normals (V, 3) float32, by the angle-free mean of the face normals that open3d takes."""
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(points), o3d.utility.Vector3iVector(faces))
    mesh.compute_vertex_normals()
    return np.asarray(mesh.vertex_normals).astype(np.float32)
