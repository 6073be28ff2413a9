"""Small meshes and their measures."""

import numpy as np
import open3d as o3d


def sphere(radius=1.0, center=(0, 0, 0), resolution=60):
    mesh = o3d.geometry.TriangleMesh.create_sphere(radius, resolution)
    return mesh.translate(center)


def arrays(mesh):
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles)


def edges_and_uses(faces):
    """The undirected edges (E, 2), and how many faces use each."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return np.unique(edges, axis=0, return_counts=True)


def border_vertices(faces, count):
    """Which vertices have an edge of one face only: (count,) bool."""
    edges, uses = edges_and_uses(faces)
    return np.isin(np.arange(count), edges[uses == 1])


def sheet(columns, rows):
    """The faces of a flat grid of columns x rows vertices, row after row: (F, 3), seen from above."""
    index = np.arange(columns * rows).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def sheet_points(columns, rows):
    y, x = np.divmod(np.arange(columns * rows), columns)
    return np.stack([x, y, 0 * x], axis=1).astype(float)


def face_normals(vertices, faces):
    a, b, c = (vertices[faces[:, k]].astype(float) for k in range(3))
    return np.cross(b - a, c - a)


def slivered_sphere():
    """A sphere with pairs of vertices a millionth of an edge apart, as marching cubes leaves them: points, faces."""
    points, faces = (part.copy() for part in arrays(sphere()))
    for a, b, _ in faces[np.random.default_rng(0).choice(len(faces), 2000, replace=False)]:
        points[a] = points[b] + 1e-6 * (points[a] - points[b])
    return points, faces


def volume(points, faces):
    return np.einsum("ij,ij->", points[faces[:, 0]], face_normals(points, faces)) / 6
