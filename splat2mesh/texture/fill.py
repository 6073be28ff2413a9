"""The unused texels between charts take the colours around, since filtering and compression mix them in."""

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import ColorsSrgb, Indices


def filled(
    size: int,
    texels: Indices,  # (T,) row * size + column
    colors: ColorsSrgb,  # (T, 3)
) -> NDArray[np.uint8]:
    """The picture (size, size, 3) of some texels; each other one has the mean of those in the smallest block of two,
    four, eight ... texels a side that holds any."""
    image, known = np.zeros((size, size, 3), np.uint8), np.zeros((size, size), bool)
    image.reshape(-1, 3)[texels] = colors
    known.reshape(-1)[texels] = True
    side = size + size % 2
    pad = ((0, side - size), (0, side - size))
    weights = np.pad(known, pad).astype(np.float32)
    total = np.pad(image, (*pad, (0, 0))).astype(np.float32) * weights[..., None]
    step = 1
    rows, columns = np.nonzero(~known)
    while len(rows) and side > 1:
        side, step = side // 2, 2 * step
        weights, total = _halved(weights), _halved(total)
        there = weights[rows // step, columns // step]
        done = there > 0.0
        at = rows[done] // step, columns[done] // step
        image[rows[done], columns[done]] = np.rint(total[at] / weights[at][:, None]).astype(np.uint8)
        rows, columns = rows[~done], columns[~done]
        if side % 2 and side > 1:
            weights, total = np.pad(weights, ((0, 1), (0, 1))), np.pad(total, ((0, 1), (0, 1), (0, 0)))
            side += 1
    return image


def _halved(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return values[::2, ::2] + values[1::2, ::2] + values[::2, 1::2] + values[1::2, 1::2]
