"""The background of a picture: the light of the scene."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..light import skies

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
    canonical = unturned(directions, environment.rotation_deg)
    return skies.seen(environment.formula, canonical) * np.float32(exposure)


def unturned(directions: NDArray, angle_deg: float) -> NDArray[np.float64]:
    """Directions (N, 3) in the frame of the environment's image."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    x, y, z = np.asarray(directions, np.float64).T
    return np.stack([c * x - s * z, y, s * x + c * z], axis=-1)
