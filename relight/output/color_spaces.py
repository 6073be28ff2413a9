"""Colour spaces that pictures of linear light can be written in: matrices from linear sRGB, and their primaries."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats


class ColorSpace(NamedTuple):
    """matrix: (3, 3) float64, from linear sRGB. chromaticities: x and y of red, green, blue and white, as OpenEXR files
    name them."""

    matrix: NDArray[np.float64]
    chromaticities: tuple[float, float, float, float, float, float, float, float]


SPACES = {
    "srgb": ColorSpace(np.eye(3), (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)),
    "acescg": ColorSpace(
        np.array(
            [
                [0.6130974024, 0.3395231462, 0.0473794514],
                [0.0701937225, 0.9163538791, 0.0134523985],
                [0.0206155929, 0.1095697729, 0.8698146342],
            ]
        ),
        (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767),
    ),
}
"""By the word of `--color-space`. Source of sRGB: IEC 61966-2-1. Of ACEScg: S-2014-004 of the Academy, its white
in TB-2018-001; the matrix goes from D65 to that white by Bradford's adaptation."""


def converted(linear: Floats, space: ColorSpace) -> NDArray[np.float32]:
    """Linear sRGB (..., 3) in another space; of sRGB itself to the bit."""
    if np.array_equal(space.matrix, np.eye(3)):
        return np.asarray(linear, np.float32)
    return (np.asarray(linear, np.float64) @ space.matrix.T).astype(np.float32)
