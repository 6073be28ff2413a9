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

from .footprints import NEAR, TILE, camera_of, footprint_batches

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

MIN_ALPHA, MAX_ALPHA = np.float32(1 / 255), np.float32(0.99)


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

    splats: Splats of which no scale is zero. view: View in their frame. near: camera z of the near plane.
    level: opacity in (0, 1). Returns a FieldDepth.
    """
    camera = camera_of(view, near)
    height, width = camera.height, camera.width
    tiles_x = -(-width // TILE)
    tiles = tiles_x * -(-height // TILE)
    state = np.zeros((tiles, STATE, TILE * TILE), np.float32)
    state[:, TRANSMITTANCE] = 1
    lists = np.empty((tiles, TILE * TILE, LIST, 3), np.float32)
    open_tiles = np.ones(tiles, np.bool_)
    for batch in footprint_batches(splats, camera, open_tiles):
        shapes = np.empty((len(batch.footprints), 9))
        _shapes(splats.scales, splats.quats_wxyz, batch.order, splats.means, camera, shapes)
        _gather(batch.footprints, shapes, batch.starts, batch.entries, camera, open_tiles, state, lists)
    out = np.full((height, width, 9), np.nan, np.float32)
    _solve(state, lists, camera, np.float32(level), out)
    return FieldDepth(
        out[..., 0],
        out[..., 1:4] @ camera.rotation.astype(np.float32),
        out[..., 4],
        out[..., 5:8],
        out[..., 8],
    )


# Per pixel: transmittance, entries in the list, premultiplied colour, normal.
TRANSMITTANCE, COUNT, COLOR, NORMAL, STATE = 0, 1, 2, 5, 8
HALF = np.float32(-0.5)

_kernel = numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)


@_kernel
def _shapes(scales, quats, order, means, camera, out):
    """Inverse covariances S in the camera's frame (6 numbers) and S mu (3 numbers) of the Gaussians order[i]."""
    for i in numba.prange(len(order)):
        k = order[i]
        w, x, y, z = quats[k, 0], quats[k, 1], quats[k, 2], quats[k, 3]
        axes = (
            (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
            (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
            (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
        )
        rotation, t = camera.rotation, camera.translation
        mx, my, mz = means[k, 0], means[k, 1], means[k, 2]
        px = rotation[0, 0] * mx + rotation[0, 1] * my + rotation[0, 2] * mz + t[0]
        py = rotation[1, 0] * mx + rotation[1, 1] * my + rotation[1, 2] * mz + t[1]
        pz = rotation[2, 0] * mx + rotation[2, 1] * my + rotation[2, 2] * mz + t[2]
        xx = xy = xz = yy = yz = zz = 0.0
        for a in range(3):
            ax, ay, az = axes[a]
            cx = rotation[0, 0] * ax + rotation[0, 1] * ay + rotation[0, 2] * az
            cy = rotation[1, 0] * ax + rotation[1, 1] * ay + rotation[1, 2] * az
            cz = rotation[2, 0] * ax + rotation[2, 1] * ay + rotation[2, 2] * az
            precision = 1.0 / (np.float64(scales[k, a]) * scales[k, a])
            xx += precision * cx * cx
            xy += precision * cx * cy
            xz += precision * cx * cz
            yy += precision * cy * cy
            yz += precision * cy * cz
            zz += precision * cz * cz
        out[i] = (
            xx,
            xy,
            xz,
            yy,
            yz,
            zz,
            xx * px + xy * py + xz * pz,
            xy * px + yy * py + yz * pz,
            xz * px + yz * py + zz * pz,
        )


@_kernel
def _gather(footprints, shapes, starts, entries, camera, open_tiles, state, lists):
    """Blend colour and normals front to back, and list each pixel's Gaussians as (alpha, peak depth, 1 / sigma)."""
    tiles_x = (camera.width + TILE - 1) // TILE
    for tile in numba.prange(len(open_tiles)):
        if not open_tiles[tile] or starts[tile] == starts[tile + 1]:
            continue
        top, left = tile // tiles_x * TILE, tile % tiles_x * TILE
        bottom, right = min(top + TILE, camera.height), min(left + TILE, camera.width)
        unfinished = 0
        for row in range(top, bottom):
            for column in range(left, right):
                unfinished += state[tile, TRANSMITTANCE, (row - top) * TILE + column - left] >= ENOUGH
        for e in range(starts[tile], starts[tile + 1]):
            s = footprints[entries[e]]
            xx, xy, xz, yy, yz, zz, bx, by, bz = shapes[entries[e]]
            first_row = max(int(math.ceil(max(s.y - s.reach_y - 0.5, top))), top)
            last_row = int(math.floor(min(s.y + s.reach_y + 0.5, bottom)))
            for row in range(first_row, last_row):
                dy = row + 0.5 - s.y
                middle = s.x + s.slope * dy
                reach = math.sqrt(max(s.cutoff - s.precision_y * dy * dy, 0.0) / s.precision_x)
                first = max(int(math.ceil(max(middle - reach - 0.5, left))), left)
                last = int(math.floor(min(middle + reach + 0.5, right)))
                v = (row + 0.5 - camera.cy) / camera.fy
                for column in range(first, last):
                    p = (row - top) * TILE + column - left
                    before = state[tile, TRANSMITTANCE, p]
                    if before < ENOUGH:
                        continue
                    dx = column + 0.5 - middle
                    falloff = math.exp(HALF * np.float32(s.precision_y * dy * dy + s.precision_x * dx * dx))
                    alpha = min(MAX_ALPHA, s.opacity * falloff)
                    if alpha < MIN_ALPHA:
                        continue
                    u = (column + 0.5 - camera.cx) / camera.fx
                    nx, ny, nz = xx * u + xy * v + xz, xy * u + yy * v + yz, xz * u + yz * v + zz
                    q = nx * u + ny * v + nz
                    weight, after = before * alpha, before * (np.float32(1) - alpha)
                    scale = weight / np.float32(math.sqrt(nx * nx + ny * ny + nz * nz))
                    state[tile, TRANSMITTANCE, p] = after
                    state[tile, COLOR, p] += weight * s.red
                    state[tile, COLOR + 1, p] += weight * s.green
                    state[tile, COLOR + 2, p] += weight * s.blue
                    state[tile, NORMAL, p] -= scale * np.float32(nx)
                    state[tile, NORMAL + 1, p] -= scale * np.float32(ny)
                    state[tile, NORMAL + 2, p] -= scale * np.float32(nz)
                    count = int(state[tile, COUNT, p])
                    if count < LIST and weight > MIN_WEIGHT:
                        lists[tile, p, count, 0] = alpha
                        lists[tile, p, count, 1] = (bx * u + by * v + bz) / q
                        lists[tile, p, count, 2] = math.sqrt(q)
                        state[tile, COUNT, p] = count + 1
                    unfinished -= after < ENOUGH
            if unfinished == 0:
                open_tiles[tile] = False
                break


@_kernel
def _solve(state, lists, camera, level, out):
    """Where each pixel's opacity reaches the level, its normal there, and the spread about it."""
    tiles_x = (camera.width + TILE - 1) // TILE
    for row in numba.prange(camera.height):
        for column in range(camera.width):
            tile = row // TILE * tiles_x + column // TILE
            p = row % TILE * TILE + column % TILE
            alpha = 1 - state[tile, TRANSMITTANCE, p]
            out[row, column, 8] = alpha
            nx, ny, nz = state[tile, NORMAL, p], state[tile, NORMAL + 1, p], state[tile, NORMAL + 2, p]
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            for channel in range(3):
                out[row, column, 1 + channel] = 0
                out[row, column, 5 + channel] = state[tile, COLOR + channel, p] / max(alpha, np.float32(1e-6))
            entries, count = lists[tile, p], int(state[tile, COUNT, p])
            low, high = np.float32(np.inf), np.float32(-np.inf)
            for e in range(count):
                low = min(low, entries[e, 1] - 3 / entries[e, 2])
                high = max(high, entries[e, 1])
            if count == 0 or length == 0 or _opacity(entries, count, high)[0] < level:
                continue
            depth = _reach(entries, count, low, high, (low + high) / 2, level)
            if depth <= camera.near:
                continue
            out[row, column, 0] = depth
            out[row, column, 1], out[row, column, 2], out[row, column, 3] = (
                nx / length,
                ny / length,
                nz / length,
            )
            behind = _reach(entries, count, depth, high, depth, SPREAD_TO)
            out[row, column, 4] = behind - _reach(entries, count, low, depth, depth, SPREAD_FROM)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _reach(entries, count, low, high, start, level):
    """The depth in [low, high] at which the opacity reaches `level`: Newton's steps, halving where they leave."""
    t = start
    for _ in range(12):
        opacity, slope = _opacity(entries, count, t)
        if opacity < level:
            low = t
        else:
            high = t
        step = (level - opacity) / max(slope, np.float32(1e-12))
        previous, t = t, t + step
        if not low < t < high:
            t = (low + high) / 2
        if abs(opacity - level) < TOLERANCE or abs(t - previous) <= np.float32(1e-6) * abs(t):
            break
    return t


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _opacity(entries, count, t):
    """Opacity at depth t, and its derivative."""
    product, slope = np.float32(1), np.float32(0)
    for e in range(count):
        share, beyond = entries[e, 0], (entries[e, 1] - t) * entries[e, 2]
        if beyond > 0:
            if beyond > np.float32(3.5):
                continue
            share *= math.exp(HALF * beyond * beyond)
            slope += share * beyond * entries[e, 2] / (np.float32(1) - share)
        product *= np.float32(1) - share
    return np.float32(1) - product, slope * product
