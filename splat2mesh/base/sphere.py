"""Directions on the sphere: sets that share it evenly, and the texels of lat-long images.

Canonical lat-long (OpenEXR's definition): row 0 is +y, the centre looks at +z, +x is a quarter from the left.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

GOLDEN_TURN = 0.6180339887498949
"""Of a full turn, between successive points of a Fibonacci set."""

EVENLY = 256
"""Directions that stand for all: 9 degrees apart."""

NO_DIRECTION = 1e-3
"""Length of a mean of unit vectors below which they cancel."""


def fibonacci_sphere(count: int = EVENLY, first: float = 0.0) -> NDArray[np.float64]:
    """Unit directions (N, 3) float64 that share the sphere evenly, from +y to -y.

    first: azimuth of the first one, in golden angles, from +x towards +z.
    Source: Swinbank, Purser, "Fibonacci grids: a novel approach to global modelling", 2006.
    """
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = (np.arange(count) + first) * math.pi * (3.0 - math.sqrt(5.0))
    radius = np.sqrt(1.0 - height * height)
    return np.stack([radius * np.cos(turn), height, radius * np.sin(turn)], axis=1)


def texel_directions(height: int, width: int, rows: slice = slice(None)) -> NDArray[np.float64]:
    """Unit directions (R, W, 3) float64 of the texel centres of a lat-long image, or of some of its rows."""
    latitude = np.pi * (0.5 - (np.arange(height)[rows, None] + 0.5) / height)
    longitude = np.pi * (1.0 - 2.0 * (np.arange(width) + 0.5) / width)
    x, z = np.cos(latitude) * np.sin(longitude), np.cos(latitude) * np.cos(longitude)
    return np.stack([x, np.broadcast_to(np.sin(latitude), x.shape), z], axis=-1)


def row_solid_angles(height: int, width: int) -> NDArray[np.float64]:
    """Solid angle of a texel in each row of a lat-long image, in steradians: (H, 1) float64, exact."""
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    return (edges[:-1] - edges[1:])[:, None] * (2.0 * np.pi / width)


def level_axes(up: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit directions (3,) at right angles to a third, `up`, and to one another: ahead, and to its side."""
    up = np.asarray(up, np.float64)
    ahead = np.linalg.svd(up[None])[2][1]
    return ahead, np.cross(up, ahead)


def level_directions(up: ArrayLike, count: int) -> NDArray[np.float64]:
    """`count` unit directions (count, 3) all around at right angles to `up`, from `level_axes` on."""
    ahead, side = level_axes(up)
    turns = np.arange(count) * 2 * np.pi / count
    return np.cos(turns)[:, None] * ahead + np.sin(turns)[:, None] * side
