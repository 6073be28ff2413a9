"""Colour spaces of linear light by their primaries: pictures converted to linear sRGB as they are read, and from it.

Source: SMPTE RP 177, matrices from chromaticities; Lindbloom, "Chromatic Adaptation", Bradford's matrix.
"""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats
from splat2mesh.base.errors import DataWarning
from splat2mesh.base.threads import ROWS_AT_ONCE

Chromaticities = tuple[float, float, float, float, float, float, float, float]
"""x and y of red, green, blue and white, as OpenEXR and Radiance files name them."""

REC709: Chromaticities = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
"""Those of sRGB too. Source: ITU-R BT.709."""

XYZ: Chromaticities = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0 / 3.0, 1.0 / 3.0)

SAME = 1e-5
"""Difference of chromaticities below which a picture keeps its bits: files hold them in single precision or as text."""

FARTHEST = 2.0
"""Coordinates beyond it are no chromaticities: the imaginary primaries of cameras reach 1.1."""

OUTSIDE = float(np.finfo(np.float16).eps)
"""Share of a pixel's brightest channel by which another may be negative: twice the rounding of half floats."""

_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


class ColorSpace(NamedTuple):
    """matrix: (3, 3) float64, from linear sRGB. chromaticities: its own."""

    matrix: NDArray[np.float64]
    chromaticities: Chromaticities


def from_rec709(chromaticities: Sequence[float]) -> NDArray[np.float64] | None:
    """(3, 3) from linear sRGB to a space, white to white by Bradford's adaptation; None where there is none."""
    own, shared = xyz_from_rgb(chromaticities), xyz_from_rgb(REC709)
    if own is None or shared is None:
        return None
    if np.abs(np.subtract(chromaticities, REC709)).max() < SAME:
        return np.eye(3)
    white, wanted = (_BRADFORD @ each.sum(axis=1) for each in (shared, own))
    adapted = np.linalg.solve(_BRADFORD, (wanted / white)[:, None] * _BRADFORD) if (white > 0.0).all() else None
    if adapted is None or (wanted <= 0.0).any():
        return None
    return np.asarray(np.linalg.solve(own, adapted @ shared), np.float64)


def xyz_from_rgb(chromaticities: Sequence[float]) -> NDArray[np.float64] | None:
    """(3, 3) of primaries whose sum is their white of luminance 1, or None."""
    xy = np.array(chromaticities, np.float64)
    if xy.shape != (8,) or not (np.abs(xy) <= FARTHEST).all() or xy[7] <= 0.0:
        return None
    x, y = xy.reshape(4, 2).T
    columns = np.stack([x, y, 1.0 - x - y])
    if abs(np.linalg.det(columns[:, :3])) < SAME:
        return None
    amount = np.linalg.solve(columns[:, :3], columns[:, 3] / y[3])
    return columns[:, :3] * amount if (amount > 0.0).all() else None


def converted(linear: Floats, space: ColorSpace) -> NDArray[np.float32]:
    """Linear sRGB (..., 3) in another space; of sRGB itself to the bit."""
    if np.array_equal(space.matrix, np.eye(3)):
        return np.asarray(linear, np.float32)
    return (np.asarray(linear, np.float64) @ space.matrix.T).astype(np.float32)


def as_rec709(pixels: NDArray[np.float32], chromaticities: Sequence[float], name: object) -> NDArray[np.float32]:
    """Pixels of a file in linear sRGB: (H, W, 3) float32, of sRGB itself to the bit.

    chromaticities: 8 numbers of the file. name: of the file, for messages. Warns about chromaticities that span no
    colours, which are left out, and counts pixels that show colours outside sRGB, which are clipped.
    """
    matrix = from_rec709(chromaticities)
    if matrix is None:
        text = ", ".join(f"{each:.4g}" for each in chromaticities)
        message = f"{name}: its chromaticities ({text}) span no colours, and are ignored: taken as linear sRGB"
        warnings.warn(message, DataWarning, stacklevel=3)
        return pixels
    if np.array_equal(matrix, np.eye(3)):
        return pixels
    inverse, outside = np.linalg.inv(matrix).T, 0
    rows = np.array(pixels, np.float32, order="C").reshape(-1, 3)
    for start in range(0, len(rows), ROWS_AT_ONCE):
        slab = rows[start : start + ROWS_AT_ONCE]
        most = np.finfo(np.float32).max
        own = np.clip(slab, -most, most).astype(np.float64)  # an infinite channel would make NaN of the others
        found = own @ inverse
        low = found.min(axis=1)
        outside += int(np.count_nonzero((low < -OUTSIDE * found.max(axis=1)) & (own >= 0.0).all(axis=1)))
        with np.errstate(over="ignore", invalid="ignore"):
            slab[:] = np.where((found < 0.0) & (own.min(axis=1) >= 0.0)[:, None], 0.0, found)
    if outside:
        message = f"{name}: clipped the colours of {outside:,} of {len(rows):,} pixels, which lie outside sRGB"
        warnings.warn(message, DataWarning, stacklevel=3)
    return rows.reshape(pixels.shape)


_AP1: Chromaticities = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)

SPACES = {
    "srgb": ColorSpace(np.eye(3), REC709),
    "acescg": ColorSpace(np.asarray(from_rec709(_AP1)), _AP1),
}
"""By the word of `--color-space`. Source of sRGB: IEC 61966-2-1. Of ACEScg: S-2014-004 of the Academy, its white
in TB-2018-001."""
