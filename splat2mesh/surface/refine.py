"""Vertices where the colour needs them: edges are split where the pictures show more than a linear blend."""

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Faces
from ..scene.mesh import edge_ends, edge_keys, halved, vertex_normals
from .album import Album

CONTRAST = 5.0
"""Difference, in 8-bit steps, between a blend of an edge's ends and the picture in its middle, below which it stays."""

SHORTEST_PIXELS = 2.0
"""Edges of less pixels of the best view are not split: there is nothing between them."""

SPLIT_ROUNDS = 3
"""Rounds in which edges are split."""


def refine_by_color(
    points: NDArray[np.float32], faces: Faces, album: Album, most: int
) -> tuple[NDArray[np.float32], Faces]:
    """Split edges until colours are straight along them: points (V, 3) float32 and faces (F, 3) int32 of a finer mesh.
    album: Album. most: vertices at most; the strongest contrasts come first. The surface stays where it is."""
    for _ in range(SPLIT_ROUNDS):
        room = most - len(points)
        if room <= 0:
            break
        normals = vertex_normals(points, faces)
        colors, _, pixel = album.look_up(points, normals)
        keys, of_face = np.unique(edge_keys(faces, len(points)), return_inverse=True)
        edges, of_face = edge_ends(keys, len(points)), of_face.reshape(-1, 3)
        a, b = edges.T
        length = np.linalg.norm(points[a] - points[b], axis=1)
        long = np.flatnonzero(length > SHORTEST_PIXELS * np.minimum(pixel[a], pixel[b]))
        a, b = a[long], b[long]
        middle, normal = (points[a] + points[b]) / 2, normals[a] + normals[b]
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
        shown = album.look_up(middle, normal)[0]
        contrast = np.abs(shown - (colors[a] + colors[b]) / 2).max(axis=1)
        contrast = np.where(np.isfinite(contrast), contrast, 0)
        chosen = long[contrast > CONTRAST]
        if len(chosen) > room:
            order = np.argsort(-contrast[contrast > CONTRAST], kind="stable")
            chosen = np.sort(chosen[order[:room]])
        if len(chosen) == 0:
            break
        cut = np.zeros(len(keys), bool)
        cut[chosen] = True
        corners, parents = halved(faces.astype(np.int64), cut[of_face], len(points))
        points, faces = np.concatenate([points, points[parents].mean(axis=1)]), corners.astype(np.int32)
    return points, faces
