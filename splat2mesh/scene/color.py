"""sRGB and linear light. Splat colours and PLY colours are sRGB; everything that adds light is linear."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def linear_from_srgb(color: ArrayLike) -> NDArray[np.floating[Any]]:
    """Return the linear light of sRGB values.

    Parameters
    ----------
    color : array-like
        Any shape, sRGB in [0, 1] (values above 1 continue the curve).

    Returns
    -------
    ndarray of floating point
        The same shape.

    Notes
    -----
    Source: IEC 61966-2-1.
    """
    color = np.asarray(color)
    high = ((np.maximum(color, 0.0) + 0.055) / 1.055) ** 2.4
    linear = np.where(color <= 0.04045, color / 12.92, high)
    return linear.astype(np.result_type(color, np.float32), copy=False)


def srgb_from_linear(color: ArrayLike) -> NDArray[np.floating[Any]]:
    """Return the sRGB values of linear light: the inverse of `linear_from_srgb`.

    Parameters
    ----------
    color : array-like
        Any shape, linear in [0, 1].

    Returns
    -------
    ndarray of floating point
        The same shape.
    """
    color = np.asarray(color)
    high = 1.055 * np.maximum(color, 1e-9) ** (1 / 2.4) - 0.055
    srgb = np.where(color <= 0.0031308, color * 12.92, high)
    return srgb.astype(np.result_type(color, np.float32), copy=False)


def luminance(color_linear: ArrayLike) -> NDArray[np.floating[Any]]:
    """Return the Rec. 709 luminance of linear RGB.

    Parameters
    ----------
    color_linear : array-like, (..., 3)

    Returns
    -------
    ndarray, (...)
    """
    return np.asarray(color_linear) @ np.array([0.2126, 0.7152, 0.0722])


def bytes_from_unit(color: ArrayLike) -> NDArray[np.uint8]:
    """Round values in [0, 1] to bytes, clipping what lies outside.

    Parameters
    ----------
    color : array-like
        Any shape.

    Returns
    -------
    ndarray of uint8
        The same shape.
    """
    return (np.clip(color, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
