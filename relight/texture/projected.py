"""The colour of a splat at the texels of a mesh: pictures of the splat projected onto it and averaged.

A mesh with few faces passes above and below the surface of the splat. A picture shows what the eye sees at a texel, so
the mean of many looks right from everywhere, and the needles that training leaves average out. Draw the splats as wide
as training saw them: with the widths of the file, close views show gaps between them.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Faces, Floats, Indices, Mask, Points
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.surface.background import far_background, views_from_within
from splat2mesh.surface.extract import EFFORTS, as_trained, dilated
from splat2mesh.views.viewpoints import bounds_of, near_plane, virtual_views

if TYPE_CHECKING:
    from splat2mesh.render.rasterize import Rendering
    from splat2mesh.render.view import View
    from splat2mesh.scene.scene import Scene
    from splat2mesh.splats.splats import Splats

PIXELS = 256, 1024
"""Range of the longer side of a picture, in which a pixel is about as wide as a texel."""

MIN_COSINE = 0.05
"""Ignore pictures that see a texel at a flatter angle. Weights are the squared cosine and leave distance out: else the
few views from within outweigh all others, which costs 1.0 dB on an object and 1.7 dB on a guitar."""

DEPTH_TOLERANCE = 0.02
"""Largest depth difference, in diagonals, between picture and texel; beyond it, the picture shows another surface."""

_STEP = 1e-3  # of the diagonal: rays to the eye begin off their own face
_BATCH = 1 << 20


def views_of(scene: "Scene", splats: "Splats", texel: float, seed: int = 0) -> "tuple[Splats, list[View]]":
    """The splats to draw, as wide as training saw them, and the views to draw them from: the views that `splat2mesh`
    takes of the foreground, and more for a far background that was kept. texel: width of one, in the splats' unit."""
    far = far_background(splats)
    foreground, pixel = as_trained(splats.take(np.flatnonzero(~far)))
    up = np.asarray(scene.scene_from_splat, np.float64)[1, :3]
    up = up / np.linalg.norm(up)
    pixels = int(np.clip(np.linalg.norm(np.ptp(bounds_of(foreground), axis=0)) / texel, *PIXELS))
    views = virtual_views(foreground, EFFORTS["normal"].views, pixels, up, seed)
    if far.any() and scene.settings.get("background") == "keep":
        return dilated(splats, pixel), views + views_from_within(foreground, pixels, up)
    return foreground, views


def seen_colors(
    splats: "Splats",
    views: "list[View]",
    vertices: Points,
    faces: Faces,
    points: Points,
    normals: Directions,
    advance: Callable[[int], Any] = lambda count: None,
) -> tuple[NDArray[np.float32], Mask]:
    """Mean colour that views of splats show at points of a mesh, sRGB (T, 3) float32, and whether any does, (T,) bool.

    vertices (V, 3), faces (F, 3), points (T, 3), normals (T, 3) unit: in the splats' frame. Points that no view shows
    are black. advance is called after each view.
    """
    caster = RayCaster(vertices, faces)
    diagonal = float(np.linalg.norm(np.ptp(vertices[faces], axis=(0, 1))))
    near = near_plane(bounds_of(splats))
    total, weights = np.zeros((len(points), 3), np.float32), np.zeros(len(points), np.float32)
    for view in views:
        rendering = rasterize(splats, view, near)
        for start in range(0, len(points), _BATCH):
            part = slice(start, start + _BATCH)
            rows, pixels, weight = _shown(view, rendering, caster, points[part], normals[part], diagonal)
            color = _bilinear(rendering.color, pixels) / np.maximum(_bilinear(rendering.alpha[..., None], pixels), 1e-3)
            total[start + rows] += weight[:, None] * color
            weights[start + rows] += weight
        advance(1)
    seen = weights > 0.0
    total[seen] /= weights[seen, None]
    return total, seen


def _shown(
    view: "View", rendering: "Rendering", caster: RayCaster, points: Points, normals: Directions, diagonal: float
) -> tuple[Indices, Floats, Floats]:
    """Points that a rendering shows: indices (N,), pixels (N, 2) from the centre of the first one, and weights."""
    towards = view.center.astype(np.float32) - points
    distance = np.linalg.norm(towards, axis=1)
    cosine = np.einsum("tc,tc->t", towards, normals) / np.maximum(distance, 1e-30)
    rows = np.flatnonzero(cosine > MIN_COSINE)
    pixels, depth = view.project(points[rows])
    pixels -= 0.5
    inside = (depth > 0.0) & (pixels >= 0.0).all(axis=1) & (pixels < [view.width - 1, view.height - 1]).all(axis=1)
    rows, pixels, depth = rows[inside], pixels[inside], depth[inside]
    column, row = np.floor(pixels).astype(np.intp).T
    there = np.ones(len(rows), bool)
    for across, down in ((0, 0), (1, 0), (0, 1), (1, 1)):  # all four must show this surface, or colours mix
        apart = rendering.depth_median[row + down, column + across] - depth
        there &= np.abs(apart) < DEPTH_TOLERANCE * diagonal
    rows, pixels = rows[there], pixels[there]
    rays = np.concatenate([points[rows] + np.float32(_STEP * diagonal) * normals[rows], towards[rows]], axis=1)
    free = ~caster.occluded(rays, far=0.999)
    rows = rows[free]
    return rows, pixels[free], cosine[rows] ** 2


def _bilinear(image: NDArray[np.float32], places: Floats) -> NDArray[np.float32]:
    """Interpolate an image (H, W, C) at places (N, 2), measured from the centre of its first pixel: (N, C) float32."""
    low = np.floor(places).astype(np.intp)
    x, y = (places - low).astype(np.float32).T[..., None]
    column, row = low.T
    above = image[row, column] * (1 - x) + image[row, column + 1] * x
    below = image[row + 1, column] * (1 - x) + image[row + 1, column + 1] * x
    return above * (1 - y) + below * y
