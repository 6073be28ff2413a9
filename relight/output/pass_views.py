"""Cameras of a capture in the frame of the scene made from it."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from splat2mesh.render.view import View


def moved_view(view: View, matrix: ArrayLike) -> View:
    """A View that shows a scene as `view` showed it before its points were moved by a similarity (4, 4)."""
    moved = np.asarray(view.camera_from_world, np.float64) @ np.linalg.inv(np.asarray(matrix, np.float64))
    scale = float(np.cbrt(np.linalg.det(moved[:3, :3])))
    moved[:3] /= scale  # all grows alike from the eye on
    return replace(view, camera_from_world=moved)
