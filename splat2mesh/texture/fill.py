"""The unused texels between charts take the colours around, since filtering and compression mix them in."""

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import ColorsSrgb, Indices
from ..base.kernels import kernel


def filled(
    size: int,
    texels: Indices,  # (T,) row * size + column
    colors: ColorsSrgb,  # (T, 3)
) -> NDArray[np.uint8]:
    """The picture (size, size, 3) of some texels; each other one has the mean of those in the smallest block of two,
    four, eight ... texels a side that holds any."""
    image, known = np.zeros((size, size, 3), np.uint8), np.zeros((size, size), np.uint8)
    image.reshape(-1, 3)[texels] = colors
    known.reshape(-1)[texels] = 1
    holes = np.flatnonzero(known.ravel() == 0)
    side, step = (size + 1) // 2, 2
    level = np.zeros((side, side, 4), np.float32)
    _first_level(image, known, level)
    while len(holes):
        holes = holes[: _fill(image, level, step, holes)]
        if side == 1:
            break
        side, step = (side + 1) // 2, 2 * step
        coarse = np.zeros((side, side, 4), np.float32)
        _next_level(level, coarse)
        level = coarse
    return image


@kernel
def _first_level(image: ColorsSrgb, known: NDArray[np.uint8], level: NDArray[np.float32]) -> None:
    """Sums of colours, and their number, over blocks of two texels a side: (H, H, 4)."""
    size = len(known)
    for column_part in range(2):
        for row_part in range(2):
            for row in range(row_part, size, 2):
                for column in range(column_part, size, 2):
                    if known[row, column]:
                        for c in range(3):
                            level[row >> 1, column >> 1, c] += np.float32(image[row, column, c])
                        level[row >> 1, column >> 1, 3] += np.float32(1.0)


@kernel
def _next_level(level: NDArray[np.float32], coarse: NDArray[np.float32]) -> None:
    """The same over blocks twice as wide."""
    side = len(level)
    for column_part in range(2):
        for row_part in range(2):
            for row in range(row_part, side, 2):
                for column in range(column_part, side, 2):
                    for c in range(4):
                        coarse[row >> 1, column >> 1, c] += level[row, column, c]


@kernel
def _fill(image: ColorsSrgb, level: NDArray[np.float32], step: int, holes: Indices) -> int:
    """Fill the holes whose blocks hold any colour; the others stand first then, and their number is returned."""
    size, left = len(image), 0
    for i in range(len(holes)):
        row, column = holes[i] // size, holes[i] % size
        a, b = row // step, column // step
        if level[a, b, 3] > np.float32(0.0):
            for c in range(3):
                image[row, column, c] = np.uint8(np.rint(level[a, b, c] / level[a, b, 3]))
        else:
            holes[left] = holes[i]
            left += 1
    return left
