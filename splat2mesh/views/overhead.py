"""The ceiling of a room: whether a mesh is open there while its splats are opaque, and the views that would close it.

A photographer looks down and ahead, and a mesh from cameras alone is open where none of them looked. Under a ceiling
that matters most: the sky is bright, and in a room its light passes for that of the windows.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Directions, Faces, Floats, Points, Vector
from ..render.raycaster import RayCaster
from ..render.view import View
from .eyes import Eye, around

UP_LEAST = 0.5
"""Least sine of a line's elevation at which it looks at the ceiling: lower lines pass through windows."""

PAST = 1.5
"""How far past the opaque splats, as a multiple of the way to them, a line must stay free of the mesh to be a leak:
where the mesh has no ceiling, the line may still meet the house opposite."""

MOST_LEAK = 0.0125
"""Share of the lines that leak, up to which a ceiling counts as closed: .003 in lounges, .052 in a trained parlour."""


class Overhead(NamedTuple):
    """Lines of sight from a room's free places to its ceiling, and the eyes that see it. lines: (L, 6) float32, each an
    origin and the way to where the splats are opaque, splat frame. eyes: list of Eye. up: (3,) unit."""

    lines: NDArray[np.float32]
    eyes: Sequence[Eye]
    up: Vector

    @classmethod
    def of(cls, points: Points, directions: Directions, met: Floats, up: Vector, eyes: Sequence[Eye]) -> "Overhead":
        """From rays of M points (M, 3) in K unit directions: how far away each met the foreground, (M, K), or NaN."""
        rising = np.flatnonzero(directions @ up > UP_LEAST)
        point, ray = np.nonzero(np.isfinite(met[:, rising]))
        ray = rising[ray]
        way = met[point, ray, None] * directions[ray]
        return cls(np.hstack([points[point], way]).astype(np.float32), eyes, up)

    def leak(self, points: Points, faces: Faces) -> float:
        """Share of the lines that a mesh (V, 3), (F, 3) lets pass; 0 without lines or mesh."""
        if len(self.lines) == 0 or len(faces) == 0:
            return 0.0
        return float(1.0 - RayCaster(points, faces).occluded(self.lines, PAST).mean())

    def views(self, pixels: int) -> tuple[list[View], Floats]:
        """The six views from each eye, and their near planes: those that look up alone closed half as much."""
        return around(self.eyes, pixels, self.up)
