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
    """Return the exposure, display value per unit of radiance (V, 3), that brings the bright end of the vertices to the
    start of the shoulder; 1 for a scene without light.

    The bright end is a percentile and not the maximum, so a few vertices in a sun's glare do not darken the rest. It is
    taken over each vertex's largest channel, because channels clip, not luminances.
    """
    bright = float(np.percentile(np.max(radiance, axis=1), BRIGHT_PERCENTILE))
    return SHOULDER_START / bright if bright > 0.0 else 1.0


def compress_highlights(color_linear: Radiance) -> NDArray[np.float32]:
    """Compress the highlights of exposed linear colours (..., 3) by the shoulder of Khronos PBR Neutral: float32 in [0,
    1].

    The identity up to SHOULDER_START. Above it the largest channel runs into 1 along a hyperbola with a continuous
    slope, and the colour moves towards white without a shift in hue. The published mapper also subtracts F_90 = 4%, the
    mirror reflection of a glossy dielectric; diffuse radiance has none, so F_90 = 0 here. Source:
    github.com/KhronosGroup/ToneMapping, PBR_Neutral, specification.
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
    """Return sRGB (..., 3) float32 in [0, 1] of exposed linear colours: `compress_highlights`, then the sRGB curve."""
    return srgb_from_linear(compress_highlights(color_linear))
