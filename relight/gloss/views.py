"""Pictures from likely positions of the capture: elsewhere harmonics are meaningless and show false gloss."""

import numpy as np

from splat2mesh.scene.scene import Scene

from ..splats.binding import Binding
from ..splats.looks import Looks


def outer_looks(binding: Binding, scene: Scene) -> Looks | None:
    """The looks of a Binding; of an object those from above its middle alone, since captures seldom look up."""
    looks = binding.looks
    if scene.is_place or looks is None:
        return looks
    points = binding.surface.points[binding.surface.used].astype(np.float64)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    above = (looks.eyes - middle) @ np.asarray(scene.scene_from_splat, np.float64)[1, :3] > 0.0
    return looks.at_pixels(above[looks.view_of])
