"""Pictures from likely positions of the capture: elsewhere harmonics are meaningless and show false gloss."""

import numpy as np

from splat2mesh.render.view import View
from splat2mesh.scene.scene import Scene
from splat2mesh.views.viewpoints import OUTER_FOV_DEG, even_directions

from ..splats.binding import PIXELS, Binding
from ..splats.looks import Looks

VIEWS = 24
"""Number of views of an object: 40 have .03 dB less over the glossy pixels of a trained table, in two lights."""


def outer_looks(binding: Binding, scene: Scene) -> Looks | None:
    """Looks at an object from VIEWS places above the horizon; of a place all those of its Binding, from where the
    capture stood."""
    if scene.is_place or binding.looks is None:
        return binding.looks
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    up = matrix[1, :3] / np.linalg.norm(matrix[1, :3])
    points = binding.surface.points[binding.surface.used].astype(np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    center, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    distance = radius / np.sin(np.radians(OUTER_FOV_DEG) / 2)  # the whole just fits in
    every = even_directions(2 * VIEWS)
    above = center + distance * every[every @ up > 0.0]
    return binding.looks_at([View.look_at(eye, center, up, OUTER_FOV_DEG, PIXELS) for eye in above])
