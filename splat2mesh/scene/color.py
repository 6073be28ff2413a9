"""sRGB and linear light. Splat colours and PLY colours are sRGB; everything that adds light is linear."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

BLACK = 1e-4
"""Linear light below which a colour is black: a third of a step of a byte. A ratio to it carries no information."""

CLIPPED_SRGB = 0.97
"""Display value from which a photograph may have been clipped: splats ring about 1 by a few steps of a byte."""


def linear_from_srgb(color: ArrayLike) -> NDArray[np.floating[Any]]:
    """Return the linear light of sRGB values. color: any shape, sRGB in [0, 1] (values above 1 continue the curve).
    Returns floating point: the same shape. Source: IEC 61966-2-1."""
    color = np.asarray(color)
    high = ((np.maximum(color, 0.0) + 0.055) / 1.055) ** 2.4
    linear = np.where(color <= 0.04045, color / 12.92, high)
    return linear.astype(np.result_type(color, np.float32), copy=False)


def srgb_from_linear(color: ArrayLike) -> NDArray[np.floating[Any]]:
    """Return the sRGB values of linear light: the inverse of `linear_from_srgb`. color: any shape, linear in [0, 1].
    Returns floating point: the same shape."""
    color = np.asarray(color)
    high = 1.055 * np.maximum(color, 1e-9) ** (1 / 2.4) - 0.055
    srgb = np.where(color <= 0.0031308, color * 12.92, high)
    return srgb.astype(np.result_type(color, np.float32), copy=False)


def luminance(color_linear: ArrayLike) -> NDArray[np.floating[Any]]:
    """Return the Rec. 709 luminance of linear RGB. color_linear: (..., 3). Returns (...)."""
    return np.asarray(color_linear) @ np.array([0.2126, 0.7152, 0.0722])


def bytes_from_unit(color: ArrayLike) -> NDArray[np.uint8]:
    """Round values in [0, 1] to bytes, clipping what lies outside. color: any shape. Returns uint8: the same shape."""
    return (np.clip(color, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
