"""Pictures from likely positions of the capture: elsewhere harmonics are meaningless and show false gloss."""

import numpy as np

from splat2mesh.base.arrays import Directions
from splat2mesh.render.view import View
from splat2mesh.scene.scene import Scene
from splat2mesh.views.viewpoints import OUTER_FOV_DEG, even_directions

from ..splats.binding import PIXELS, Binding
from ..splats.looks import Looks

GLANCE = 16
"""Views that are examined first and show whether anything may be glossy."""

VIEWS = 40
"""Number of views of an object: 64, or 384 pixels, show no more of the light."""


def outer_looks(binding: Binding, scene: Scene, part: slice = slice(None)) -> Looks | None:
    """Looks at an object from VIEWS places above the horizon, or from a part of them, of which the first stand far
    apart; of a place all those of its Binding, from where the capture stood."""
    if scene.is_place or binding.looks is None:
        return binding.looks
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    up = matrix[1, :3] / np.linalg.norm(matrix[1, :3])
    points = binding.surface.points[binding.surface.used].astype(np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    center, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    distance = radius / np.sin(np.radians(OUTER_FOV_DEG) / 2)  # the whole just fits in
    every = even_directions(2 * VIEWS)
    directions = _far_apart_first(every[every @ up > 0.0])[part]
    views = [View.look_at(center + distance * each, center, up, OUTER_FOV_DEG, PIXELS) for each in directions]
    return binding.looks_at(views)


def _far_apart_first(directions: Directions) -> Directions:
    """Directions in an order in which each is as far as can be from all before it."""
    order = [0]
    nearest = np.asarray(directions @ directions[0], np.float64)
    while len(order) < len(directions):
        order.append(int(nearest.argmin()))
        nearest = np.asarray(np.maximum(nearest, directions @ directions[order[-1]]), np.float64)
    return directions[order]
