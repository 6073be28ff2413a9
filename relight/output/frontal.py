"""Light from behind the viewer of a picture, where shadows hide, and the angle that brings it in from the side."""

from typing import TYPE_CHECKING, Any

import numpy as np

from .inset import strongest

if TYPE_CHECKING:
    from ..light.environment import Environment

FRONTAL_DEG = 40.0
"""Angle about the vertical between the light and the viewer, seen from what the picture shows, up to which the light
counts as frontal. Shadows of upright things then fall behind them."""

SIDE_DEG = 75.0
"""That angle after the turn: from the side and a little from the front, as photographers light a form."""

STEEPEST = 0.8
"""Largest sine of the light's elevation: a high sun casts short shadows whichever way it is turned. Of the built-in
lights sunset lies below it, and noon and overcast above."""


def side_angle(
    environment: "Environment",  # turned as the scene is lit
    camera: dict[str, Any],  # eye and target, scene frame
) -> float | None:
    """Return the angle of `--rotate` that lights a picture from the side, degrees in [0, 360), a multiple of 5.

    None where its light is even or high, or does not come from behind the viewer. Of the two sides it is the nearer.
    """
    light = strongest(environment)
    backward = np.subtract(camera["eye"], camera["target"]).astype(np.float64)
    if light is None or abs(light[1]) > STEEPEST or not np.hypot(backward[0], backward[2]) > 0.0:
        return None
    # Azimuths grow as `--rotate` does: counter-clockwise from above, from +z towards +x.
    off = np.degrees(np.arctan2(light[0], light[2]) - np.arctan2(backward[0], backward[2]))
    off = (off + 180.0) % 360.0 - 180.0
    if abs(off) > FRONTAL_DEG:
        return None
    turn = SIDE_DEG - off if off >= 0.0 else -SIDE_DEG - off
    return float(round((environment.rotation_deg + turn) / 5.0) * 5 % 360)
