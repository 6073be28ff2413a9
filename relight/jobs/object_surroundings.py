"""The surroundings of objects in a scene under one light of a job: its skies, surfaces, suns and lamps."""

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance
from splat2mesh.base.errors import DataWarning

from ..engine.light_mix import LightMix
from ..engine.relighter import Shaded
from ..insert.probe import LightAround
from ..insert.surroundings import Sky, surroundings_of
from ..lamps.photometry import times
from ..light.environment import Environment
from ..light.loading import CapturedLight, light_of

if TYPE_CHECKING:
    from ..insert.surroundings import Surroundings
    from ..lamps.shapes import Lamp
    from ..viewer.request import ObjectsUnder


def surroundings_under(shaded: Shaded, mix: LightMix) -> "Surroundings":
    """Return the Surroundings of a scene in a light, in the unit of its radiance."""
    light = light_under(shaded, mix)
    lamps = mix.lamp_light.lamps if mix.kind.adds and mix.lamp_light is not None else []
    return _around(mix, shaded.shading.radiance, light, lamps, _level(shaded, mix))


def surroundings_in(now: "ObjectsUnder", mix: LightMix) -> "Surroundings":
    """Return the Surroundings of a scene in the light of its session."""
    captured = 1.0 if mix.look.as_captured and not mix.kind.adds and now.captured == 0.0 else now.captured
    skies = []
    if now.env_scale > 0.0 and not mix.look.as_captured:
        environment = light_of(now.environment)
        if not isinstance(environment, CapturedLight):
            skies.append(Sky(environment.rotated(now.angle_deg), now.env_scale))
    light = _with_captured(mix, skies, captured, now.radiance, now.level)
    lamps = mix.light_of(now.lamps, now.captured).lamps if now.lamps else []
    return _around(mix, now.radiance, light, lamps, now.level)


def light_under(shaded: Shaded, mix: LightMix) -> LightAround:
    """Return the skies of a light, and the radiance of captured lamps in it."""
    captured = mix.captured_factor if mix.kind.adds else float(mix.look.as_captured)
    skies = [Sky(shaded.light, mix.env_scale)] if mix.env_scale > 0.0 else []
    return _with_captured(mix, skies, captured, shaded.shading.radiance, _level(shaded, mix))


def _around(
    mix: LightMix, radiance: Radiance, light: LightAround, lamps: "Sequence[Lamp]", level: float
) -> "Surroundings":
    """The Surroundings; lamps in units of the picture, `level` of which are one of the radiance (V, 3)."""
    scene, occluder = mix.relighter.scene, mix.relighter.occluder
    lamps = [times(lamp, 1.0 / level) for lamp in lamps]
    return surroundings_of(scene, occluder, radiance, light.skies, lamps, light.glow)


def _with_captured(mix: LightMix, skies: list[Sky], captured: float, radiance: Radiance, level: float) -> LightAround:
    """The LightAround of skies and of a fraction of the captured light, at a level as of `_around`."""
    if captured > 0.0:
        skies = [*skies, Sky(_captured_sky(mix), captured / level)]
    return LightAround(skies, _glow(radiance, mix, (captured if mix.kind.adds else 1.0) / level))


def _level(shaded: Shaded, mix: LightMix) -> float:
    """Units of the picture per unit of the radiance."""
    return mix.level(shaded.shading.radiance) if mix.kind.adds else shaded.exposure


def _captured_sky(mix: LightMix) -> Environment:
    """The distant captured light, with the assumed change of a room that no environment is known to enter; without an
    estimate, an even light with a DataWarning."""
    sky, change = mix.look.environment, mix.assumed
    if sky is None:
        problem = "the light of the capture is unknown: objects are lit evenly from all around"
        warnings.warn(problem, DataWarning, stacklevel=3)
        even = np.broadcast_to(np.median(mix.look.irradiance, axis=0), (2, 4, 3))
        sky = Environment(np.array(even, np.float32), "even")
    return sky if change is None else Environment(sky.radiance * change, sky.name, sky.rotation_deg)


def _glow(radiance: Radiance, mix: LightMix, factor: float) -> NDArray[np.float32] | None:
    """(V, 3) float32: what the captured lamps of a closed room send, in the unit of the radiance; None without any.

    factor: on their captured radiance, besides that of the options."""
    room = mix.look.room
    if room is None or not room.glow.any():
        return None
    factors = np.array([*mix.lamp_factors, 1.0], np.float32)[room.lamp_of]
    shown = np.maximum(radiance, np.float32(factor) * factors[:, None] * room.glow)
    return np.where(room.glow.any(axis=1, keepdims=True), shown, np.float32(0.0)).astype(np.float32)
