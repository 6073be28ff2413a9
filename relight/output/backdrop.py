"""The background of a picture: the light of the scene."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..light import skies

if TYPE_CHECKING:
    from ..light.environment import Environment

EDGE, NEAR_SUN = 20.0, np.radians(3.0)
"""Pixels from the horizon, and the angle from a sun, within which a built-in sky takes several samples a pixel."""


def behind(
    environment: "Environment",
    directions: NDArray,  # (N, 3) unit, scene frame
    exposure: float,  # display value per unit of radiance
) -> NDArray:
    """Exposed linear radiance (N, 3) float32 that the picture shows in these directions, unbounded: a built-in sky by
    its formula, with its horizon and its sun, an image as it is."""
    if environment.formula is None:
        return environment.lookup(directions) * np.float32(exposure)
    canonical = _unturned(directions, environment.rotation_deg)
    return skies.seen(environment.formula, canonical) * np.float32(exposure)


def is_even(environment: "Environment", directions: NDArray, pixel: float) -> NDArray[np.bool_]:
    """(N,) bool, where the light changes so little that the middle of a pixel shows it: all of an image, whose texels
    are wide, and a built-in sky but for horizon and sun."""
    if environment.formula is None:
        return np.ones(len(directions), bool)
    sun = skies.sun_of(environment.formula)
    even = np.abs(directions[:, 1]) > EDGE * pixel
    if sun is not None:
        even &= _unturned(directions, environment.rotation_deg) @ sun[0] < np.cos(NEAR_SUN)
    return even


def _unturned(directions: NDArray, angle_deg: float) -> NDArray[np.float64]:
    """Directions (N, 3) in the frame of the environment's image."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    x, y, z = np.asarray(directions, np.float64).T
    return np.stack([c * x - s * z, y, s * x + c * z], axis=-1)
