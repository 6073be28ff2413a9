"""Directions that share the sphere evenly."""

import math

import numpy as np
from numpy.typing import NDArray


def fibonacci_sphere(count: int) -> NDArray:
    """Unit directions (N, 3) float64 that share the sphere evenly.

    Source: Swinbank, Purser, "Fibonacci grids: a novel approach to global modelling", 2006.
    """
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.arange(count) * math.pi * (3.0 - math.sqrt(5.0))
    radius = np.sqrt(1.0 - height * height)
    return np.stack([radius * np.cos(turn), height, radius * np.sin(turn)], axis=1)
