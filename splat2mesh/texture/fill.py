"""The unused texels between charts take the values around, since filtering and compression mix them in."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Indices
from ..base.kernels import kernel
from ..base.threads import shared


def filled(
    size: int,
    texels: Indices,  # (T,) row * size + column, ascending
    values: NDArray[Any],  # (T, C), of any number
) -> NDArray[Any]:
    """The picture (size, size, C) of some texels; each other one has the mean of those in the smallest block of two,
    four, eight ... texels a side that holds any."""
    half, channels = (size + 1) // 2, values.shape[1]
    sums = np.zeros((channels + 1, half, half), np.float32)
    ends = np.searchsorted(texels, np.arange(half + 1) * 2 * size)
    _sum(half, texels, ends, values.astype(np.float32), size, sums)
    levels = [sums]
    while levels[-1].shape[-1] > 1:
        levels.append(_halved(levels[-1]))
    means = np.zeros((channels, 1, 1), np.float32)
    for level in reversed(levels):
        side = level.shape[-1]
        around = means.repeat(2, axis=1).repeat(2, axis=2)[:, :side, :side]
        means = np.where(level[-1] > 0.0, level[:-1] / np.maximum(level[-1], 1.0), around)
    shown = (means if values.dtype.kind == "f" else np.rint(means)).astype(values.dtype)
    image = np.empty((size, size, channels), values.dtype)
    bits = f"u{values.dtype.itemsize}"  # a kernel knows no half floats
    _paint(size, shown.view(bits), image.view(bits))
    image.reshape(-1, channels)[texels] = values
    return image


def _halved(sums: Floats) -> Floats:
    """Sums (C, H, H) over blocks twice as wide."""
    odd = sums.shape[-1] % 2
    sums = np.pad(sums, ((0, 0), (0, odd), (0, odd))) if odd else sums
    rows = sums[:, ::2] + sums[:, 1::2]
    return np.asarray(rows[:, :, ::2] + rows[:, :, 1::2])


@shared
@kernel
def _sum(begin: int, end: int, texels: Indices, ends: Indices, values: Floats, size: int, sums: Floats) -> None:
    """Add the values of texels, and ones after them, to their blocks of two by two."""
    for row in range(begin, end):
        for t in range(ends[row], ends[row + 1]):
            column = texels[t] % size // 2
            for channel in range(values.shape[1]):
                sums[channel, row, column] += values[t, channel]
            sums[-1, row, column] += np.float32(1.0)


@shared
@kernel
def _paint(begin: int, end: int, blocks: NDArray[Any], image: NDArray[Any]) -> None:
    for row in range(begin, end):
        for column in range(image.shape[1]):
            for channel in range(image.shape[2]):
                image[row, column, channel] = blocks[channel, row // 2, column // 2]
