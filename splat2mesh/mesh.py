"""From a raw surface to a clean triangle mesh of a wanted size: components, smoothing, decimation."""

import numpy as np

SMALLEST_COMPONENT = 0.02
"""Connected parts with fewer triangles than this share of the largest part's are floaters and are dropped."""

TAUBIN_STEPS = 10
"""Smoothing that takes away the noise of the surface without shrinking the surface."""


def drop_small_components(mesh):
    """Remove disconnected parts that are small beside the largest one; returns how many were removed."""
    cluster, sizes, _ = mesh.cluster_connected_triangles()
    cluster, sizes = np.asarray(cluster), np.asarray(sizes)
    small = sizes < SMALLEST_COMPONENT * sizes.max(initial=0)
    mesh.remove_triangles_by_mask(small[cluster])
    mesh.remove_unreferenced_vertices()
    return int(small.sum())


def decimate(mesh, vertices):
    """Quadric decimation of an open3d mesh to about `vertices` vertices, cleaned of degenerate and non-manifold parts.

    Returns vertices (V, 3) float32, unit normals (V, 3) float32 and faces (F, 3) int32.
    """
    import fast_simplification
    import open3d as o3d

    mesh = mesh.filter_smooth_taubin(TAUBIN_STEPS)
    points, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    if len(points) > vertices:
        center, size = points.mean(axis=0), max(np.ptp(points, axis=0).max(), 1e-300)
        target = max(int(len(faces) * vertices / len(points)), 4)
        unit = ((points - center) / size).astype(np.float32)
        unit, faces = fast_simplification.simplify(unit, faces.astype(np.int32), target_count=target, agg=5)
        points = unit.astype(np.float64) * size + center
    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(points), o3d.utility.Vector3iVector(faces))
    mesh.remove_duplicated_triangles()
    mesh.remove_degenerate_triangles()
    mesh.remove_non_manifold_edges()
    mesh.remove_unreferenced_vertices()
    mesh.compute_vertex_normals()
    return (
        np.asarray(mesh.vertices).astype(np.float32),
        np.asarray(mesh.vertex_normals).astype(np.float32),
        np.asarray(mesh.triangles).astype(np.int32),
    )
