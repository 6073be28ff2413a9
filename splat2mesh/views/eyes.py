"""Views all around from the places where a capture stood."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Vector
from ..base.sphere import GOLDEN_TURN, level_axes
from ..render.view import View

FOV_DEG = 92.0
"""Angle of each of the six views: a little over a cube's face, so that they overlap."""

NEAR = 0.3
"""Near plane of an eye, over its distance from the nearest surfaces."""

GOLDEN = 2 * np.pi * (1 - GOLDEN_TURN)
"""Each eye's cube is turned by this against the one before, so that their seams fall on different places."""


class Eye(NamedTuple):
    """A place to look around from. center: (3,) float64. near: camera z of the near plane."""

    center: NDArray[np.float64]
    near: float


def around(eyes: Sequence[Eye], pixels: int, up: Vector) -> tuple[list[View], NDArray[np.float64]]:
    """Six views from each Eye, and their near planes: list of View, (6 E,) float64. up: (3,) unit."""
    ahead, side = level_axes(up)
    views, near = [], []
    for turn, eye in enumerate(eyes):
        a = turn * GOLDEN
        front, right = np.cos(a) * ahead + np.sin(a) * side, np.cos(a) * side - np.sin(a) * ahead
        for direction, top in ((front, up), (-front, up), (right, up), (-right, up), (up, front), (-up, front)):
            views.append(View.look_at(eye.center, eye.center + direction, top, FOV_DEG, pixels))
            near.append(eye.near)
    return views, np.array(near)
