"""The unused texels between charts take the values around, since filtering and compression mix them in."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Indices


def filled(
    size: int,
    texels: Indices,  # (T,) row * size + column
    values: NDArray[Any],  # (T, C), of any number
) -> NDArray[Any]:
    """The picture (size, size, C) of some texels; each other one has the mean of those in the smallest block of two,
    four, eight ... texels a side that holds any."""
    known = np.zeros((size, size), np.float32)
    image = np.zeros((size, size, values.shape[1]), values.dtype)
    image.reshape(-1, values.shape[1])[texels], known.reshape(-1)[texels] = values, 1.0
    row, column = np.nonzero(known == 0.0)
    levels, level = [known, *np.moveaxis(image, 2, 0)], 0
    while len(row) and len(levels[0]) > 1:
        levels, level = [_halved(each) for each in levels], level + 1
        place = (row >> level) * len(levels[0]) + (column >> level)
        count = levels[0].ravel()[place]
        held = count > 0.0
        for channel, sums in enumerate(levels[1:]):
            mean = sums.ravel()[place[held]] / count[held]
            image[row[held], column[held], channel] = mean if image.dtype.kind == "f" else np.rint(mean)
        row, column = row[~held], column[~held]
    return image


def _halved(sums: NDArray[Any]) -> NDArray[np.float32]:
    """Sums (H, H) over blocks twice as wide."""
    odd = len(sums) % 2
    sums = np.pad(sums, (0, odd)) if odd else sums
    rows = np.add(sums[::2], sums[1::2], dtype=np.float32)
    return np.asarray(rows[:, ::2] + rows[:, 1::2])
