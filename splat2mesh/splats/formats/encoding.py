"""Encodings that several formats share: opacity logits, colours as coefficients, packed quaternions."""

import os
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.errors import DataWarning
from ..cleaning import sound
from ..harmonics import SH_C0
from ..splats import Splats

_IDENTITY_WXYZ = np.array([1, 0, 0, 0], np.float32)


def sigmoid(logits: NDArray[Any]) -> NDArray[Any]:
    """Return the opacities of logits. logits: any shape. In [0, 1]; infinite logits give exactly 0 and 1, NaN stays
    NaN."""
    return 1 / (1 + np.exp(-logits))


def logit(opacities: ArrayLike) -> NDArray[np.float64]:
    """Return the logits of opacities. opacities: any shape, in [0, 1]. Returns float64: finite: 0 and 1 count as their
    neighbours in float32."""
    info = np.finfo(np.float32)
    p = np.clip(np.asarray(opacities, np.float64), info.tiny, 1 - info.epsneg)
    return np.log(p) - np.log1p(-p)


def sh_from_color(color_srgb: NDArray[Any]) -> NDArray[np.float32]:
    """Return the constant coefficients of colours. color_srgb: any shape, sRGB. Returns float32: the same shape."""
    return ((color_srgb - 0.5) / SH_C0).astype(np.float32)


def color_from_sh(dc: ArrayLike) -> NDArray[np.float64]:
    """Return the colours of constant coefficients. dc: any shape. Returns float64: the same shape, sRGB, not
    clipped."""
    return np.asarray(dc, np.float64) * SH_C0 + 0.5


def restore_largest(small: NDArray[Any], largest: NDArray[Any]) -> NDArray[np.float32]:
    """Restore unit quaternions from their three smaller components ("smallest three").

    small: (N, 3), the components that are left, in their order. largest: (N,) integers, 0 to 3, the place of the one
    left out. Returns (N, 4) float32: in the same order, the restored component positive.
    """
    quats = np.zeros((len(small), 4), np.float32)
    places = np.arange(3) + (np.arange(3) >= largest[:, None])
    np.put_along_axis(quats, places, small.astype(np.float32), axis=1)
    rest = np.sqrt(np.maximum(0, 1 - np.einsum("ij,ij->i", small, small))).astype(np.float32)
    np.put_along_axis(quats, largest[:, None].astype(np.intp), rest[:, None], axis=1)
    return quats


def smallest_three(quats: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Take unit quaternions apart into what `restore_largest` takes.

    quats: (N, 4). Returns small: (N, 3), the sign is chosen such that the component left out is positive; largest: (N,)
    intp, place of the one left out, of equal ones the first.
    """
    largest = np.abs(quats).argmax(axis=1)
    sign = np.where(np.take_along_axis(quats, largest[:, None], axis=1) < 0, -1, 1)
    places = np.arange(3) + (np.arange(3) >= largest[:, None])
    return sign * np.take_along_axis(quats, places, axis=1), largest


def levels(fractions: ArrayLike, bits: int) -> NDArray[np.uint32]:
    """Round shares of a range to the nearest of 2^bits levels. fractions: any shape; those outside [0, 1] count as its
    ends. Returns uint32."""
    limit = (1 << bits) - 1
    return np.rint(np.clip(fractions, 0, 1) * limit).astype(np.uint32)


def hide_unusable(splats: Splats, path: str | os.PathLike[str]) -> tuple[Splats, NDArray[np.bool_]]:
    """Replace rows that a quantised format cannot hold, so row i stays splat i.

    path: of the file, for the warning. Returns splats: rows that no renderer draws (a value that is not finite, a
    length beyond `ABSURD_LENGTH`, no extent, a zero quaternion) are transparent splats at the origin; usable: (N,)
    bool, the other rows. Warns with a DataWarning with the number of rows replaced.
    """
    n, usable = len(splats), sound(splats)
    if usable.all():
        return splats, usable
    lost = n - np.count_nonzero(usable)
    message = f"{path}: {lost} of {n} splats have invalid values and were written as transparent"
    warnings.warn(message, DataWarning, stacklevel=4)
    means, scales, opacities, sh = (
        np.where(usable.reshape(-1, *[1] * (value.ndim - 1)), value, 0)
        for value in (splats.means, splats.scales, splats.opacities, splats.sh)
    )
    quats = np.where(usable[:, None], splats.quats_wxyz, _IDENTITY_WXYZ)
    return Splats(means, scales, quats, opacities, sh, facts=splats.facts), usable


def warn_clipped(clipped: NDArray[np.bool_], path: str | os.PathLike[str], what: str) -> None:
    """Count, in one DataWarning, the rows whose values a format cannot hold. clipped: (N, ...) bool. path: of the file.
    what: what the values are."""
    rows = np.count_nonzero(clipped.reshape(len(clipped), -1).any(axis=1))
    if rows:
        warnings.warn(f"{path}: {what} of {rows} of {len(clipped)} splats were clipped", DataWarning, stacklevel=4)


def warn_beyond(path: str | os.PathLike[str], count: int, degree: int) -> None:
    """Count, in one DataWarning, the splats whose harmonics beyond the third degree are left out. path: of the file.
    count: of its splats. degree: of their harmonics."""
    message = f"{path}: dropped the harmonics above degree 3 of {count} splats, whose degree is {degree}"
    warnings.warn(message, DataWarning, stacklevel=4)
