"""The lobe of a rough surface: GGX, as factors on spherical harmonics of the light and as directions to trace.

Source: Walter et al., "Microfacet models for refraction through rough surfaces" (EGSR 2007); Ramamoorthi and Hanrahan,
"A signal-processing framework for reflection" (TOG 2004), for the lobe as a filter of the light.
"""

from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats

DIELECTRIC_F0 = 0.04
"""Reflectance of plastics, glazes and varnish at normal incidence: refractive index 1.5."""

_STEPS = 4000  # of the integral over half vectors: 1e-6 of any factor


@lru_cache(maxsize=64)
def _zonal(alpha: float, bands: int) -> tuple[float, ...]:
    angle = (np.arange(_STEPS) + 0.5) / _STEPS * (np.pi / 4)  # of the half vector: light arrives at twice that
    density = alpha**2 / (np.cos(angle) ** 2 * (alpha**2 - 1.0) + 1.0) ** 2
    weight = density * np.cos(angle) * np.sin(angle) * np.cos(2 * angle)
    weight /= weight.sum()
    return tuple(float(weight @ scipy.special.eval_legendre(degree, np.cos(2 * angle))) for degree in range(bands))


def zonal_factors(alpha: float, bands: int) -> NDArray[np.float64]:
    """Factors (B,) on each degree of the light, of the lobe about the mirrored direction at normal incidence.

    alpha: GGX roughness, 0 < alpha <= 1, the square of what artists call roughness. The factor of degree 0 is 1.
    """
    return np.array(_zonal(float(alpha), bands))


def fresnel_rise(cosine: Floats, metal: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Reflectance towards an eye at a cosine (N,) over that at normal incidence: Schlick's; 1 for metals (N,)."""
    rise = (1.0 - DIELECTRIC_F0) / DIELECTRIC_F0 * (1.0 - np.clip(cosine, 0.0, 1.0)) ** 5
    return np.where(metal, 1.0, 1.0 + rise)


def lobe_direction(
    alpha: Floats,  # (N,)
    normal: Directions,
    toward: Directions,  # to the eye, both (N, 3)
    sample: int,
    samples: int,
    shift: Floats,  # (N,) in [0, 1), so that neighbours do not share the pattern
) -> tuple[Directions, NDArray[np.float64]]:
    """One of some directions (N, 3) from which a lobe takes light, and its weight (N,): 0 below the surface."""
    radial = np.mod((sample + shift) / samples, 1.0)
    turn = 2 * np.pi * np.mod(sample * 0.6180339887498949 + 7.3 * shift, 1.0)
    cosine = np.sqrt((1.0 - radial) / (1.0 + (alpha**2 - 1.0) * radial))
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    across, along = _frame(normal)
    half = across * (sine * np.cos(turn))[:, None] + along * (sine * np.sin(turn))[:, None] + normal * cosine[:, None]
    facing = np.maximum(np.einsum("ij,ij->i", toward, half), 1e-4)
    light = 2.0 * facing[:, None] * half - toward
    above, seen = np.einsum("ij,ij->i", light, normal), np.einsum("ij,ij->i", toward, normal)
    shadowing = _masking(np.maximum(above, 1e-3), alpha) * _masking(np.maximum(seen, 0.02), alpha)
    weight = shadowing * facing / (np.maximum(cosine, 1e-3) * np.maximum(seen, 0.02))
    return light, np.where(above > 1e-3, weight, 0.0)


def _masking(cosine: Floats, alpha: Floats) -> Floats:
    """Smith's function of one direction."""
    return 2.0 * cosine / (cosine + np.sqrt(alpha**2 + (1.0 - alpha**2) * cosine**2))


def _frame(normal: Directions) -> tuple[Directions, Directions]:
    """Two unit vectors (N, 3) at right angles to each other and to a normal."""
    axis = np.where(np.abs(normal[:, 2:3]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    across = np.cross(axis, normal)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return across, np.cross(normal, across)
