"""From a raw surface to a clean triangle mesh of a wanted size: components, holes, decimation, smoothing."""

import numpy as np
from scipy.sparse import csr_matrix

SMALLEST_COMPONENT = 0.02
"""Connected parts with fewer triangles than this share of the largest part's are floaters and are dropped."""

TAUBIN_STEPS = 40
"""Smoothing steps: the noise of the depth maps goes, size and folds stay."""

TAUBIN_SHRINK, TAUBIN_GROW = 0.5, -0.51
"""Taubin's factors of the two halves of a step; their pass band ends at 1 / 0.5 - 1 / 0.51 = 0.04."""


def drop_small_components(mesh):
    """Remove disconnected parts that are small beside the largest one; returns how many were removed."""
    cluster, sizes, _ = mesh.cluster_connected_triangles()
    cluster, sizes = np.asarray(cluster), np.asarray(sizes)
    small = sizes < SMALLEST_COMPONENT * sizes.max(initial=0)
    mesh.remove_triangles_by_mask(small[cluster])
    mesh.remove_unreferenced_vertices()
    return int(small.sum())


def fill_holes(mesh, longest):
    """Close the holes of an open3d mesh whose border is at most `longest` long; returns how many were closed.

    Each is closed by a fan around the middle of its border: pinholes and slits where views disagreed vanish, while
    what was never seen stays open. Borders that touch themselves are left alone.
    """
    import open3d as o3d

    points, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    starts, ends = _border_edges(faces, len(points))
    once = np.bincount(starts, minlength=len(points)) == 1
    following = np.full(len(points), -1)
    following[starts] = ends
    new_points, new_faces, done = [], [], np.zeros(len(points), bool)
    for start in starts:
        loop = []
        vertex = start
        while once[vertex] and not done[vertex]:
            done[vertex] = True
            loop.append(vertex)
            vertex = following[vertex]
        if vertex != start or len(loop) < 3:
            continue
        corners = points[loop]
        if np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum() > longest:
            continue
        middle = len(points) + len(new_points)
        new_points.append(corners.mean(axis=0))
        new_faces += [(after, before, middle) for before, after in zip(loop, [*loop[1:], loop[0]], strict=True)]
    if new_points:
        mesh.vertices = o3d.utility.Vector3dVector(np.concatenate([points, new_points]))
        mesh.triangles = o3d.utility.Vector3iVector(np.concatenate([faces, new_faces]).astype(np.int32))
    return len(new_points)


def _border_edges(faces, count):
    """Edges of one face only, in that face's direction: starts and ends, (E,) each."""
    starts, ends = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    forward, backward = starts.astype(np.int64) * count + ends, ends.astype(np.int64) * count + starts
    alone = ~np.isin(forward, backward)
    return starts[alone], ends[alone]


def decimate(mesh, vertices):
    """Quadric decimation of an open3d mesh to about `vertices` vertices, then smoothing and cleaning.

    Smoothing comes second: the triangles of a fresh isosurface are slivers, which smoothing would turn over.
    Returns vertices (V, 3) float32, unit normals (V, 3) float32 and faces (F, 3) int32, without degenerate faces and
    non-manifold edges.
    """
    import fast_simplification
    import open3d as o3d

    points, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles).astype(np.int32)
    if len(points) > vertices:
        # Centred and of unit size, so that float32 suffices wherever the scene lies.
        center, size = points.mean(axis=0), max(np.ptp(points, axis=0).max(), 1e-300)
        target = max(int(len(faces) * vertices / len(points)), 4)
        unit = ((points - center) / size).astype(np.float32)
        for haste in (3, 5, 8):  # gentle first: the hastier, the more triangles turn over
            if len(faces) > target:
                unit, faces = fast_simplification.simplify(unit, faces, target_count=target, agg=haste)
        points = unit.astype(np.float64) * size + center
    points = smooth(points, faces, TAUBIN_STEPS)
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


def smooth(points, faces, steps):
    """Taubin smoothing with equal weights and fixed borders: (V, 3) float64 and (F, 3) -> (V, 3) float64.

    Equal weights also even out the triangles; weights by distance, as libraries use them, turn slivers over.
    Source: Taubin, "A Signal Processing Approach to Fair Surface Design" (1995).
    """
    corners = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ends = np.concatenate([corners, corners[:, ::-1]])
    uses = csr_matrix((np.ones(len(ends)), ends.T), (len(points), len(points)))
    uses.sum_duplicates()
    border = np.repeat(np.arange(len(points)), np.diff(uses.indptr))[uses.data == 1]
    neighbors = csr_matrix((np.ones_like(uses.data), uses.indices, uses.indptr), uses.shape)
    count = np.maximum(np.diff(neighbors.indptr), 1)[:, None]
    points = points.copy()
    for _ in range(steps):
        for factor in (TAUBIN_SHRINK, TAUBIN_GROW):
            pull = neighbors @ points / count - points
            pull[border] = 0.0
            points += factor * pull
    return points
