"""The screen in square tiles, each filled by one thread: the state of its pixels meanwhile."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Indices, Mask
from .footprints import TILE, Camera

AREA = TILE * TILE


class ScreenTiles(NamedTuple):
    """T tiles of a view, row after row, of planes that hold a float32 for each pixel.

    pixels: (T, planes * AREA) float32, plane after plane of each tile. open: (T,) bool, which still let light through.
    dealt: (T,) order of the tiles that spreads the crowded ones evenly over the threads. across: tiles in a row.
    """

    pixels: NDArray[np.float32]
    open: Mask
    dealt: Indices
    across: int

    @classmethod
    def empty(cls, camera: Camera, planes: int, transmittance: int, median: int) -> "ScreenTiles":
        """Those of a Camera, nothing drawn: zeros, but 1 for the transmittance and NaN for the median depth."""
        down, across = -(-camera.height // TILE), -(-camera.width // TILE)
        tiles = cls(
            np.zeros((down * across, planes * AREA), np.float32),
            np.ones(down * across, np.bool_),
            np.random.default_rng(0).permutation(down * across),
            across,
        )
        whole = tiles._planes()
        inside = np.zeros((down * TILE, across * TILE), np.float32)
        inside[: camera.height, : camera.width] = 1  # what lies outside lets nothing through: finished from the start
        whole[transmittance], whole[median] = inside.reshape(whole.shape[1:]), np.nan
        return tiles

    def images(self, camera: Camera) -> Floats:
        """The planes as images, (planes, H, W) float32."""
        whole = self._planes()
        planes, down, _, across, _ = whole.shape
        return whole.reshape(planes, down * TILE, across * TILE)[:, : camera.height, : camera.width]

    def _planes(self) -> Floats:
        """The pixels as (planes, tiles down, TILE, tiles across, TILE)."""
        return self.pixels.reshape(-1, self.across, self.pixels.shape[1] // AREA, TILE, TILE).transpose(2, 0, 3, 1, 4)
