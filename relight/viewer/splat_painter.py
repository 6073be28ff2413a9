"""Pictures of splats from an Orbit: rasterised on the CPU, coarser while the camera moves, from cached weights while
the light moves.

A light moves no splat: while the camera stands still, the splats of each pixel and their weights are computed once
(`relight.splats.blending`), and a picture in another light is a sum of colours.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.render.footprints import TILE
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.harmonics import sh_basis_3dgs
from splat2mesh.splats.splats import Splats
from splat2mesh.views.standpoints import NEAR_DIAGONAL

from ..output.picture import in_frame
from ..splats.blending import Blending, blending_of
from .camera import Orbit

COARSE = 2
"""Screen pixels along the side of a drawn pixel while the camera moves: 91,000 splats on 1280 x 800 take 89 instead of
143 ms."""


class SplatLayer(NamedTuple):
    """A picture of splats. color: (H, W, 3) float32 sRGB, premultiplied. alpha: (H, W). Top row first."""

    color: NDArray[np.float32]
    alpha: NDArray[np.float32]

    def over(self, behind: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Before a picture (H, W, 3) uint8 sRGB."""
        through = (1.0 - self.alpha)[..., None] * (behind * np.float32(1.0 / 255.0))
        shown = np.clip(self.color + through, 0.0, 1.0)
        return (shown * np.float32(255.0) + np.float32(0.5)).astype(np.uint8)


class _Seen(NamedTuple):
    """A view with cached shares. basis: (N, K) float32, harmonics of the directions to the splats."""

    orbit: Orbit
    size: tuple[int, int]
    opacities: NDArray[np.float32]
    blending: Blending
    alpha: NDArray[np.float32]
    basis: NDArray[np.float32]


class SplatPainter:
    """Draws splats at the positions of a Scene's splats."""

    def __init__(self, scene: Scene) -> None:
        frame = np.asarray(scene.scene_from_splat, np.float64)
        self._frame, self._near = frame, NEAR_DIAGONAL * scene.diagonal
        self._seen: _Seen | None = None

    def exact(self, splats: Splats, orbit: Orbit, size: tuple[int, int]) -> SplatLayer:
        """The picture as written to files."""
        seen = rasterize(splats, *self._view(orbit, size))
        return SplatLayer(seen.color, seen.alpha)

    def again(self, splats: Splats, orbit: Orbit, size: tuple[int, int]) -> SplatLayer:
        """The same without contributions below 1/512 of a pixel: slower once per view, then much faster."""
        seen = self._seen
        if (
            seen is None
            or (seen.orbit, seen.size) != (orbit, size)
            or not np.array_equal(seen.opacities, splats.opacities)
        ):
            self._seen = seen = self._look(splats, orbit, size)
        colors = np.einsum("nk,nkc->nc", seen.basis, splats.sh, dtype=np.float32) + np.float32(0.5)
        tiles = seen.blending.drawn(np.maximum(np.nan_to_num(colors), np.float32(0.0)))
        return SplatLayer(_out_of_tiles(tiles, size), seen.alpha)

    def _look(self, splats: Splats, orbit: Orbit, size: tuple[int, int]) -> _Seen:
        (view, near), found = self._view(orbit, size), []
        blending = blending_of(splats, [view], near, lambda _, alpha, __: found.append(alpha.copy()))
        toward = splats.means - view.center
        toward = toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12)
        basis = sh_basis_3dgs(toward, splats.degree).astype(np.float32)
        return _Seen(orbit, size, splats.opacities, blending, found[0], basis)

    def _view(self, orbit: Orbit, size: tuple[int, int]) -> tuple[View, float]:
        """The camera in the frame of the splats, whose unit may be another, and the nearest distance that it shows."""
        return in_frame(orbit.view(size), self._frame, self._near)


def coarser(size: tuple[int, int]) -> tuple[int, int]:
    """The size of a picture while the camera moves."""
    return max(1, size[0] // COARSE), max(1, size[1] // COARSE)


def joined(left: NDArray[np.uint8], right: NDArray[np.uint8], split_at: float) -> NDArray[np.uint8]:
    """Two pictures (H, W, 3); the first shows left of a position, 0..1 over the width."""
    column = round(split_at * left.shape[1])
    return np.concatenate([left[:, :column], right[:, column:]], axis=1)


def _out_of_tiles(tiles: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Pixels of tiles, (P, 3), as an image (H, W, 3): the inverse of `in_tiles`."""
    width, height = size
    down, across = -(-height // TILE), -(-width // TILE)
    whole = tiles.reshape(down, across, TILE, TILE, 3).swapaxes(1, 2).reshape(down * TILE, across * TILE, 3)
    return whole[:height, :width]
