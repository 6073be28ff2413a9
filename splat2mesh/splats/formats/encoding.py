"""Encodings that several formats share: opacity logits, colours as coefficients, packed quaternions."""

import os
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.errors import DataWarning
from ..splats import ABSURD_LENGTH, SH_C0, Splats

_IDENTITY_WXYZ = np.array([1, 0, 0, 0], np.float32)


def sigmoid(logits: NDArray[Any]) -> NDArray[Any]:
    """Opacities in [0, 1] of logits, any shape; infinite logits give exactly 0 and 1, NaN stays NaN."""
    return 1 / (1 + np.exp(-logits))


def logit(opacities: ArrayLike) -> NDArray[np.float64]:
    """Finite float64 logits of opacities in [0, 1], any shape; 0 and 1 count as their neighbours."""
    info = np.finfo(np.float32)
    p = np.clip(np.asarray(opacities, np.float64), info.tiny, 1 - info.epsneg)
    return np.log(p) - np.log1p(-p)


def sh_from_color(color_srgb: NDArray[Any]) -> NDArray[np.float32]:
    """The constant coefficient whose colour is `color_srgb`: any shape in, same shape float32 out."""
    return ((color_srgb - 0.5) / SH_C0).astype(np.float32)


def color_from_sh(dc: ArrayLike) -> NDArray[np.float64]:
    """The colour of a constant coefficient, sRGB and not clipped: any shape in, same shape float64 out."""
    return np.asarray(dc, np.float64) * SH_C0 + 0.5


def restore_largest(small: NDArray[Any], largest: NDArray[Any]) -> NDArray[np.float32]:
    """Unit quaternions from their three smaller components ("smallest three").

    small: (N, 3) the components that are left, in their order. largest: (N,) integer 0..3, the place of the
    one left out. Returns (N, 4) float32 in the same order, the restored component positive.
    """
    quats = np.zeros((len(small), 4), np.float32)
    places = np.arange(3) + (np.arange(3) >= largest[:, None])
    np.put_along_axis(quats, places, small.astype(np.float32), axis=1)
    rest = np.sqrt(np.maximum(0, 1 - np.einsum("ij,ij->i", small, small))).astype(np.float32)
    np.put_along_axis(quats, largest[:, None].astype(np.intp), rest[:, None], axis=1)
    return quats


def smallest_three(quats: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """What `restore_largest` takes, of unit quaternions: (N, 4) -> small (N, 3), largest (N,).

    The sign is chosen such that the component left out is positive; of equal ones the first is left out.
    """
    largest = np.abs(quats).argmax(axis=1)
    sign = np.where(np.take_along_axis(quats, largest[:, None], axis=1) < 0, -1, 1)
    places = np.arange(3) + (np.arange(3) >= largest[:, None])
    return sign * np.take_along_axis(quats, places, axis=1), largest


def levels(fractions: ArrayLike, bits: int) -> NDArray[np.uint32]:
    """Shares of a range, any shape, as the nearest of 2^bits levels: uint32; those outside [0, 1] count as its ends."""
    limit = (1 << bits) - 1
    return np.rint(np.clip(fractions, 0, 1) * limit).astype(np.uint32)


def hide_unusable(splats: Splats, path: str | os.PathLike[str]) -> tuple[Splats, NDArray[np.bool_]]:
    """Splats of the same number whose every value a quantised format can hold, and which rows were usable: (N,) bool.

    Rows that no renderer draws (a value that is not finite, a length beyond ABSURD_LENGTH, no extent, a zero
    quaternion) become transparent ones at the origin, so that row i stays splat i; a DataWarning counts them.
    """
    n = len(splats)
    values = (splats.means, splats.scales, splats.quats_wxyz, splats.opacities, splats.sh)
    usable = np.logical_and.reduce([np.isfinite(value.reshape(n, -1)).all(axis=1) for value in values])
    with np.errstate(invalid="ignore"):
        usable &= (np.abs(splats.means).max(axis=1) <= ABSURD_LENGTH) & splats.quats_wxyz.any(axis=1)
        usable &= (splats.scales.min(axis=1) >= 0) & (splats.scales.max(axis=1) > 0)
        usable &= splats.scales.max(axis=1) <= ABSURD_LENGTH
    if usable.all():
        return splats, usable
    lost = n - np.count_nonzero(usable)
    message = f"{path}: {lost} of {n} splats hold no finite, useful values and were written as transparent ones"
    warnings.warn(message, DataWarning, stacklevel=4)
    means, scales, opacities, sh = (
        np.where(usable.reshape(-1, *[1] * (value.ndim - 1)), value, 0)
        for value in (splats.means, splats.scales, splats.opacities, splats.sh)
    )
    return Splats(means, scales, np.where(usable[:, None], splats.quats_wxyz, _IDENTITY_WXYZ), opacities, sh), usable


def warn_clipped(clipped: NDArray[np.bool_], path: str | os.PathLike[str], what: str) -> None:
    """Count, in one DataWarning, the rows of `clipped`, (N, ...) bool, whose values a format cannot hold."""
    rows = np.count_nonzero(clipped.reshape(len(clipped), -1).any(axis=1))
    if rows:
        warnings.warn(f"{path}: {what} of {rows} of {len(clipped)} splats were clipped", DataWarning, stacklevel=4)
