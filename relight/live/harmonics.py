"""Harmonics about the vertical axis, so that turning the light rotates pairs of coefficients, one line in any engine.

Coefficient i = l (l + 1) + m is that of our basis at the direction (z, x, y) instead of (x, y, z): the polar axis is
+y, the azimuth is the longitude atan2(x, z). m > 0 goes with cos(m longitude), m < 0 with sin(|m| longitude).
"""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Coefficients, Directions, Floats

from ..sh import harmonics

POLAR = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
"""The rotation (x, y, z) -> (z, x, y)."""


def evaluate(directions: Directions, bands: int) -> Floats:
    """Values of the basis about +y, (N, K), in directions (N, 3)."""
    return harmonics.evaluate(np.asarray(directions) @ POLAR.T, bands)


def about_y(coefficients: Coefficients) -> NDArray[np.float64]:
    """Coefficients (..., K, C) about +y of those (..., K, C) in our basis."""
    return harmonics.rotation_matrix(POLAR, harmonics.bands_of(coefficients)) @ coefficients


def turned(coefficients: Coefficients, angle_deg: float) -> NDArray[np.float64]:
    """Coefficients (K, C) about +y of light turned by an active Ry(+angle)."""
    _, order = harmonics.degrees_and_orders(harmonics.bands_of(coefficients))
    angle = order * np.radians(angle_deg)
    mirrored = coefficients[np.arange(len(order)) - 2 * order]
    return np.cos(angle)[:, None] * coefficients - np.sin(angle)[:, None] * mirrored
