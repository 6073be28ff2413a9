"""From unbounded scene light to display values: the exposure, the highlight shoulder, the sRGB curve."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance
from splat2mesh.scene.color import srgb_from_linear

SHOULDER_START = 0.8
"""Display-linear value above which highlights are compressed: K_s + F_90 of Khronos PBR Neutral."""

DESATURATION = 0.15
"""How fast compressed colours turn white: K_d of Khronos PBR Neutral."""

BRIGHT_PERCENTILE = 98.0
"""Percentage of vertices that stay below the shoulder: hot spots may burn out, a lit side may not."""


def auto_exposure(radiance: Radiance) -> float:
    """Return the exposure that brings the bright end of the vertices to the start of the shoulder.

    Parameters
    ----------
    radiance : ndarray, (V, 3)
        Linear exit radiance.

    Returns
    -------
    float
        Display value per unit of radiance; 1 for a scene without light.

    Notes
    -----
    The bright end is a percentile and not the maximum, so a few vertices in a sun's glare do not darken the rest. It is
    taken over each vertex's largest channel, because channels clip, not luminances: a luminance would burn out every
    saturated light.
    """
    bright = float(np.percentile(np.max(radiance, axis=1), BRIGHT_PERCENTILE))
    return SHOULDER_START / bright if bright > 0.0 else 1.0


def compress_highlights(color_linear: Radiance) -> NDArray[np.float32]:
    """Compress highlights by the shoulder of the Khronos PBR Neutral mapper.

    Parameters
    ----------
    color_linear : ndarray, (..., 3)
        Exposed linear Rec. 709, unbounded; what is negative counts as none.

    Returns
    -------
    ndarray of float32, (..., 3)
        Display-linear, in [0, 1].

    Notes
    -----
    The identity up to SHOULDER_START. Above it the largest channel runs into 1 along a hyperbola with a continuous
    slope, and the colour moves towards white without a shift in hue. The published mapper also subtracts F_90 = 4%,
    the mirror reflection of a glossy dielectric; diffuse radiance has none, so F_90 = 0 here.
    Source: github.com/KhronosGroup/ToneMapping, PBR_Neutral, specification.
    """
    color = np.maximum(np.asarray(color_linear, np.float32), 0.0)
    peak = color.max(axis=-1)
    over = peak > SHOULDER_START
    if not over.any():
        return color
    burning, peak = color[over], peak[over, None]
    shown_peak = 1.0 - (1.0 - SHOULDER_START) ** 2 / (peak + 1.0 - 2.0 * SHOULDER_START)
    saturation = 1.0 / (DESATURATION * (peak - shown_peak) + 1.0)
    color[over] = shown_peak * (1.0 + saturation * (burning / peak - 1.0))
    return color


def tone_map(color_linear: Radiance) -> NDArray[np.float32]:
    """Return display colours: `compress_highlights`, then the sRGB curve.

    Parameters
    ----------
    color_linear : ndarray, (..., 3)
        Exposed linear Rec. 709, unbounded.

    Returns
    -------
    ndarray of float32, (..., 3)
        sRGB, in [0, 1].
    """
    return srgb_from_linear(compress_highlights(color_linear))
