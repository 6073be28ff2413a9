"""The weight of every Gaussian in every pixel of a view, in lists of tiles, as `splat2mesh.render.rasterize` draws."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Integers, Mask
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import shared
from splat2mesh.render.footprints import TILE, Footprint, camera_of, footprint_batches
from splat2mesh.render.rasterize import CLOSING_INTERVAL, HALF, MAX_ALPHA, MIN_TRANSMITTANCE, ONE, ZERO, exp_minus_half
from splat2mesh.render.screentiles import AREA, ScreenTiles
from splat2mesh.render.view import View
from splat2mesh.splats.splats import Splats

LEAST_SHARE = np.float32(1 / 512)
"""Least contribution of a Gaussian to a pixel; smaller ones are left out, on both sides of a comparison of pictures."""

MOST_ITEMS = round(AREA / float(LEAST_SHARE))
"""Most shares of a tile; no pixel has more."""

LARGEST = np.float32(np.iinfo(np.uint8).max)
"""Shares are kept as their square roots in whole parts of it: within 9% at LEAST_SHARE, 0.4% at 1."""

SHARES = (np.arange(LARGEST + 1, dtype=np.float32) / LARGEST) ** 2
"""The shares that they are."""


LIGHT, MEDIAN, PLANES = np.uint64(0), np.uint64(AREA), 2  # what is kept of a tile's pixels while they are walked


Lists: TypeAlias = tuple[Integers, ...]
"""Of a view's tiles: number of runs and items of each, then `splats`, `counts`, `pixels` and `shares` of a Blending."""


def in_tiles(image: NDArray[Any]) -> NDArray[Any]:
    """An image (H, W, ...) as pixels of tiles, (P, ...), zeros beyond its edges."""
    height, width, *rest = image.shape
    tiles_y, tiles_x = -(-height // TILE), -(-width // TILE)
    whole = np.zeros((tiles_y * TILE, tiles_x * TILE, *rest), image.dtype)
    whole[:height, :width] = image
    return whole.reshape(tiles_y, TILE, tiles_x, TILE, *rest).swapaxes(1, 2).reshape(-1, *rest)


def listed(splats: Splats, view: View, near: float) -> tuple[Lists, NDArray[np.float32], NDArray[np.float32]]:
    """((runs and items of each tile, splats, counts, pixels, shares), alpha (H, W), median depth (H, W)) of a view."""
    camera = camera_of(view, near)
    tiles = ScreenTiles.empty(camera, PLANES, transmittance=0, median=1)
    count = len(tiles.open)
    found, left = [], np.full(count, MOST_ITEMS, np.int64)
    for batch in footprint_batches(splats, camera, tiles.open):
        wanted = np.where(tiles.open, np.minimum(AREA * np.diff(batch.starts), left), 0)
        begins = np.append(0, np.cumsum(wanted))
        raw = np.empty(begins[-1], np.uint8), np.empty(begins[-1], np.uint8)  # memory is taken as it is written
        number, shared = np.empty(len(batch.entries), np.int32), np.empty(len(batch.entries), np.uint16)
        used, ran = np.zeros(count, np.int64), np.zeros(count, np.int64)
        lists = batch.footprints, batch.starts, batch.entries, tiles.dealt, tiles.open, tiles.across, tiles.pixels
        _record(count, *lists, begins, *raw, number, shared, used, ran)
        packed = [np.empty(ran.sum(), np.int32), np.empty(ran.sum(), np.uint16)]
        packed += [np.empty(used.sum(), np.uint8), np.empty(used.sum(), np.uint8)]
        _pack(batch.starts, ran, number, packed[0])
        _pack(batch.starts, ran, shared, packed[1])
        _pack(begins, used, raw[0], packed[2])
        _pack(begins, used, raw[1], packed[3])
        packed[0] = batch.order[packed[0]].astype(np.int32)
        found.append((ran, used, *packed))
        left -= used
    images = tiles.images(camera)
    return _merged(found, count), 1 - images[0], images[1].copy()


def _merged(found: list[Lists], tiles: int) -> Lists:
    """Batch after batch of tiles' lists as the lists of the tiles: the same fields."""
    runs = sum((each[0] for each in found), np.zeros(tiles, np.int64))
    items = sum((each[1] for each in found), np.zeros(tiles, np.int64))
    result = []
    for field, (counts, totals, kind) in enumerate(
        ((0, runs, np.int32), (0, runs, np.uint16), (1, items, np.uint8), (1, items, np.uint8))
    ):
        whole, cursor = np.empty(totals.sum(), kind), np.append(0, np.cumsum(totals))[:-1]
        for each in found:
            _lay(each[2 + field], each[counts], cursor, whole)
        result.append(whole)
    return runs, items, *result


def within(part: Lists, wanted: Mask) -> Lists:
    """The lists of a view's tiles with nothing but the pixels wanted, (P,) bool."""
    runs, items, *lists = part
    left, held = np.zeros_like(runs), np.zeros_like(items)
    ends = _drop(runs, items, wanted, *lists, left, held)
    return left, held, *(each[:end].copy() for each, end in zip(lists, np.repeat(ends, 2), strict=True))


@kernel
def _drop(
    runs: NDArray[np.int64],
    items: NDArray[np.int64],
    wanted: Mask,
    splats: NDArray[np.int32],
    counts: NDArray[np.uint16],
    pixels: NDArray[np.uint8],
    shares: NDArray[np.uint8],
    left: NDArray[np.int64],
    held: NDArray[np.int64],
) -> tuple[int, int]:
    """Move what is wanted of all lists to their beginnings: how many runs and items that is."""
    run, item, to_run, to_item = 0, 0, 0, 0
    for tile in range(len(runs)):
        first_run, first_item = to_run, to_item
        for _ in range(runs[tile]):
            splat, before = splats[run], to_item
            for _ in range(counts[run]):
                if wanted[tile * AREA + pixels[item]]:
                    pixels[to_item], shares[to_item] = pixels[item], shares[item]
                    to_item += 1
                item += 1
            if to_item > before:
                splats[to_run], counts[to_run] = splat, to_item - before
                to_run += 1
            run += 1
        left[tile], held[tile] = to_run - first_run, to_item - first_item
    return to_run, to_item


@shared
@kernel
def _record(
    begin: int,
    end: int,
    footprints: NDArray[np.void],
    starts: Integers,
    entries: Integers,
    dealt: Integers,
    open_tiles: Mask,
    tiles_x: int,
    block: NDArray[np.float32],
    begins: NDArray[np.int64],
    pixels: NDArray[np.uint8],
    shares: NDArray[np.uint8],
    number: NDArray[np.int32],
    count: NDArray[np.uint16],
    used: NDArray[np.int64],
    ran: NDArray[np.int64],
) -> None:
    """Note what each footprint gives each open tile from begins[tile] and starts[tile] on, and how much that was."""
    for deal in range(begin, end):
        tile = dealt[deal]
        if not open_tiles[tile]:
            continue
        top, left = tile // tiles_x * TILE, tile % tiles_x * TILE
        mine, lane = block[tile], np.zeros(TILE, np.float32)
        at, run = begins[tile], starts[tile]
        for e in range(starts[tile], starts[tile + 1]):
            s = footprints[entries[e]]
            before = at
            first = int(min(max(np.ceil(s.y - s.reach_y - 0.5), top), top + TILE))
            last = int(max(min(np.floor(s.y + s.reach_y + 0.5), top + TILE), top))
            for row in range(first, last):
                dy = row + 0.5 - s.y
                q_y = np.float32(s.precision_y * dy * dy)
                dx = np.float32(left + 0.5 - s.x - s.slope * dy)
                _row(mine, np.uint64((row - top) * TILE), s, q_y, dx, lane)
                for column in range(TILE):
                    if lane[column] >= LEAST_SHARE and at < begins[tile + 1]:
                        pixels[at] = (row - top) * TILE + column
                        shares[at] = np.uint8(np.sqrt(lane[column]) * LARGEST + HALF)
                        at += 1
            if at > before:
                number[run], count[run] = entries[e], at - before
                run += 1
            if e % CLOSING_INTERVAL == 0 and not _any_open(mine):
                open_tiles[tile] = False
                break
        used[tile], ran[tile] = at - begins[tile], run - starts[tile]


@kernel
def _row(
    block: NDArray[np.float32], first: int, s: Footprint, q_y: float, dx: float, lane: NDArray[np.float32]
) -> None:
    """Shares of a footprint in the pixel row at `first`; like `rasterize`'s own without a branch."""
    precision, cutoff, opacity, depth = np.float32(s.precision_x), np.float32(s.cutoff), s.opacity, s.depth
    for column in range(np.uint64(TILE)):
        i = first + column
        offset = dx + np.float32(column)
        q = q_y + precision * offset * offset
        before = block[LIGHT + i]
        alpha = min(opacity * exp_minus_half(q), MAX_ALPHA)
        alpha = alpha if (q <= cutoff) & (before >= MIN_TRANSMITTANCE) else ZERO
        after = before * (ONE - alpha)
        lane[column] = before * alpha
        median = block[MEDIAN + i]
        block[MEDIAN + i] = depth if (before > HALF) & (after <= HALF) else median
        block[LIGHT + i] = after


@kernel
def _any_open(block: NDArray[np.float32]) -> bool:
    unfinished = 0
    for i in range(np.uint64(AREA)):
        unfinished += block[i] >= MIN_TRANSMITTANCE
    return unfinished > 0


@kernel
def _pack(begins: NDArray[np.int64], used: NDArray[np.int64], values: Integers, packed: Integers) -> None:
    """The used beginnings of the tiles' parts, end to end."""
    at = 0
    for tile in range(len(used)):
        for i in range(used[tile]):
            packed[at] = values[begins[tile] + i]
            at += 1


@kernel
def _lay(values: Integers, counts: NDArray[np.int64], cursor: NDArray[np.int64], whole: Integers) -> None:
    """Copy each tile's part to where its cursor stands, and move that on."""
    at = 0
    for tile in range(len(counts)):
        for i in range(counts[tile]):
            whole[cursor[tile] + i] = values[at]
            at += 1
        cursor[tile] += counts[tile]
