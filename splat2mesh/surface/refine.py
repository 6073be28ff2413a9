"""Vertices where the colour needs them: edges are split where the pictures show more than a linear blend."""

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Faces, Integers, Points
from ..scene.mesh import edge_ends, edge_keys, vertex_normals
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
        number = np.full(len(edges), -1, np.int64)
        number[chosen] = len(points) + np.arange(len(chosen))
        ends = edges[chosen]
        points = np.concatenate([points, (points[ends[:, 0]] + points[ends[:, 1]]) / 2])
        faces = _split(points, faces, number[of_face])
    return points, faces


def _split(points: Points, faces: Faces, middles: Integers) -> Faces:
    """Faces cut at the middles of their edges, (F, 3) vertices or -1; the middle of edge k lies after corner k."""
    cut = middles >= 0
    count = cut.sum(axis=1)
    out = [faces[count == 0]]
    for k in range(3):  # one edge: two faces
        rows = (count == 1) & cut[:, k]
        a, b, c = (faces[rows, (k + i) % 3] for i in range(3))
        m = middles[rows, k]
        out += [np.stack([a, m, c], axis=1), np.stack([m, b, c], axis=1)]
    for k in range(3):  # all but edge k: three faces, the four corners cut along the shorter diagonal
        rows = (count == 2) & ~cut[:, k]
        a, b, c = (faces[rows, (k + i) % 3] for i in range(3))
        m, n = middles[rows, (k + 1) % 3], middles[rows, (k + 2) % 3]
        first = np.linalg.norm(points[a] - points[m], axis=1) < np.linalg.norm(points[b] - points[n], axis=1)
        out.append(np.stack([m, c, n], axis=1))
        out.append(np.where(first[:, None], np.stack([a, b, m], axis=1), np.stack([a, b, n], axis=1)))
        out.append(np.where(first[:, None], np.stack([a, m, n], axis=1), np.stack([b, m, n], axis=1)))
    rows = count == 3
    (a, b, c), (m, n, o) = faces[rows].T, middles[rows].T
    out += [np.stack(corners, axis=1) for corners in ((a, m, o), (m, b, n), (o, n, c), (m, n, o))]
    return np.concatenate(out).astype(np.int32)
