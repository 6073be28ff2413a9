"""Which side of an object is brighter: a hint at the up direction where there is no other."""

import numpy as np

from ..base.arrays import Vector
from ..base.sphere import level_directions
from ..render.rasterize import rasterize
from ..render.view import View
from ..splats.splats import Splats
from .viewpoints import OUTER_FOV_DEG, bounds_of, corners_of, thinned

SIDES, ELEVATION_DEG = 6, 40.0
"""Views around, and how far each looks down or up."""

PIXELS = 64

SURROUNDINGS_FROM = 3.0
"""Distance from the middle, over the median one, beyond which splats are surroundings and ignored."""

CLEAR = 1.08
"""Brightness of one side over the other that says something: 1.13 to 1.91 in six captures and 32 generated objects, all
brighter from above."""


def brightness_from_above(splats: Splats, up: Vector) -> float:
    """The brightness of a splat from above over that from below: the ratio of mean display values. 1 for black. splats:
    cleaned Splats. up: (3,) unit, the side to call above, in their frame."""
    away = np.linalg.norm(splats.means - np.median(splats.means, axis=0), axis=1)
    splats = thinned(splats.take(np.flatnonzero(away <= SURROUNDINGS_FROM * np.median(away))), np.random.default_rng(0))
    corners = corners_of(bounds_of(splats))
    level = np.cos(np.radians(ELEVATION_DEG))
    seen = []
    for sign in (1.0, -1.0):
        values = []
        for direction in level_directions(up, SIDES):
            backward = level * direction + sign * np.sin(np.radians(ELEVATION_DEG)) * up
            view = View.look_at(backward, np.zeros(3), up, OUTER_FOV_DEG, PIXELS).holding(corners)
            picture = rasterize(splats, view)
            solid = picture.alpha > 0.5
            if solid.any():
                values.append(np.clip(picture.color[solid], 0.0, 1.0).mean(dtype=np.float64))
        seen.append(np.mean(values) if values else 0.0)
    above, below = seen
    return float(above / below) if below > 0.0 and above > 0.0 else 1.0


def describe_brightness(splats: Splats, up: Vector) -> str:
    """The same in words, to follow the chosen up direction; "" where it is no hint."""
    ratio = brightness_from_above(splats, up)
    if ratio >= CLEAR:
        return f", and {ratio:.2g} times brighter from above"
    if ratio <= 1.0 / CLEAR:
        return f"; but {1.0 / ratio:.2g} times brighter from below, so it may be upside down: check the preview"
    return ""
