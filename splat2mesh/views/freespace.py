"""The free space that the standpoints of a capture see: where else a view of the same place may stand.

A view from under the ground sees the back of its splats, and fusion makes a second surface of it. No line of sight leads
there from where people stood, but lines lead over walls, roofs and trees.
"""

from collections.abc import Sequence

import numpy as np

from ..base.arrays import Bounds, Mask, Points
from ..render.opacitygrid import OpacityGrid
from ..splats.splats import Splats
from .eyes import Eye

CELLS = 100_000
"""Cells of each grid: sides of a hundredth of the diagonal. Fine cells have gaps between the Gaussians of a large lawn,
through which a tenth of the lines of sight pass."""

LEAST_SHARE = 1 / 6
"""Of the standpoints, those that must see a position. Of 104 positions around a garden, 35 under its ground were seen
by 0 to 3 of 24 standpoints; of 69 above it, 61 by 4 or more, and the rest hid behind trees and its house."""


class FreeSpace:
    """The space that standpoints see."""

    def __init__(self, splats: Splats, bounds: Bounds, eyes: Sequence[Eye]) -> None:
        """splats: all of them, as the grid of the standpoints has them. bounds: (2, 3) box of their foreground."""
        self._grid = OpacityGrid.around(splats, bounds, CELLS, CELLS)
        self._eyes = [eye.center for eye in eyes]

    def holds(self, points: Points) -> Mask:
        """Whether LEAST_SHARE of the standpoints see each of the points (N, 3): (N,) bool."""
        seers = np.zeros(len(points), int)
        for center in self._eyes:
            way = points - center
            length = np.maximum(np.linalg.norm(way, axis=1), 1e-12)
            seers += self._grid.march(center[None], way / length[:, None])[0][0] >= length
        return np.asarray(seers >= LEAST_SHARE * len(self._eyes))
