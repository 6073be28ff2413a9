"""Backprojection: spread the values of a picture onto the Gaussians that contribute to its pixels.

Rendering sums the colours of Gaussians by blending weights; this is its transpose. It walks the same footprints in the
same order as `splat2mesh.render.rasterize`. Each tile has one thread and sums are taken in a fixed order, so bits do
not depend on the number of threads.
"""

import numba
import numpy as np

from splat2mesh.render.footprints import NEAR, TILE, camera_of, footprint_batches
from splat2mesh.render.rasterize import AREA, MAX_ALPHA, MIN_TRANSMITTANCE, ZERO, _exp_minus_half

# What is kept of a pixel of a tile: three values times what it counts, that, and the light that is still let through.
GREEN, BLUE, COUNT, LIGHT = (np.uint64(plane * AREA) for plane in (1, 2, 3, 4))
LANE = np.uint64(TILE)

_kernel = numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
_function = numba.njit(cache=True, nogil=True, error_model="numpy")
_serial = numba.njit(cache=True, nogil=True)


def backproject(
    splats,
    view,
    values,  # (H, W, 4) float32: three values, and what the pixel counts
    sums,  # (N, 4) float32, added to: the values by what the Gaussian gives each pixel, and those weights
    near=NEAR,
):
    """Add to each Gaussian the sums over pixels of weight * count * (values, 1)."""
    camera = camera_of(view, near)
    tiles_x, tiles_y = -(-camera.width // TILE), -(-camera.height // TILE)
    values = np.ascontiguousarray(values, np.float32)
    light = np.ones(values.shape[:2], np.float32)
    open_tiles = np.ones(tiles_x * tiles_y, np.bool_)
    for batch in footprint_batches(splats, camera, open_tiles):
        seen = np.zeros((len(batch.entries), 4), np.float32)
        _gather(batch.footprints, batch.starts, batch.entries, open_tiles, tiles_x, values, light, seen)
        _add(batch.order, batch.entries, seen, sums)


@_kernel
def _gather(footprints, starts, entries, open_tiles, tiles_x, values, light, seen):
    """What each entry of the tiles' lists sees: (E, 4). light: (H, W) transmittance, consumed."""
    height, width = light.shape
    for tile in numba.prange(len(open_tiles)):
        if not open_tiles[tile] or starts[tile] == starts[tile + 1]:
            continue
        top, left = tile // tiles_x * TILE, tile % tiles_x * TILE
        bottom, right = min(top + TILE, height), min(left + TILE, width)
        block, lanes = np.zeros(5 * AREA, np.float32), np.zeros(4 * TILE, np.float32)
        for row in range(top, bottom):
            for column in range(left, right):
                i = (row - top) * TILE + column - left
                count = values[row, column, 3]
                for plane in range(3):
                    block[plane * AREA + i] = count * values[row, column, plane]
                block[3 * AREA + i], block[4 * AREA + i] = count, light[row, column]
        for e in range(starts[tile], starts[tile + 1]):
            s = footprints[entries[e]]
            lanes[:] = 0
            first = int(min(max(np.ceil(s.y - s.reach_y - 0.5), top), bottom))
            last = int(max(min(np.floor(s.y + s.reach_y - 0.5) + 1, bottom), top))
            for row in range(first, last):
                dy = row + 0.5 - s.y
                q_y = np.float32(s.precision_y * dy * dy)
                _gather_row(
                    block, np.uint64((row - top) * TILE), s, q_y, np.float32(left + 0.5 - s.x - s.slope * dy), lanes
                )
            for plane in range(4):
                total = np.float32(0)
                for column in range(TILE):
                    total += lanes[plane * TILE + column]
                seen[e, plane] = total
        closed = True
        for row in range(top, bottom):
            for column in range(left, right):
                rest = block[4 * AREA + (row - top) * TILE + column - left]
                light[row, column] = rest
                closed &= rest < MIN_TRANSMITTANCE
        open_tiles[tile] = not closed


@_function
def _gather_row(block, first, s, q_y, dx, lanes):
    """One pixel row of a footprint; like `rasterize`'s own without a branch, to become vector instructions."""
    precision, cutoff, opacity = np.float32(s.precision_x), np.float32(s.cutoff), s.opacity
    for column in range(np.uint64(TILE)):
        i = first + column
        offset = dx + np.float32(column)
        q = q_y + precision * offset * offset
        before = block[LIGHT + i]
        alpha = min(opacity * _exp_minus_half(q), MAX_ALPHA)
        alpha = alpha if (q <= cutoff) & (before >= MIN_TRANSMITTANCE) else ZERO
        weight = before * alpha
        lanes[column] += weight * block[i]
        lanes[LANE + column] += weight * block[GREEN + i]
        lanes[LANE + LANE + column] += weight * block[BLUE + i]
        lanes[LANE + LANE + LANE + column] += weight * block[COUNT + i]
        block[LIGHT + i] = before - weight


@_serial
def _add(order, entries, seen, sums):
    for e in range(len(entries)):
        k = order[entries[e]]
        for c in range(4):
            sums[k, c] += seen[e, c]
