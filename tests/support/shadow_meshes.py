"""Meshes that shadow themselves, as arrays that an Occluder takes."""

import numpy as np
import open3d as o3d


def mesh_arrays(mesh):
    """(vertices, normals, faces) of an open3d mesh."""
    mesh.compute_vertex_normals()
    normals = np.asarray(mesh.vertex_normals, np.float32)
    return np.asarray(mesh.vertices, np.float32), normals, np.asarray(mesh.triangles, np.int32)


def knobbed_torus(rings, sides, knob, knob_resolution):
    """A torus with a ball in its hole: every degree of occlusion."""
    mesh = o3d.geometry.TriangleMesh.create_torus(1.0, 0.5, rings, sides)
    return mesh_arrays(mesh + o3d.geometry.TriangleMesh.create_sphere(knob, knob_resolution))
