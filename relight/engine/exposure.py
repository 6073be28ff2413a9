"""How bright a new light is shown on what was captured: as the camera of the capture would have, and not burnt out."""

from typing import TYPE_CHECKING

from ..light.tonemap import auto_exposure

if TYPE_CHECKING:
    from ..light.environment import Environment
    from .appearance import Appearance

OVER_BRIGHT = 1.25
"""A third of a stop: by how much the bright end of a place in a new light may lie above that of its capture."""


def level_of(look: "Appearance", light: "Environment") -> float:
    """Captured units per unit of a light's radiance, for it to be as bright as that of the capture was."""
    capture, mean = look.capture, light.mean_luminance
    return float(capture["brightness"] / mean) if capture and mean > 0.0 else 1.0


def exposure_as_captured(look: "Appearance", light: "Environment", exposure: float) -> float:
    """Captured units per unit of a light, within a stop below what shows its bright end and little above: not much more
    may burn out than did in the capture. exposure: of `auto_exposure`, which it is where no capture is known."""
    capture, mean = look.capture, light.mean_luminance
    if capture is None or not mean > 0.0:
        return exposure
    most = OVER_BRIGHT * exposure * max(1.0, 1.0 / auto_exposure(look.captured))
    return float(min(max(capture["brightness"] / mean, exposure / 2.0), most))
