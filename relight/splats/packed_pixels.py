"""The pixels of runs as they are kept: a bit for each row of the tile, and sixteen bits for each row that has any.

A Gaussian covers a patch of a tile, so that takes about half of the bytes of a list of its pixels.
"""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.kernels import kernel
from splat2mesh.render.footprints import TILE


def packed(
    counts: NDArray[np.uint16],  # (R,) pixels of each run
    pixels: NDArray[np.uint8],  # (I,) within the tile, those of each run ascending
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """(rows (R,), masks (M,)): which rows of the tile each run has, and which columns each of those."""
    rows, masks = np.zeros(len(counts), np.uint16), np.zeros(len(pixels), np.uint16)
    return rows, masks[: _pack(counts, pixels, rows, masks)].copy()


def unpacked(rows: NDArray[np.uint16], masks: NDArray[np.uint16]) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """(counts, pixels) of what `packed` gave. Raises InputError for what it cannot have given."""
    if rows.dtype != np.uint16 or masks.dtype != np.uint16 or rows.ndim != 1 or masks.ndim != 1:
        raise InputError("kept pixels are of another kind")
    if int(np.bitwise_count(rows).sum(dtype=np.int64)) != len(masks):
        raise InputError("kept pixels do not fit together")
    counts, pixels = (
        np.zeros(len(rows), np.uint16),
        np.zeros(int(np.bitwise_count(masks).sum(dtype=np.int64)), np.uint8),
    )
    _unpack(rows, masks, counts, pixels)
    return counts, pixels


@kernel
def _pack(
    counts: NDArray[np.uint16], pixels: NDArray[np.uint8], rows: NDArray[np.uint16], masks: NDArray[np.uint16]
) -> int:
    item, used = 0, -1
    for run in range(len(counts)):
        held, last = 0, -1
        for _ in range(counts[run]):
            row, column = pixels[item] // TILE, pixels[item] % TILE
            if row != last:
                held |= 1 << row
                last = row
                used += 1
            masks[used] |= np.uint16(1 << column)
            item += 1
        rows[run] = held
    return used + 1


@kernel
def _unpack(
    rows: NDArray[np.uint16], masks: NDArray[np.uint16], counts: NDArray[np.uint16], pixels: NDArray[np.uint8]
) -> None:
    item, used = 0, 0
    for run in range(len(rows)):
        before = item
        for row in range(TILE):
            if rows[run] >> row & 1:
                mask = np.int64(masks[used])
                used += 1
                column = 0
                while mask:
                    if mask & 1:
                        pixels[item] = row * TILE + column
                        item += 1
                    mask >>= 1
                    column += 1
        counts[run] = item - before
