"""The free space that the standpoints of a capture see: where else a view of the same place may stand.

A view from under the ground sees the back of its splats, and fusion makes a second surface of it. No line of sight
leads there from where people stood, but lines lead over walls, roofs and trees.
"""

from collections.abc import Sequence

import numpy as np

from ..base.arrays import Bounds, Mask, Points, Vector
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

    def __init__(
        self, splats: Splats, bounds: Bounds, eyes: Sequence[Eye], up: Vector | None = None, lowest: float = 0.0
    ) -> None:
        """splats: all of them, as the grid of the standpoints has them. bounds: (2, 3) box of their foreground.

        up: (3,) unit, or None where it is unknown. lowest: height along it of the lowest ground: a standpoint near the
        edge of the ground looks past it, to where there is only its underside to see.
        """
        self._up, self._lowest = up, lowest
        self._grid = OpacityGrid.around(splats, bounds, CELLS, CELLS)
        self._eyes = [eye.center for eye in eyes]

    def holds(self, points: Points) -> Mask:
        """Which of the points (N, 3) lie above the lowest ground, in sight of LEAST_SHARE of the standpoints: (N,)."""
        seers = np.zeros(len(points), int)
        for center in self._eyes:
            way = points - center
            length = np.linalg.norm(way, axis=1)
            way[length == 0] = [1.0, 0.0, 0.0]  # a ray without a direction would never arrive
            way /= np.where(length > 0, length, 1.0)[:, None]
            seers += self._grid.march(center[None], way)[0][0] >= length
        above = np.ones(len(points), bool) if self._up is None else points @ self._up > self._lowest
        return np.asarray(above & (seers >= LEAST_SHARE * len(self._eyes)))
