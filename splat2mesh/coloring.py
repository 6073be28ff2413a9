"""Vertex colours, averaged over the rendered views that see each vertex."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from .color import bytes_from_unit
from .view import View

DEPTH_TOLERANCE = 0.01
"""How far behind the rendered depth a vertex may lie and still count as seen, in units of the mesh's radius."""


@dataclass(frozen=True)
class Picture:
    """What is kept of a rendered view.

    color: (H, W, 3) uint8 sRGB, over its own alpha. depth: (H, W) float32 camera z, NaN where empty.
    """

    view: View
    color: np.ndarray
    depth: np.ndarray

    @classmethod
    def of(cls, view, color, depth):
        """Keep a view's color (H, W, 3), sRGB in [0, 1], and depth."""
        return cls(view, bytes_from_unit(color), depth)


def vertex_colors(vertices, normals, pictures):
    """Average the pictures over the vertices they see, in sRGB, weighted by how frontally they see them.

    vertices, normals: (V, 3) float32 in the frame of the pictures' views.
    Returns (V, 3) uint8 sRGB and the number of vertices that no picture saw: they take the colour of their nearest
    neighbour that was seen, or mid grey when none was.
    """
    tolerance = DEPTH_TOLERANCE * np.linalg.norm(np.ptp(vertices, axis=0)) / 2
    total, weights = np.zeros((len(vertices), 3)), np.zeros(len(vertices))
    for picture in pictures:
        visible, columns, rows, frontal = _sees(picture, vertices, normals, tolerance)
        total[visible] += frontal[:, None] * picture.color[rows, columns]
        weights[visible] += frontal
    seen = weights > 0
    colors = np.full((len(vertices), 3), 128, np.uint8)
    colors[seen] = np.round(total[seen] / weights[seen, None]).astype(np.uint8)
    if seen.any() and not seen.all():
        colors[~seen] = colors[seen][cKDTree(vertices[seen]).query(vertices[~seen])[1]]
    return colors, int((~seen).sum())


def _sees(picture, vertices, normals, tolerance):
    view = picture.view
    pixels, z = view.project(vertices)
    inside = (pixels >= 0).all(axis=1) & (pixels < [view.width, view.height]).all(axis=1)
    near = np.flatnonzero((z > 0) & inside)
    columns, rows = pixels[near].astype(np.intp).T
    towards = view.center - vertices[near]
    frontal = (normals[near] * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
    keep = (np.abs(z[near] - picture.depth[rows, columns]) < tolerance) & (frontal > 0.05)
    return near[keep], columns[keep], rows[keep], frontal[keep] ** 2
