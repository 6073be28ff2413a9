"""Depth maps at a level of the opacity field: the surface that a splat's Gaussians agree on, pixel by pixel.

Along a pixel's ray every Gaussian raises the opacity until the ray passes its peak, so that the opacity

    O(t) = 1 - prod_i (1 - a_i exp(-(min(t, t_i) - t_i)^2 / (2 sigma_i^2)))

never falls; the surface lies where it reaches a level. Unlike the usual expected or median depth this places the
surface in front of the Gaussians' centres, where their envelope is. Source: Yu, Sattler and Geiger, "Gaussian Opacity
Fields" (2024).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import DepthMap, Floats, Indices, Integers, Mask, Points, Quaternions
from ..base.errors import InputError
from ..base.kernels import kernel
from ..base.threads import shared
from ..splats.splats import Splats
from .footprints import (
    MAX_ALPHA,
    MIN_ALPHA,
    NEAR,
    TILE,
    Batch,
    Camera,
    Footprint,
    axes_of,
    camera_of,
    camera_point,
    footprint_batches,
    pixel_range,
)
from .levelsearch import ENTRY, FARTHEST_Q, lanes, search_level
from .rasterize import exp_minus_half
from .view import View

FIELD_LEVEL = 0.45
"""Opacity at which the surface lies."""

LIST = 48
"""Gaussians kept for each pixel, nearest first; those behind them hardly ever matter, nor those that hide less of it
than MIN_ALPHA."""

ENOUGH = np.float32(0.02)
"""Transmittance below which a pixel is finished: nothing behind moves the level, and little the colour."""


SHARP = 0.03
"""Spread of a surface, in units of its distance, at which its weight is halved."""


@dataclass(frozen=True)
class FieldDepth:
    """The surface as one view sees it. H, W are the view's size.

    depth: (H, W) float32 camera z at which the opacity reaches the level, NaN where it does not.
    normal: (H, W, 3) float32 unit, in the world, towards the camera; zero where there is no depth.
    spread: (H, W) float32, how far apart in z the opacities 0.2 and 0.6 lie: small where training saw a surface.
    color: (H, W, 3) float32 sRGB, not premultiplied. alpha: (H, W) float32 in [0, 1].
    """

    depth: DepthMap
    normal: NDArray[np.float32]
    spread: NDArray[np.float32]
    color: NDArray[np.float32]
    alpha: NDArray[np.float32]

    def sharpness(self) -> NDArray[np.float32]:
        """How sharp the surface looks, (H, W) in (0, 1], NaN where there is none."""
        blur = self.spread / (np.float32(SHARP) * self.depth)
        return np.asarray(1 / (1 + blur * blur), np.float32)


def field_depth(splats: Splats, view: View, near: float = NEAR, level: float = FIELD_LEVEL) -> FieldDepth:
    """Find the surface of `splats` in one view.

    splats: Splats, N >= 0; rows whose geometry is not finite are not seen. view: View in their frame.
    near: camera z > 0 of the near plane. level: opacity in (0, 1). Returns a FieldDepth.
    Raises InputError when `near` or `level` lies outside its range.
    """
    if not 0 < level < 1:
        raise InputError(f"the level of the opacity field: expected a number between 0 and 1, found {level}")
    camera = camera_of(view, near)
    height, width = camera.height, camera.width
    tiles_y, tiles_x = -(-height // TILE), -(-width // TILE)
    tiles = tiles_y * tiles_x
    blank = np.zeros((tiles, TILE, PLANES * TILE), np.float32)
    inside = np.zeros((tiles_y * TILE, tiles_x * TILE), np.float32)
    inside[:height, :width] = 1  # what lies outside the image lets nothing through: finished from the start
    blank[:, :, -TILE:] = inside.reshape(tiles_y, TILE, tiles_x, TILE).swapaxes(1, 2).reshape(-1, TILE, TILE)
    pixels = blank.reshape(tiles, -1)
    counts = np.zeros((tiles, TILE, TILE), np.int32)
    lists = np.empty((tiles, TILE, LIST, ENTRY, TILE), np.float32)
    dealt = np.random.default_rng(0).permutation(tiles)  # spreads the crowded tiles evenly over the threads
    rows = FieldTiles(pixels, np.ones(tiles, np.bool_), dealt, counts, lists)
    for batch in footprint_batches(splats, camera, rows.open):
        shapes = np.empty((len(batch.order), 13), np.float32)
        _shapes(len(shapes), splats.means, splats.scales, splats.quats_wxyz, batch.order, camera, shapes)
        _gather(tiles, batch, shapes, camera, rows)
    found = np.empty((tiles, TILE, 2 * TILE), np.float32)
    search_level(tiles, lists.reshape(tiles, TILE, -1), counts, dealt, np.float32(level), found)
    depth, spread, alpha = (np.full((height, width), np.nan, np.float32) for _ in range(3))
    normal, color = (np.zeros((height, width, 3), np.float32) for _ in range(2))
    _assemble(height, pixels, found, camera, depth, normal, spread, color, alpha)
    return FieldDepth(depth, normal @ camera.rotation.astype(np.float32), spread, color, alpha)


# What is kept of a pixel row while Gaussians are blended into it.
PLANES = 7
RED, GREEN, BLUE, NORMAL_X, NORMAL_Y, NORMAL_Z, TRANSMITTANCE = lanes(PLANES)

# One Gaussian along the rays of a pixel row: what the lists keep of it, then its share of the pixel, and that share of
# its normal.
SKETCH = 7
ALPHA, PEAK, PRECISION, WEIGHT, TURN_X, TURN_Y, TURN_Z = lanes(SKETCH)

BEGIN, STEP, END = np.int32(0), np.int32(1), np.int32(TILE)
ZERO, ONE = np.float32(0), np.float32(1)
FLATTEST = 1e-7  # the least scale, in units of the distance, at which float32 keeps every digit it needs
WIDEST = 1 / FLATTEST  # the largest


@shared
@kernel
def _shapes(
    begin: int, end: int, means: Points, scales: Floats, quats: Quaternions, order: Indices, camera: Camera, out: Floats
) -> None:
    """Maps M that make each Gaussian order[i] a unit ball, for rays in the camera's frame: (M, 13) float32. A row holds
    M (axis after axis, in units of 1 / distance), M times the Gaussian's centre, and 1 / distance^2. Along the ray t r
    the Gaussian peaks at t = (M r . M centre) / |M r|^2 with sigma = distance / |M r| and normal M^T M r."""
    r = camera.rotation
    for i in range(begin, end):
        k = order[i]
        axes = axes_of(quats, k)
        px, py, pz = camera_point(camera, means, k)
        distance = math.sqrt(px * px + py * py + pz * pz)
        for a in range(3):
            ax, ay, az = axes[a]
            stretch = 1 / min(max(scales[k, a] / distance, FLATTEST), WIDEST)
            cx = (r[0, 0] * ax + r[0, 1] * ay + r[0, 2] * az) * stretch
            cy = (r[1, 0] * ax + r[1, 1] * ay + r[1, 2] * az) * stretch
            cz = (r[2, 0] * ax + r[2, 1] * ay + r[2, 2] * az) * stretch
            out[i, 3 * a], out[i, 3 * a + 1], out[i, 3 * a + 2] = cx, cy, cz
            out[i, 9 + a] = cx * px + cy * py + cz * pz
        out[i, 12] = 1 / (distance * distance)


class FieldTiles(NamedTuple):
    """T tiles of a view while Gaussians are blended into them.

    pixels: (T, TILE * PLANES * TILE) float32, row after row of each tile. open: (T,) bool, which still let light
    through. dealt: (T,) their order over the threads. counts: (T, TILE, TILE) int32 and lists: (T, TILE, LIST, ENTRY,
    TILE) float32, the Gaussians kept for each pixel.
    """

    pixels: NDArray[np.float32]
    open: Mask
    dealt: Indices
    counts: NDArray[np.int32]
    lists: NDArray[np.float32]


@shared
@kernel
def _gather(begin: int, end: int, batch: Batch, shapes: Floats, camera: Camera, tiles: FieldTiles) -> None:
    """Blend colour and normals of each open tile front to back, and list its pixels' Gaussians."""
    for deal in range(begin, end):
        tile = tiles.dealt[deal]
        if tiles.open[tile]:
            _gather_tile(tile, batch, shapes, camera, tiles)


@kernel
def _gather_tile(tile: int, batch: Batch, shapes: Floats, camera: Camera, tiles: FieldTiles) -> None:
    starts, entries, footprints = batch.starts, batch.entries, batch.footprints
    tiles_x = (camera.width + TILE - 1) // TILE
    top, left = tile // tiles_x * TILE, tile % tiles_x * TILE
    u, du = np.float32((left + 0.5 - camera.cx) / camera.fx), np.float32(1 / camera.fx)
    block, tile_counts, tile_lists = tiles.pixels[tile], tiles.counts[tile], tiles.lists[tile]
    sketch, open_rows = np.zeros(SKETCH * TILE, np.float32), 0  # a bit for each row
    for row in range(TILE):
        if _any_open(block, np.uint64(row * PLANES * TILE)):
            open_rows |= 1 << row
    for e in range(starts[tile], starts[tile + 1]):
        if open_rows == 0:
            break
        s = footprints[entries[e]]
        first_row, last_row = pixel_range(s.y - s.reach_y, s.y + s.reach_y, top, top + TILE)
        for row in range(first_row - top, last_row - top):
            if not open_rows >> row & 1:
                continue
            start, dy = np.uint64(row * PLANES * TILE), top + row + 0.5 - s.y
            q_y = np.float32(s.precision_y * dy * dy)
            dx = np.float32(left + 0.5 - s.x - s.slope * dy)
            first, last = _weigh_row(block, start, s, q_y, dx, sketch)
            if first < last:
                v = np.float32((top + row + 0.5 - camera.cy) / camera.fy)
                _cross_row(shapes, entries[e], u, du, v, sketch)
                _blend_row(block, start, s, sketch)
                _list_row(sketch, first, last, tile_counts[row], tile_lists[row])
                if not _any_open(block, start):
                    open_rows ^= 1 << row
    tiles.open[tile] = open_rows > 0


# The loops over a pixel row have no branch, no call and unsigned indices: the compiler makes them vector instructions.


@kernel
def _any_open(block: Floats, start: np.uint64) -> bool:
    unfinished = 0
    for column in range(np.uint64(TILE)):
        unfinished += block[start + TRANSMITTANCE + column] >= ENOUGH
    return unfinished > 0


@kernel
def _weigh_row(
    block: Floats, start: np.uint64, s: Footprint, q_y: np.float32, dx: np.float32, sketch: Floats
) -> tuple[np.int32, np.int32]:
    """Opacity and weight of a footprint in a pixel row; returns the range (first, last + 1) of pixels that see it. dx
    is the first pixel's offset from the row's middle."""
    precision, cutoff, opacity = np.float32(s.precision_x), np.float32(s.cutoff), s.opacity
    first, last = END, BEGIN
    for column in range(np.uint64(TILE)):
        offset = dx + np.float32(column)
        q = q_y + precision * offset * offset
        before = block[start + TRANSMITTANCE + column]
        alpha = min(opacity * exp_minus_half(min(q, FARTHEST_Q)), MAX_ALPHA)
        alpha = alpha if (q <= cutoff) & (before >= ENOUGH) else ZERO
        sketch[ALPHA + column], sketch[WEIGHT + column] = alpha, before * alpha
        block[start + TRANSMITTANCE + column] = before * (ONE - alpha)
        at, seen = np.int32(column), alpha > ZERO
        first = min(first, at if seen else END)
        last = max(last, np.int32(at + STEP) if seen else BEGIN)
    return first, last


@kernel
def _cross_row(shapes: Floats, k: int, u: np.float32, du: np.float32, v: np.float32, sketch: Floats) -> None:
    """Where the rays of a pixel row cross Gaussian k: its peaks and precisions along them, its weighted normals."""
    xx, xy, xz = shapes[k, 0], shapes[k, 1], shapes[k, 2]
    yx, yy, yz = shapes[k, 3], shapes[k, 4], shapes[k, 5]
    zx, zy, zz = shapes[k, 6], shapes[k, 7], shapes[k, 8]
    bx, by, bz, per_area = shapes[k, 9], shapes[k, 10], shapes[k, 11], shapes[k, 12]
    for column in range(np.uint64(TILE)):
        x = u + np.float32(column) * du
        mx, my, mz = xx * x + xy * v + xz, yx * x + yy * v + yz, zx * x + zy * v + zz
        nx, ny, nz = xx * mx + yx * my + zx * mz, xy * mx + yy * my + zy * mz, xz * mx + yz * my + zz * mz
        q = mx * mx + my * my + mz * mz
        share = sketch[WEIGHT + column] / math.sqrt(nx * nx + ny * ny + nz * nz)
        sketch[PEAK + column], sketch[PRECISION + column] = (bx * mx + by * my + bz * mz) / q, q * per_area
        sketch[TURN_X + column], sketch[TURN_Y + column], sketch[TURN_Z + column] = share * nx, share * ny, share * nz


@kernel
def _blend_row(block: Floats, start: np.uint64, s: Footprint, sketch: Floats) -> None:
    """Blend a Gaussian's colour and normals, towards the camera, into a pixel row."""
    red, green, blue = s.red, s.green, s.blue
    for column in range(np.uint64(TILE)):
        i, weight = start + column, sketch[WEIGHT + column]
        block[RED + i] += weight * red
        block[GREEN + i] += weight * green
        block[BLUE + i] += weight * blue
        block[NORMAL_X + i] -= sketch[TURN_X + column]
        block[NORMAL_Y + i] -= sketch[TURN_Y + column]
        block[NORMAL_Z + i] -= sketch[TURN_Z + column]


@kernel
def _list_row(sketch: Floats, first: np.int32, last: np.int32, counts: Integers, lists: Floats) -> None:
    """Append a Gaussian to the lists of a row's pixels: counts (TILE,), lists (LIST, ENTRY, TILE)."""
    for column in range(first, last):
        count = counts[column]
        if sketch[WEIGHT + np.uint64(column)] > MIN_ALPHA and count < LIST:
            for field in range(ENTRY):
                lists[count, field, column] = sketch[field * TILE + column]
            counts[column] = count + 1


@shared
@kernel
def _assemble(
    begin: int,
    end: int,
    pixels: Floats,
    found: Floats,
    camera: Camera,
    depth: Floats,
    normal: Floats,
    spread: Floats,
    color: Floats,
    alpha: Floats,
) -> None:
    """The tiles as images, and only pixels with a surface in front of the near plane have a depth."""
    tiles_x = (camera.width + TILE - 1) // TILE
    for row in range(begin, end):
        for column in range(camera.width):
            tile, i = row // TILE * tiles_x + column // TILE, row % TILE
            block, at, p = pixels[tile, i * PLANES * TILE :], (row, column), np.uint64(column % TILE)
            alpha[at] = ONE - block[TRANSMITTANCE + p]
            share = max(alpha[at], np.float32(1e-6))
            color[row, column, 0] = block[RED + p] / share
            color[row, column, 1] = block[GREEN + p] / share
            color[row, column, 2] = block[BLUE + p] / share
            nx, ny, nz = block[NORMAL_X + p], block[NORMAL_Y + p], block[NORMAL_Z + p]
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            if found[tile, i, p] > camera.near and length > 0:
                depth[at], spread[at] = found[tile, i, p], found[tile, i, TILE + p]
                normal[row, column, 0] = nx / length
                normal[row, column, 1] = ny / length
                normal[row, column, 2] = nz / length
