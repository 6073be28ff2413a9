"""Whether points lie within a closed mesh: an oracle of its own, by open3d."""

import numpy as np
import open3d as o3d


def inside(vertices, faces, points):
    """(N,) bool, of points (N, 3)."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(*(np.ascontiguousarray(a, t) for a, t in ((vertices, np.float32), (faces, np.uint32))))
    return scene.compute_occupancy(np.ascontiguousarray(points, np.float32), nsamples=3).numpy() > 0.5
