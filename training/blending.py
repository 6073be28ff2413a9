"""Pictures of splats and the gradients of their footprints: what training needs of the rasteriser, on the CPU.

Blending as in `splat2mesh.render.rasterize`. Gradients are found front to back too, from the sums of what lies behind.
"""

import math
from typing import NamedTuple

import numba
import numpy as np

from splat2mesh.base.threads import shared
from splat2mesh.render.footprints import TILE, camera_of, footprint_batches, pixel_range
from splat2mesh.render.rasterize import MAX_ALPHA, MIN_TRANSMITTANCE
from splat2mesh.render.screentiles import AREA

PARTS = "x", "y", "slope", "precision_x", "precision_y", "opacity", "red", "green", "blue"
"""Fields of a footprint that have gradients, in their order."""

kernel = numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")


class Drawn(NamedTuple):
    """A picture and what its gradients need. picture: (H, W, 3) float32 over black, sRGB. batches: of the rasteriser.
    camera: its Camera."""

    picture: np.ndarray
    batches: list
    camera: tuple


def draw(splats, view):
    """The picture of splats from a view: a Drawn."""
    camera = camera_of(view)
    down, across = -(-camera.height // TILE), -(-camera.width // TILE)
    color = np.zeros((down * across, AREA, 3), np.float32)
    light, free = np.ones((down * across, AREA), np.float32), np.ones(down * across, np.bool_)
    batches = []
    for batch in footprint_batches(splats, camera, free):
        batches.append(batch)
        _blend(len(free), batch.footprints, batch.starts, batch.entries, across, color, light, free)
    return Drawn(_image(color, camera), batches, camera)


def gradients(drawn, of_picture):
    """(rows (M,) of the splats that are drawn, (M, 9) float32 gradients of PARTS) of a loss.

    of_picture: (H, W, 3), the gradient of the loss by the picture.
    """
    camera, across = drawn.camera, -(-drawn.camera.width // TILE)
    slope = _in_tiles(np.ascontiguousarray(of_picture, np.float32), camera)
    behind = (slope * _in_tiles(drawn.picture, camera)).sum(axis=2)
    light = np.ones(behind.shape, np.float32)
    rows, found = [], []
    for batch in drawn.batches:
        each = np.zeros((len(batch.entries), len(PARTS)), np.float32)
        asked = batch.footprints, batch.starts, batch.entries, across, slope, behind, light, each
        _gradients(len(light), *asked)
        count = len(batch.order)
        sums = [np.bincount(batch.entries, each[:, part], count) for part in range(len(PARTS))]
        rows.append(batch.order)
        found.append(np.stack(sums, axis=1).astype(np.float32))
    rows, found = np.concatenate(rows), np.concatenate(found)
    moved = found.any(axis=1)
    return rows[moved], found[moved]


def _image(tiles, camera):
    down, across = -(-camera.height // TILE), -(-camera.width // TILE)
    whole = tiles.reshape(down, across, TILE, TILE, -1).transpose(0, 2, 1, 3, 4)
    return np.ascontiguousarray(whole.reshape(down * TILE, across * TILE, -1)[: camera.height, : camera.width])


def _in_tiles(image, camera):
    down, across = -(-camera.height // TILE), -(-camera.width // TILE)
    whole = np.zeros((down * TILE, across * TILE, image.shape[2]), np.float32)
    whole[: camera.height, : camera.width] = image
    tiles = whole.reshape(down, TILE, across, TILE, -1).transpose(0, 2, 1, 3, 4)
    return np.ascontiguousarray(tiles.reshape(down * across, AREA, -1))


@kernel
def _row_of(s, row, left):
    """A footprint in a pixel row: its distance from the middle, what that adds to q, where the row's middle lies, and
    the pixels (start, stop) of a tile that it reaches."""
    dy = row + 0.5 - s.y
    q_y = s.precision_y * dy * dy
    middle = s.x + s.slope * dy
    chord = math.sqrt(max(s.cutoff - q_y, 0.0) / s.precision_x)
    start, stop = pixel_range(middle - chord, middle + chord, left, left + TILE)
    return dy, q_y, middle, start, stop


@shared
@kernel
def _blend(begin, end, footprints, starts, entries, across, color, light, free):
    for tile in range(begin, end):
        top, left = tile // across * TILE, tile % across * TILE
        for e in range(starts[tile], starts[tile + 1]):
            s = footprints[entries[e]]
            first, last = pixel_range(s.y - s.reach_y, s.y + s.reach_y, top, top + TILE)
            for row in range(first, last):
                _, q_y, middle, start, stop = _row_of(s, row, left)
                for column in range(start, stop):
                    i = (row - top) * TILE + column - left
                    before = light[tile, i]
                    if before < MIN_TRANSMITTANCE:
                        continue
                    u = column + 0.5 - middle
                    alpha = min(s.opacity * np.float32(math.exp(-0.5 * (q_y + s.precision_x * u * u))), MAX_ALPHA)
                    color[tile, i, 0] += before * alpha * s.red
                    color[tile, i, 1] += before * alpha * s.green
                    color[tile, i, 2] += before * alpha * s.blue
                    light[tile, i] = before * (np.float32(1.0) - alpha)
        if free[tile] and light[tile].max() < MIN_TRANSMITTANCE:
            free[tile] = False


@shared
@kernel
def _gradients(begin, end, footprints, starts, entries, across, slope, behind, light, found):
    """Gradients (E, 9) of each entry. slope: (T, AREA, 3) of the loss by each pixel. behind: (T, AREA) the colours of
    what is not yet drawn, times that; light: (T, AREA) transmittance before it. Both are carried on."""
    for tile in range(begin, end):
        top, left = tile // across * TILE, tile % across * TILE
        for e in range(starts[tile], starts[tile + 1]):
            s = footprints[entries[e]]
            gx = gy = gs = gpx = gpy = go = gr = gg = gb = 0.0
            first, last = pixel_range(s.y - s.reach_y, s.y + s.reach_y, top, top + TILE)
            for row in range(first, last):
                dy, q_y, middle, start, stop = _row_of(s, row, left)
                for column in range(start, stop):
                    i = (row - top) * TILE + column - left
                    before = light[tile, i]
                    if before < MIN_TRANSMITTANCE:
                        continue
                    u = column + 0.5 - middle
                    bell = math.exp(-0.5 * (q_y + s.precision_x * u * u))
                    alpha = min(s.opacity * bell, MAX_ALPHA)
                    weight = before * alpha
                    r, g, b = slope[tile, i, 0], slope[tile, i, 1], slope[tile, i, 2]
                    own = s.red * r + s.green * g + s.blue * b
                    rest = behind[tile, i] - weight * own
                    behind[tile, i] = rest
                    light[tile, i] = before * (1.0 - alpha)
                    gr += weight * r
                    gg += weight * g
                    gb += weight * b
                    if alpha >= MAX_ALPHA:
                        continue
                    by_alpha = before * own - rest / (1.0 - alpha)
                    go += by_alpha * bell
                    by_q = -0.5 * alpha * by_alpha
                    steep = s.precision_x * u
                    gpx += by_q * u * u
                    gpy += by_q * dy * dy
                    gs -= 2.0 * by_q * steep * dy
                    gx -= 2.0 * by_q * steep
                    gy += 2.0 * by_q * (steep * s.slope - s.precision_y * dy)
            out = found[e]
            out[0], out[1], out[2], out[3], out[4] = gx, gy, gs, gpx, gpy
            out[5], out[6], out[7], out[8] = go, gr, gg, gb
