"""The surroundings of objects in a scene under one light of a job: its skies, surfaces, suns and lamps."""

import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning

from ..engine.appearance import Appearance
from ..engine.relighter import Relighter, Shaded
from ..light.captured import CapturedLight
from ..light.environment import Environment
from ..light.loading import light_of

if TYPE_CHECKING:
    from ..insert.probe import Light
    from ..insert.surroundings import Surroundings
    from ..lamps.shapes import Lamp
    from ..viewer.object_source import ObjectsUnder
    from .extra_light import ExtraLight


def surroundings_under(
    shaded: Shaded, relighter: Relighter, look: Appearance, beside: "ExtraLight", mixes: bool, steady: bool
) -> "Surroundings":
    """Return the Surroundings of a scene in a light, in the unit of its radiance.

    mixes: whether it is more than an environment. steady: whether no environment enters.
    """
    from ..insert.surroundings import surroundings_of

    light, level = light_under(shaded, look, beside, mixes, steady), _level(shaded, beside, mixes)
    lamps: list[Lamp] = []
    if mixes and beside.lamp_light is not None:
        from ..lamps.photometry import times

        lamps = [times(lamp, 1.0 / level) for lamp in beside.lamp_light.lamps]
    radiance = shaded.shading.radiance
    return surroundings_of(relighter.scene, relighter.occluder, radiance, light.skies, lamps, light.glow)


def surroundings_in(
    now: "ObjectsUnder", relighter: Relighter, look: Appearance, beside: "ExtraLight", mixes: bool, steady: bool
) -> "Surroundings":
    """Return the Surroundings of a scene in the light of its session. Other arguments as of `surroundings_under`."""
    from ..insert.surroundings import Sky, surroundings_of
    from ..lamps.photometry import times

    captured = 1.0 if steady and not mixes and now.captured == 0.0 else now.captured
    skies, lamps = [], []
    if now.env_scale > 0.0 and not steady:
        light = light_of(now.environment)
        if not isinstance(light, CapturedLight):
            skies.append(Sky(light.rotated(now.angle_deg), now.env_scale))
    if captured > 0.0:
        skies.append(Sky(_captured_sky_now(look, beside), captured / now.level))
    if now.lamps:
        lamps = [times(lamp, 1.0 / now.level) for lamp in beside.light_of(now.lamps, now.captured).lamps]
    glow = _glow(now.radiance, look, beside, (captured if mixes else 1.0) / now.level)
    return surroundings_of(relighter.scene, relighter.occluder, now.radiance, skies, lamps, glow)


def light_under(shaded: Shaded, look: Appearance, beside: "ExtraLight", mixes: bool, steady: bool) -> "Light":
    """Return the skies of a light, and the radiance of captured lamps in it. Arguments as of `surroundings_under`."""
    from ..insert.probe import Light
    from ..insert.surroundings import Sky

    level = _level(shaded, beside, mixes)
    captured = beside.captured_factor if mixes else float(steady)
    new = 0.0 if steady or isinstance(shaded.light, CapturedLight) else beside.env_scale
    skies = [Sky(shaded.light, new)] if new > 0.0 else []
    if captured > 0.0:
        skies.append(Sky(_captured_sky_now(look, beside), captured / level))
    return Light(skies, _glow(shaded.shading.radiance, look, beside, (captured if mixes else 1.0) / level))


def _level(shaded: Shaded, beside: "ExtraLight", mixes: bool) -> float:
    """Units of the picture per unit of the radiance."""
    return beside.level(shaded.shading.radiance) if mixes else shaded.exposure


def captured_sky(look: Appearance) -> Environment:
    """The distant captured light; without an estimate, an even light with a DataWarning."""
    if look.environment is not None:
        return look.environment
    problem = "the light of the capture is unknown: objects are lit evenly from all around"
    warnings.warn(problem, DataWarning, stacklevel=3)
    even = np.broadcast_to(np.median(look.irradiance, axis=0), (2, 4, 3))
    return Environment(np.array(even, np.float32), "even")


def _captured_sky_now(look: Appearance, beside: "ExtraLight") -> Environment:
    """The distant captured light, with the assumed change of a room that no environment is known to enter."""
    sky, change = captured_sky(look), beside.assumed
    return sky if change is None else Environment(sky.radiance * change, sky.name, sky.rotation_deg)


def _glow(
    radiance: NDArray[np.float32], look: Appearance, beside: "ExtraLight", factor: float
) -> NDArray[np.float32] | None:
    """(V, 3) float32: what the captured lamps of a closed room send, in the unit of the radiance; None without any.

    factor: on their captured radiance, besides that of the options."""
    room = look.room
    if room is None or not room.glow.any():
        return None
    factors = np.array([*beside.lamp_factors, 1.0], np.float32)[room.lamp_of]
    shown = np.maximum(radiance, np.float32(factor) * factors[:, None] * room.glow)
    return np.where(room.glow.any(axis=1, keepdims=True), shown, np.float32(0.0)).astype(np.float32)
