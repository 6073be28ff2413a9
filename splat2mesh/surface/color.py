"""Colour of each vertex in the rendered views, and the thickness of the surface there."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..base.arrays import ColorsSrgb, DepthMap, Directions, Floats, Indices, Points, Vector
from ..base.kernels import kernel
from ..base.threads import in_slices, read_only
from ..render.view import View
from ..scene.color import bytes_from_unit
from .sight import LEAST_COSINE

DEPTH_TOLERANCE = 0.01
"""Largest distance of a seen vertex behind the rendered depth, in units of the mesh's radius."""

GREY = bytes_from_unit(0.5)
"""Colour where no view looked."""


@dataclass(frozen=True)
class RenderedPicture:
    """The kept arrays of a rendered view. color: (H, W, 3) uint8 sRGB, over its own alpha. depth: (H, W) float32 camera
    z, NaN where empty. thickness: (H, W) float32 of the surface along its normal, world units, NaN where unknown."""

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
    colors = np.full((len(vertices), 3), GREY, np.uint8)
    colors[seen] = np.round(total[seen] / weights[seen, None]).astype(np.uint8)
    if seen.any() and not seen.all():
        colors[~seen] = colors[seen][scipy.spatial.cKDTree(vertices[seen]).query(vertices[~seen])[1]]
    return colors, int((~seen).sum())


def vertex_thickness(
    vertices: Points, normals: Directions, pictures: Sequence[RenderedPicture], pixel: float
) -> Floats:
    """Thickness of the surface at each vertex, (V,) float64 in world units, inf where no picture sees it. A mean over
    the pictures that trusts the thinnest most; `pixel`, the size of a training pixel, is its scale."""
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
    view, tolerance = picture.view, DEPTH_TOLERANCE * float(np.linalg.norm(np.ptp(vertices, axis=0))) / 2
    pixels, frontal = np.empty(len(vertices), np.int64), np.empty(len(vertices))
    lens = np.array([view.fx, view.fy, view.cx, view.cy])
    pose = np.ascontiguousarray(view.camera_from_world[:3], np.float64), np.ascontiguousarray(view.center, np.float64)
    seen = read_only(vertices, np.float64), read_only(normals), read_only(picture.depth)
    in_slices(_look_up, len(vertices), *seen, *pose, lens, tolerance, pixels, frontal)
    visible = np.flatnonzero(pixels >= 0)
    rows, columns = np.divmod(pixels[visible], view.width)
    return visible, columns, rows, frontal[visible] ** 2


@kernel
def _look_up(
    begin: int,
    end: int,
    vertices: Points,
    normals: Directions,
    depth: Floats,
    matrix: Floats,
    center: Vector,
    lens: Vector,
    tolerance: float,
    pixels: Indices,
    frontal: Floats,
) -> None:
    """Write the pixel, row after row, in which each vertex is seen, -1 for none, and the cosine at which. matrix:
    (3, 4) camera from world. lens: fx, fy, cx, cy."""
    height, width = depth.shape
    for v in range(begin, end):
        pixels[v] = -1
        px, py, pz = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        z = px * matrix[2, 0] + py * matrix[2, 1] + pz * matrix[2, 2] + matrix[2, 3]
        if not z > 0:
            continue
        x = px * matrix[0, 0] + py * matrix[0, 1] + pz * matrix[0, 2] + matrix[0, 3]
        y = px * matrix[1, 0] + py * matrix[1, 1] + pz * matrix[1, 2] + matrix[1, 3]
        column, row = x / z * lens[0] + lens[2], y / z * lens[1] + lens[3]
        if not (0 <= column < width and 0 <= row < height):
            continue
        if not abs(z - depth[int(row), int(column)]) < tolerance:
            continue
        tx, ty, tz = center[0] - px, center[1] - py, center[2] - pz
        cosine = (normals[v, 0] * tx + normals[v, 1] * ty + normals[v, 2] * tz) / math.sqrt(tx * tx + ty * ty + tz * tz)
        if cosine > LEAST_COSINE:
            pixels[v], frontal[v] = int(row) * width + int(column), cosine
