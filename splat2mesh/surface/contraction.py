"""Contracted space: the world as it is near the middle, and farther out drawn together by the logarithm of distance.

An error of one size in it grows with distance in the world, as the footprint of a pixel does: a mesh that is decimated
there keeps what is near.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Contraction:
    """y = x - center within `radius`, along the same direction at radius (1 + log(r / radius)) beyond.

    center: (3,) float64 world. radius: > 0, world units.
    """

    center: np.ndarray
    radius: float

    def contracted(self, points):
        """World (N, 3) -> contracted (N, 3) float64."""
        local = np.asarray(points, np.float64) - self.center
        r = np.linalg.norm(local, axis=1) / self.radius
        return local * np.where(r > 1, (1 + np.log(np.maximum(r, 1))) / np.maximum(r, 1), 1)[:, None]

    def world(self, points):
        """Contracted (N, 3) -> world (N, 3) float64."""
        points = np.asarray(points, np.float64)
        r = np.linalg.norm(points, axis=1) / self.radius
        return points * np.where(r > 1, np.exp(np.maximum(r, 1) - 1) / np.maximum(r, 1), 1)[:, None] + self.center

    def stretch(self, points):
        """How much longer a step is in the world than in contracted space, (N,) at world points (N, 3)."""
        r = np.linalg.norm(np.asarray(points, np.float64) - self.center, axis=1) / self.radius
        return np.maximum(r, 1.0)
