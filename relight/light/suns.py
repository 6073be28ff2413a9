"""Suns: single directions of light, each of which is ray traced."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..sh import harmonics


@dataclass(frozen=True, eq=False)
class Suns:
    """Light from S single directions, in a fixed order.

    directions: (S, 3) float64 unit vectors toward the light, scene frame.
    weights: (S, 3) float64 linear, radiance times solid angle: the irradiance of a surface that faces the sun.
    """

    directions: NDArray[np.float64]
    weights: NDArray[np.float64]

    @classmethod
    def none(cls) -> "Suns":
        """No sun at all."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)))

    def __len__(self) -> int:
        return len(self.directions)

    def rotated(self, angle_deg: float) -> "Suns":
        """Return these suns turned by an active rotation about +y, as `Environment.rotated` turns."""
        angle = math.radians(angle_deg)
        cos, sin = math.cos(angle), math.sin(angle)
        turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
        return Suns(self.directions @ turn.T, self.weights)

    def sh(self, bands: int) -> NDArray[np.float64]:
        """Radiance coefficients (B^2, 3) float64 of the suns as points."""
        return harmonics.evaluate(self.directions, bands).T @ self.weights
