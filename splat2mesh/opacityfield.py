"""Depth maps at a level of the opacity field: the surface that a splat's Gaussians agree on, pixel by pixel.

Along a pixel's ray every Gaussian raises the opacity until the ray passes its peak, so that the opacity

    O(t) = 1 - prod_i (1 - a_i exp(-(min(t, t_i) - t_i)^2 / (2 sigma_i^2)))

never falls; the surface lies where it reaches a level. Unlike the usual expected or median depth this places the
surface in front of the Gaussians' centres, where their envelope is. Source: Yu, Sattler and Geiger, "Gaussian Opacity
Fields" (2024).
"""

import math
from dataclasses import dataclass

import numba
import numpy as np

from .errors import InputError
from .footprints import NEAR, TILE, camera_of, footprint_batches
from .rasterize import _exp_minus_half, _pixels

LEVEL = 0.45
"""Opacity at which the surface lies."""

LIST = 48
"""Gaussians kept for each pixel, nearest first; those behind them hardly ever matter."""

MIN_WEIGHT = np.float32(0.004)
"""Share of the pixel below which a Gaussian is left out of the list: it moves the opacity by less than that."""

ENOUGH = np.float32(0.02)
"""Transmittance below which a pixel is finished: nothing behind moves the level, and little the colour."""

SPREAD_FROM, SPREAD_TO = np.float32(0.2), np.float32(0.6)
"""Opacities between which the spread of the surface is measured."""

TOLERANCE = np.float32(0.01)
"""Error of the opacity that a last Newton step is left to mend."""

MAX_ALPHA = np.float32(0.99)  # one Gaussian never hides everything behind it


@dataclass(frozen=True)
class FieldDepth:
    """What one view sees of the surface. H, W are the view's size.

    depth: (H, W) float32 camera z at which the opacity reaches the level, NaN where it does not.
    normal: (H, W, 3) float32 unit, in the world, towards the camera; zero where there is no depth.
    spread: (H, W) float32, how far apart in z the opacities 0.2 and 0.6 lie: small where training saw a surface.
    color: (H, W, 3) float32 sRGB, not premultiplied. alpha: (H, W) float32 in [0, 1].
    """

    depth: np.ndarray
    normal: np.ndarray
    spread: np.ndarray
    color: np.ndarray
    alpha: np.ndarray


def field_depth(splats, view, near=NEAR, level=LEVEL):
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
    pixels = np.zeros((tiles, TILE, PLANES, TILE), np.float32)
    inside = np.zeros((tiles_y * TILE, tiles_x * TILE), np.float32)
    inside[:height, :width] = 1  # what lies outside the image lets nothing through: finished from the start
    pixels[:, :, TRANSMITTANCE] = inside.reshape(tiles_y, TILE, tiles_x, TILE).swapaxes(1, 2).reshape(-1, TILE, TILE)
    counts = np.zeros((tiles, TILE, TILE), np.int32)
    lists = np.empty((tiles, TILE, LIST, ENTRY, TILE), np.float32)
    open_tiles = np.ones(tiles, np.bool_)
    dealt = np.random.default_rng(0).permutation(tiles)  # spreads the crowded tiles evenly over the threads
    for batch in footprint_batches(splats, camera, open_tiles):
        shapes = np.empty((len(batch.footprints), 13), np.float32)
        _shapes(splats.means, splats.scales, splats.quats_wxyz, batch.order, camera, shapes)
        _gather(batch.footprints, shapes, batch.starts, batch.entries, dealt, camera, open_tiles, pixels, counts, lists)
    depth, spread, alpha = (np.full((height, width), np.nan, np.float32) for _ in range(3))
    normal, color = (np.zeros((height, width, 3), np.float32) for _ in range(2))
    _solve(pixels, counts, lists, dealt, camera, np.float32(level), depth, normal, spread, color, alpha)
    return FieldDepth(depth, normal @ camera.rotation.astype(np.float32), spread, color, alpha)


def _rows(count):
    """Where the rows of floats of a pixel row begin; unsigned, or the loops over them are no vector instructions."""
    return tuple(np.uint64(TILE * i) for i in range(count))


# What is kept of a pixel row while Gaussians are blended into it.
PLANES = 7
RED, GREEN, BLUE, NORMAL_X, NORMAL_Y, NORMAL_Z, TRANSMITTANCE = _rows(PLANES)

# One Gaussian along the rays of a pixel row: opacity at its peak, camera z of the peak and 1 / sigma in camera z, which
# the pixels' lists keep, then its share of the pixel, and that share of its normal.
ENTRY, SKETCH = 3, 7
ALPHA, PEAK, STEEPNESS, WEIGHT, TURN_X, TURN_Y, TURN_Z = _rows(SKETCH)

# What the search for a level keeps of a pixel row.
SEARCH = 13
FIRST, LAST, THROUGH, FRONT, LOW, HIGH, AT, SLOPE, RATE, DEPTH_RATE, ACTIVE, DEPTH, SPREAD = _rows(SEARCH)

MOST_STEPS = 24
ZERO, HALF, ONE = np.float32(0), np.float32(0.5), np.float32(1)
FARTHEST_Q = np.float32(12)  # exp(-12 / 2) is below a step of 8 bits, and the exponential is good to here
FLATTEST, WIDEST = 1e-7, 1e7  # scales, in units of the distance, between which float32 keeps every digit it needs

_function = numba.njit(cache=True, nogil=True, error_model="numpy")
_kernel = numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)


@_kernel
def _shapes(means, scales, quats, order, camera, out):
    """Maps M that make each Gaussian order[i] a unit ball, for rays in the camera's frame: (M, 13) float32.

    A row holds M (axis after axis, in units of 1 / distance), M times the Gaussian's centre, and 1 / distance. Along
    the ray t r the Gaussian peaks at t = (M r . M centre) / |M r|^2 with sigma = 1 / |M r| and normal M^T M r.
    """
    r, t = camera.rotation, camera.translation
    for i in numba.prange(len(order)):
        k = order[i]
        w, x = np.float64(quats[k, 0]), np.float64(quats[k, 1])
        y, z = np.float64(quats[k, 2]), np.float64(quats[k, 3])
        axes = (
            (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
            (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
            (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
        )
        mx, my, mz = np.float64(means[k, 0]), np.float64(means[k, 1]), np.float64(means[k, 2])
        px = r[0, 0] * mx + r[0, 1] * my + r[0, 2] * mz + t[0]
        py = r[1, 0] * mx + r[1, 1] * my + r[1, 2] * mz + t[1]
        pz = r[2, 0] * mx + r[2, 1] * my + r[2, 2] * mz + t[2]
        distance = math.sqrt(px * px + py * py + pz * pz)
        for a in range(3):
            ax, ay, az = axes[a]
            stretch = 1 / min(max(scales[k, a] / distance, FLATTEST), WIDEST)
            cx = (r[0, 0] * ax + r[0, 1] * ay + r[0, 2] * az) * stretch
            cy = (r[1, 0] * ax + r[1, 1] * ay + r[1, 2] * az) * stretch
            cz = (r[2, 0] * ax + r[2, 1] * ay + r[2, 2] * az) * stretch
            out[i, 3 * a], out[i, 3 * a + 1], out[i, 3 * a + 2] = cx, cy, cz
            out[i, 9 + a] = cx * px + cy * py + cz * pz
        out[i, 12] = 1 / distance


@_kernel
def _gather(footprints, shapes, starts, entries, dealt, camera, open_tiles, pixels, counts, lists):
    """Blend colour and normals of each open tile front to back, and list its pixels' Gaussians."""
    tiles_x = (camera.width + TILE - 1) // TILE
    for deal in numba.prange(len(dealt)):
        tile = dealt[deal]
        if not open_tiles[tile]:
            continue
        top, left = tile // tiles_x * TILE, tile % tiles_x * TILE
        block, tile_counts, tile_lists = pixels[tile], counts[tile], lists[tile]
        sketch, open_rows = np.zeros((SKETCH, TILE), np.float32), np.zeros(TILE, np.bool_)
        for row in range(TILE):
            open_rows[row] = _any_open(block, row)
        still_open = open_rows.sum()
        u, du = np.float32((left + 0.5 - camera.cx) / camera.fx), np.float32(1 / camera.fx)
        for e in range(starts[tile], starts[tile + 1]):
            if still_open == 0:
                break
            s = footprints[entries[e]]
            first, last = _pixels(s.y - s.reach_y, s.y + s.reach_y, top, top + TILE)
            for row in range(first - top, last - top):
                if not open_rows[row]:
                    continue
                dy = top + row + 0.5 - s.y
                q_y = np.float32(s.precision_y * dy * dy)
                dx = np.float32(left + 0.5 - s.x - s.slope * dy)
                if _weigh_row(block, row, s, q_y, dx, sketch):
                    v = np.float32((top + row + 0.5 - camera.cy) / camera.fy)
                    _cross_row(shapes, entries[e], u, du, v, sketch)
                    _blend_row(block, row, s, sketch)
                    _list_row(sketch, row, tile_counts, tile_lists)
                    open_rows[row] = _any_open(block, row)
                    still_open -= not open_rows[row]
        open_tiles[tile] = still_open > 0


# The loops over a pixel row have no branch and no call, so that the compiler makes them vector instructions.


@_function
def _any_open(block, row):
    unfinished = 0
    for column in range(np.uint64(TILE)):
        unfinished += block[row, TRANSMITTANCE, column] >= ENOUGH
    return unfinished > 0


@_function
def _weigh_row(block, row, s, q_y, dx, sketch):
    """Opacity and weight of a footprint in a pixel row; returns whether any pixel sees it.

    dx is the first pixel's offset from the row's middle.
    """
    precision, cutoff, opacity = np.float32(s.precision_x), np.float32(s.cutoff), s.opacity
    seen = 0
    for column in range(np.uint64(TILE)):
        offset = dx + np.float32(column)
        q = q_y + precision * offset * offset
        before = block[row, TRANSMITTANCE, column]
        alpha = min(opacity * _exp_minus_half(min(q, np.float32(13))), MAX_ALPHA)
        alpha = alpha if (q <= cutoff) & (before >= ENOUGH) else ZERO
        sketch[ALPHA, column], sketch[WEIGHT, column] = alpha, before * alpha
        block[row, TRANSMITTANCE, column] = before * (ONE - alpha)
        seen += alpha > ZERO
    return seen > 0


@_function
def _cross_row(shapes, k, u, du, v, sketch):
    """Where the rays of a pixel row cross a Gaussian: its peaks, steepness and weighted normals."""
    xx, xy, xz = shapes[k, 0], shapes[k, 1], shapes[k, 2]
    yx, yy, yz = shapes[k, 3], shapes[k, 4], shapes[k, 5]
    zx, zy, zz = shapes[k, 6], shapes[k, 7], shapes[k, 8]
    bx, by, bz, per_distance = shapes[k, 9], shapes[k, 10], shapes[k, 11], shapes[k, 12]
    for column in range(np.uint64(TILE)):
        x = u + np.float32(column) * du
        mx, my, mz = xx * x + xy * v + xz, yx * x + yy * v + yz, zx * x + zy * v + zz
        q = mx * mx + my * my + mz * mz
        nx, ny, nz = xx * mx + yx * my + zx * mz, xy * mx + yy * my + zy * mz, xz * mx + yz * my + zz * mz
        scale = sketch[WEIGHT, column] / math.sqrt(nx * nx + ny * ny + nz * nz)
        sketch[PEAK, column] = (bx * mx + by * my + bz * mz) / q
        sketch[STEEPNESS, column] = math.sqrt(q) * per_distance
        sketch[TURN_X, column], sketch[TURN_Y, column], sketch[TURN_Z, column] = scale * nx, scale * ny, scale * nz


@_function
def _blend_row(block, row, s, sketch):
    """Blend a Gaussian's colour and normals into a pixel row."""
    red, green, blue = s.red, s.green, s.blue
    for column in range(np.uint64(TILE)):
        weight = sketch[WEIGHT, column]
        block[row, RED, column] += weight * red
        block[row, GREEN, column] += weight * green
        block[row, BLUE, column] += weight * blue
        block[row, NORMAL_X, column] -= sketch[TURN_X, column]
        block[row, NORMAL_Y, column] -= sketch[TURN_Y, column]
        block[row, NORMAL_Z, column] -= sketch[TURN_Z, column]


@_function
def _list_row(sketch, row, counts, lists):
    """Append a Gaussian to the lists of a row's pixels: counts (TILE, TILE), lists (TILE, LIST, ENTRY, TILE)."""
    for column in range(TILE):
        count = counts[row, column]
        if sketch[WEIGHT, column] > MIN_WEIGHT and count < LIST:
            for field in range(ENTRY):
                lists[row, count, field, column] = sketch[field, column]
            counts[row, column] = count + 1


@_kernel
def _solve(pixels, counts, lists, dealt, camera, level, depth, normal, spread, color, alpha):
    """Where each pixel's opacity reaches the level, its normal there, and the spread about it."""
    tiles_x = (camera.width + TILE - 1) // TILE
    for deal in numba.prange(len(dealt)):
        tile = dealt[deal]
        top, left = tile // tiles_x * TILE, tile % tiles_x * TILE
        search = np.zeros((SEARCH, TILE), np.float32)
        for row in range(min(TILE, camera.height - top)):
            _solve_row(lists[tile, row], counts[tile, row], level, search)
            pixel_row = pixels[tile, row]
            for column in range(min(TILE, camera.width - left)):
                at = top + row, left + column
                alpha[at] = ONE - pixel_row[TRANSMITTANCE, column]
                for channel in range(3):
                    color[at][channel] = pixel_row[RED + channel, column] / max(alpha[at], np.float32(1e-6))
                turn = pixel_row[NORMAL_X : NORMAL_Z + 1, column]
                length = math.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
                if search[DEPTH, column] > camera.near and length > 0:
                    depth[at], spread[at] = search[DEPTH, column], search[SPREAD, column]
                    for axis in range(3):
                        normal[at][axis] = turn[axis] / length


@_function
def _solve_row(entries, counts, level, search):
    """Depth and spread of a pixel row, in search[DEPTH] and search[SPREAD]; NaN where the level is not reached."""
    longest = counts.max()
    for column in range(TILE):
        entries[counts[column] : longest, :, column] = 0  # shorter lists end with Gaussians that hide nothing
    search[FIRST], search[LAST], search[THROUGH], search[AT] = np.inf, -np.inf, 1, 0
    for e in range(longest):
        _extend_row(entries[e], level, search)
    search[LOW], search[HIGH] = search[FIRST], search[LAST]
    _reach_row(entries, longest, level, search)
    search[DEPTH], search[DEPTH_RATE] = search[AT], search[RATE]
    _bracket_row(SPREAD_TO, level, search)
    _reach_row(entries, longest, SPREAD_TO, search)
    search[SPREAD] = search[AT]
    _bracket_row(SPREAD_FROM, level, search)
    _reach_row(entries, longest, SPREAD_FROM, search)
    for column in range(np.uint64(TILE)):
        search[SPREAD + column] -= search[AT + column]
        reached = ONE - search[THROUGH + column] >= level
        search[DEPTH + column] = search[DEPTH + column] if reached else np.float32(np.nan)


@_function
def _extend_row(entry, level, search):
    """Extend the ranges of depth by one Gaussian; AT stays at the one whose peak is the first beyond the level."""
    for column in range(np.uint64(TILE)):
        share, peak, width = (
            entries[start + ALPHA + column],
            entries[start + PEAK + column],
            ONE / entries[start + STEEPNESS + column],
        )
        before, start = search[THROUGH + column], search[AT + column]
        after = before * (ONE - share)
        first, last = search[FIRST + column], search[LAST + column]
        search[FIRST + column] = min(first, peak - 3 * width) if share > 0 else first
        search[LAST + column] = max(last, peak) if share > 0 else last
        search[AT + column] = peak - width if (before > ONE - level) & (after <= ONE - level) else start
        search[THROUGH + column] = after


@_function
def _bracket_row(target, level, search):
    """Prepare the search for another opacity than the level that was just found at DEPTH."""
    for column in range(np.uint64(TILE)):
        depth = search[DEPTH + column]
        low = depth if target > level else search[FIRST + column]
        high = search[LAST + column] if target > level else depth
        start = depth + (target - level) / search[DEPTH_RATE + column]
        search[LOW + column], search[HIGH + column] = low, high
        search[AT + column] = min(max(start, low), high)


@_function
def _reach_row(entries, longest, target, search):
    """Move search[AT] to where the opacity reaches `target`: Newton's steps, halving [LOW, HIGH] where they leave it.

    Where it never does, AT becomes the last peak.
    """
    for column in range(np.uint64(TILE)):
        reached = ONE - search[THROUGH + column] >= target
        search[ACTIVE + column] = ONE if reached else ZERO
        search[AT + column] = search[AT + column] if reached else search[LAST + column]
    for _ in range(MOST_STEPS):
        _opacity_row(entries, longest, search)
        if not _step_row(target, search):
            break


@_function
def _opacity_row(entries, longest, search):
    """Transmittance in front of AT, and the slope of the opacity there, into search[THROUGH] and search[SLOPE]."""
    search[FRONT], search[SLOPE] = 1, 0
    for e in range(longest):
        for column in range(np.uint64(TILE)):
            steepness = entries[start + STEEPNESS + column]
            ahead = max((entries[start + PEAK + column] - search[AT + column]) * steepness, ZERO)
            q = ahead * ahead
            share = entries[start + ALPHA + column] * _exp_minus_half(q) if q < FARTHEST_Q else ZERO
            front = search[FRONT + column]
            search[SLOPE + column] = search[SLOPE + column] * (ONE - share) + front * share * ahead * steepness
            search[FRONT + column] = front * (ONE - share)


@_function
def _step_row(target, search):
    """One step of the search in each ACTIVE pixel; returns how many go on."""
    going = 0
    for column in range(np.uint64(TILE)):
        at, active = search[AT + column], search[ACTIVE + column] > ZERO
        missing, slope = target - (ONE - search[FRONT + column]), search[SLOPE + column]
        low = at if missing > ZERO else search[LOW + column]
        high = search[HIGH + column] if missing > ZERO else at
        newton = at + missing / max(slope, np.float32(1e-12))
        moved = newton if (low < newton) & (newton < high) else HALF * (low + high)
        done = (abs(missing) < TOLERANCE) | (abs(moved - at) <= np.float32(1e-6) * abs(at))
        search[LOW + column], search[HIGH + column] = low, high
        search[AT + column] = moved if active else at
        search[RATE + column] = slope if active else search[RATE + column]
        search[ACTIVE + column] = ONE if active & (not done) else ZERO
        going += active & (not done)
    return going
