"""Exposure of a new light on a captured scene: that of the camera of the capture, without burning out."""

from splat2mesh.base.arrays import Radiance

from ..light.environment import Environment
from ..light.tonemap import auto_exposure


def level_of(brightness: float | None, light: Environment) -> float:
    """Captured units per unit of a light's radiance, for it to be as bright as that of the capture was.

    brightness: of the light of the capture, in captured units; None where it is not known.
    """
    return float(brightness / light.mean_luminance) if brightness is not None and light.mean_luminance > 0.0 else 1.0


def exposure_as_captured(
    brightness: float | None,  # as in `level_of`
    captured: Radiance,  # (V, 3) linear, captured colours of the vertices
    light: Environment,
    exposure: float,  # of `auto_exposure`, which it is where no light of a capture is known
) -> float:
    """Captured units per unit of a light: as bright as the light of the capture, within a stop of what shows its bright
    end as the capture showed its own."""
    if brightness is None or not light.mean_luminance > 0.0:
        return exposure
    most = 2.0 * exposure * max(1.0, 1.0 / auto_exposure(captured))
    return float(min(max(level_of(brightness, light), exposure / 2.0), most))
