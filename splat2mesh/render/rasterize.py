"""Splats to images on the CPU: colour, opacity and depth of one view, by tiles, front to back.

The method is elliptical weighted averaging as 3D Gaussian splatting does it. Its twin in the tests does the same in
plain NumPy; the kernels here only skip invisible work.

Each pixel is computed by one thread in a fixed order: the same bytes come out on any number of threads.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import DepthMap, Floats
from ..base.kernels import kernel
from ..base.threads import shared
from ..splats.splats import Splats
from .footprints import EVERYWHERE, MAX_ALPHA, NEAR, TILE, Batch, Footprint, camera_of, footprint_batches, pixel_range
from .screentiles import AREA, ScreenTiles
from .view import View

MIN_TRANSMITTANCE = np.float32(1e-4)  # a pixel that lets less through is finished
ZERO, HALF, ONE = np.float32(0), np.float32(0.5), np.float32(1)

CLOSING_INTERVAL = 8  # splats blended between two looks whether a tile is finished
SPAN = TILE // 2  # pixels of a row that are blended at a time: most splats reach one half alone
SPARE = 0.01  # pixels that a splat may reach further by rounding

# What is kept of a pixel while splats are blended into it: the planes of its tile's block of floats.
PLANES = 5
RED, GREEN, BLUE, TRANSMITTANCE, MEDIAN = (np.uint64(plane * AREA) for plane in range(PLANES))


@dataclass(frozen=True)
class Rendering:
    """The picture of one view. H, W are the view's size.

    color: (H, W, 3) float32 sRGB, premultiplied (over black); over a background b: color + (1 - alpha) b.
    alpha: (H, W) float32 in [0, 1].
    depth_median: (H, W) float32 camera z of the centre of the splat at which the transmittance first drops to
        0.5; NaN where it never does.
    """

    color: NDArray[np.float32]
    alpha: NDArray[np.float32]
    depth_median: DepthMap


def rasterize(splats: Splats, view: View, near: float = NEAR, deepest: Floats = EVERYWHERE) -> Rendering:
    """Render `splats` from `view`.

    splats: Splats (means, scales, quats_wxyz, opacities, sh of 3DGS signs), N >= 0. Rows whose geometry is
        not finite are not drawn, colours that are not finite are black.
    view: View in the frame of the splats. near: camera z > 0 of the near plane, in the splats' unit.
    deepest: (tiles,) float32 camera z behind which nothing matters in each tile, row after row; those of 0 stay empty.
    Returns a Rendering. Colours follow each splat's harmonics towards the camera, clamped at 0 from below.
    Memory on the way: 4 bytes a splat, 32 for each one in the frustum, and the lists of one batch of 32,768.
    Raises InputError when `near` is not positive.
    """
    camera = camera_of(view, near)
    tiles = ScreenTiles.empty(camera, PLANES, transmittance=3, median=4)
    if len(deepest):
        tiles.open[:] = deepest > 0
    for batch in footprint_batches(splats, camera, tiles.open, deepest):
        _blend(len(tiles.open), batch, tiles)
    images = tiles.images(camera)
    transmittance, depth_median = images[3:]
    return Rendering(np.stack(list(images[:3]), axis=-1), 1 - transmittance, depth_median.copy())


@shared
@kernel
def _blend(begin: int, end: int, batch: Batch, tiles: ScreenTiles) -> None:
    """Blend each open tile's list into its pixels, and close the tiles that let no more light through."""
    for deal in range(begin, end):
        tile = tiles.dealt[deal]
        if not tiles.open[tile]:
            continue
        top, left = tile // tiles.across * TILE, tile % tiles.across * TILE
        block = tiles.pixels[tile]
        for e in range(batch.starts[tile], batch.starts[tile + 1]):
            s = batch.footprints[batch.entries[e]]
            first, last = pixel_range(s.y - s.reach_y, s.y + s.reach_y, top, top + TILE)
            reach_x = np.sqrt(s.cutoff * (1.0 / s.precision_x + s.slope * s.slope / s.precision_y)) + SPARE
            low, high = 0 if s.x - reach_x < left + SPAN else SPAN, TILE if s.x + reach_x > left + SPAN else SPAN
            for row in range(first, last):
                dy = row + 0.5 - s.y
                q_y = np.float32(s.precision_y * dy * dy)
                dx = np.float32(left + 0.5 - s.x - s.slope * dy)
                for start in range(low, high, SPAN):
                    _blend_row(block, np.uint64((row - top) * TILE + start), s, q_y, dx, np.float32(start))
            if e % CLOSING_INTERVAL == 0 and not _any_open(block):
                tiles.open[tile] = False
                break


@kernel
def _blend_row(
    block: Floats, first: np.uint64, s: Footprint, q_y: np.float32, dx: np.float32, start: np.float32
) -> None:
    """Blend a footprint into half a pixel row, at `first`, which begins `start` pixels after the row; dx is the row's
    offset from its middle. No branch, no call, unsigned indices at fixed distances: the compiler makes it vector
    instructions."""
    precision, cutoff, opacity = np.float32(s.precision_x), np.float32(s.cutoff), s.opacity
    red, green, blue, depth = s.red, s.green, s.blue, s.depth
    for column in range(np.uint64(SPAN)):
        i = first + column
        offset = dx + (start + np.float32(column))
        q = q_y + precision * offset * offset
        before = block[TRANSMITTANCE + i]
        alpha = min(opacity * exp_minus_half(q), MAX_ALPHA)
        alpha = alpha if (q <= cutoff) & (before >= MIN_TRANSMITTANCE) else ZERO
        weight, after = before * alpha, before * (ONE - alpha)
        block[RED + i] += weight * red
        block[GREEN + i] += weight * green
        block[BLUE + i] += weight * blue
        median = block[MEDIAN + i]
        block[MEDIAN + i] = depth if (before > HALF) & (after <= HALF) else median
        block[TRANSMITTANCE + i] = after


@kernel
def exp_minus_half(q: np.float32) -> np.float32:
    """exp(-q / 2) for 0 <= q <= 12 to 3e-6: the Taylor series of exp(-q / 64), squared five times."""
    t = q * np.float32(-1 / 64)
    e = np.float32(1 / 24) + t * np.float32(1 / 120)
    e = np.float32(1 / 6) + t * e
    e = np.float32(1 / 2) + t * e
    e = ONE + t * e
    e = ONE + t * e
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e


@kernel
def _any_open(block: Floats) -> bool:
    unfinished = 0
    for i in range(np.uint64(AREA)):
        unfinished += block[TRANSMITTANCE + i] >= MIN_TRANSMITTANCE
    return unfinished > 0
