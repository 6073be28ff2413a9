"""Colour of each vertex in the rendered views, and the thickness of the surface there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..base.arrays import ColorsSrgb, DepthMap, Directions, Floats, Indices, Points
from ..render.view import View
from ..scene.color import bytes_from_unit

DEPTH_TOLERANCE = 0.01
"""Largest distance of a seen vertex behind the rendered depth, in units of the mesh's radius."""


@dataclass(frozen=True)
class RenderedPicture:
    """The kept arrays of a rendered view.

    color: (H, W, 3) uint8 sRGB, over its own alpha. depth: (H, W) float32 camera z, NaN where empty.
    thickness: (H, W) float32 of the surface along its normal, world units, NaN where unknown.
    """

    view: View
    color: np.ndarray
    depth: np.ndarray
    thickness: np.ndarray

    @classmethod
    def from_render(cls, view: View, color: Floats, depth: DepthMap, thickness: Floats) -> "RenderedPicture":
        """Keep a view's color (H, W, 3), sRGB in [0, 1], depth and thickness."""
        return cls(view, bytes_from_unit(color), depth, thickness.astype(np.float32))


def vertex_colors(vertices: Points, normals: Directions, pictures: Sequence[RenderedPicture]) -> tuple[ColorsSrgb, int]:
    """Average the pictures over the vertices they see, in sRGB, weighted by how frontally they see them.

    vertices, normals: (V, 3) float32 in the frame of the pictures' views.
    Returns (V, 3) uint8 sRGB and the number of vertices that no picture saw: they take the colour of their nearest
    neighbour that was seen, or mid grey when none was.
    """
    total, weights = np.zeros((len(vertices), 3)), np.zeros(len(vertices))
    for picture in pictures:
        visible, columns, rows, frontal = _sees(picture, vertices, normals)
        total[visible] += frontal[:, None] * picture.color[rows, columns]
        weights[visible] += frontal
    seen = weights > 0
    colors = np.full((len(vertices), 3), 128, np.uint8)
    colors[seen] = np.round(total[seen] / weights[seen, None]).astype(np.uint8)
    if seen.any() and not seen.all():
        colors[~seen] = colors[seen][scipy.spatial.cKDTree(vertices[seen]).query(vertices[~seen])[1]]
    return colors, int((~seen).sum())


def vertex_thickness(
    vertices: Points, normals: Directions, pictures: Sequence[RenderedPicture], pixel: float
) -> Floats:
    """Thickness of the surface at each vertex, (V,) float64 in world units, inf where no picture sees it.

    A mean over the pictures that trusts the thinnest most; `pixel`, the size of a training pixel, is its scale.
    """
    total, weights = np.zeros(len(vertices)), np.zeros(len(vertices))
    for picture in pictures:
        visible, columns, rows, frontal = _sees(picture, vertices, normals)
        thickness = picture.thickness[rows, columns]
        known = np.isfinite(thickness)
        trust = frontal[known] / (thickness[known] / pixel + 0.1) ** 2
        total[visible[known]] += trust * thickness[known]
        weights[visible[known]] += trust
    return np.divide(total, weights, out=np.full(len(vertices), np.inf), where=weights > 0)


def _sees(picture: RenderedPicture, vertices: Points, normals: Directions) -> tuple[Indices, Indices, Indices, Floats]:
    """Vertices that a picture shows, their pixels (column, row), and the square of the cosine it sees them at."""
    if len(vertices) == 0:  # no extent either
        return np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0)
    view, tolerance = picture.view, DEPTH_TOLERANCE * np.linalg.norm(np.ptp(vertices, axis=0)) / 2
    pixels, z = view.project(vertices)
    inside = (pixels >= 0).all(axis=1) & (pixels < [view.width, view.height]).all(axis=1)
    near = np.flatnonzero((z > 0) & inside)
    columns, rows = pixels[near].astype(np.intp).T
    towards = view.center - vertices[near]
    frontal = (normals[near] * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
    keep = (np.abs(z[near] - picture.depth[rows, columns]) < tolerance) & (frontal > 0.05)
    return near[keep], columns[keep], rows[keep], frontal[keep] ** 2
