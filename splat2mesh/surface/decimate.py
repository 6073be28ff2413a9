"""A mesh with fewer vertices: quadric decimation, and the removal of its defects."""

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Faces, Integers, Points
from ..base.meshlibrary import open3d


def decimate(points: Points, faces: Integers, vertices: int) -> tuple[NDArray[np.float64], Faces]:
    """Quadric decimation of a mesh, points (V, 3) and faces (F, 3), to about `vertices` vertices, and cleaning. Returns
    vertices (V, 3) float64 and faces (F, 3) int32, without degenerate faces and non-manifold edges."""
    import fast_simplification

    o3d = open3d()

    faces = faces.astype(np.int32)
    if len(points) > vertices:
        # Centred and of unit size, so that float32 suffices wherever the scene lies.
        center, size = points.mean(axis=0), max(np.ptp(points, axis=0).max(), 1e-300)
        target = max(int(len(faces) * vertices / len(points)), 4)
        unit = ((points - center) / size).astype(np.float32)
        for haste in (3, 5, 8):  # gentle first: the hastier, the more triangles turn over
            if len(faces) > target:
                unit, faces = fast_simplification.simplify(unit, faces, target_count=target, agg=haste)
        points = unit.astype(np.float64) * size + center
    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(points), o3d.utility.Vector3iVector(faces))
    mesh.remove_duplicated_triangles()
    mesh.remove_degenerate_triangles()
    mesh.remove_non_manifold_edges()
    mesh.remove_unreferenced_vertices()
    return np.asarray(mesh.vertices).copy(), np.asarray(mesh.triangles).astype(np.int32)
