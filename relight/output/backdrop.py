"""The background of a picture: the light of the scene."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..light import skies
from ..light.sky_model import SUN_RADIUS_DEG

if TYPE_CHECKING:
    from ..light.environment import Environment


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
    are wide, and a built-in sky but for the sun and its rim: far ground fades into the air."""
    if environment.formula is None:
        return np.ones(len(directions), bool)
    sun = skies.sun_of(environment.formula)
    if sun is None:
        return np.ones(len(directions), bool)
    near = np.cos(np.radians(SUN_RADIUS_DEG) + 2.0 * pixel)
    return np.asarray(_unturned(directions, environment.rotation_deg) @ sun[0] < near)


def _unturned(directions: NDArray, angle_deg: float) -> NDArray[np.float64]:
    """Directions (N, 3) in the frame of the environment's image."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    x, y, z = np.asarray(directions, np.float64).T
    return np.stack([c * x - s * z, y, s * x + c * z], axis=-1)
