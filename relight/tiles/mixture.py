"""Light on a city beside its environment: remaining captured light, and lamps within their reach."""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Matrix4, Radiance

from ..engine.appearance import Appearance
from ..engine.lamp_scale import lamp_scale
from ..engine.mixing import CapturedPart, mixed
from ..engine.placed import NEGLIGIBLE, LampLight, Placed
from ..engine.relighter import Relighter, Shading
from ..lamps.asked import AskedLamp, Brightness, LampScale, resolve
from ..lamps.emitters import emitters_of
from ..lamps.fields import asked_lamp
from ..lamps.moving import moved
from ..lamps.placing import asked_lamps
from ..lamps.saving import fields_of
from ..light.captured import CapturedLight
from ..light.environment import Environment
from ..options import DEFAULT_TOLERANCE, LightingOptions

if TYPE_CHECKING:
    from ..lamps.shapes import Lamp


class CityMixture(NamedTuple):
    """Light beside the environment, the same for all tiles.

    captured, env_scale: factors on the captured light and on that of the environment. level: units of the picture per
    unit of the environment. lamps: frame of the scene, units of the picture. median: irradiance over pi of the
    captured light, luminance, in the median of the coarse city.
    """

    captured: float
    env_scale: float
    level: float
    lamps: "tuple[Lamp, ...]"
    median: float

    def arrays(self) -> dict[str, Any]:
        """Arrays to store, from which `from_arrays` restores it."""
        whole = Brightness(1.0, "picture")
        lamps = json.dumps([fields_of(AskedLamp(lamp, whole)) for lamp in self.lamps])
        numbers = np.array([self.captured, self.env_scale, self.level, self.median])
        return {"mixture": numbers, "mixture_lamps": np.frombuffer(lamps.encode(), np.uint8)}

    @classmethod
    def from_arrays(cls, kept: Mapping[str, NDArray[Any]]) -> "CityMixture | None":
        """The CityMixture from arrays; None without one."""
        if "mixture" not in kept:
            return None
        captured, env_scale, level, median = (float(number) for number in kept["mixture"])
        lamps = []
        for fields in json.loads(bytes(kept["mixture_lamps"]).decode()):
            lamps.append(resolve(asked_lamp(fields.pop("type"), fields), LampScale(1.0, 1.0)))
        return cls(captured, env_scale, level, tuple(lamps), median)

    def near(self, low: NDArray[np.float64], high: NDArray[np.float64], tolerance: float) -> "CityMixture":
        """The CityMixture of a box, without lamps whose direct light in it is below the tolerance."""
        least = NEGLIGIBLE * tolerance * self.median
        kept = [lamp for lamp in self.lamps if _brightest_in(lamp, low, high) > least]
        return self._replace(lamps=tuple(kept))

    def placed(self, relighter: Relighter, look: Appearance, tolerance: float) -> Placed | None:
        """The light of the lamps on the scene of a Relighter; None without lamps."""
        if not self.lamps:
            return None
        light = LampLight(relighter, look, self.lamps, tolerance, self.captured)
        return light.with_bounces(light.direct_of(*range(len(self.lamps))))

    def shading(self, look: Appearance, environment: Shading, placed: Placed | None) -> Shading:
        """All light together, in the unit of the environment."""
        part = CapturedPart(look.captured, self.captured)
        return mixed(look, environment, self.env_scale, part, placed, self.level)


def is_mixed(options: LightingOptions, sky: Environment) -> bool:
    """Whether options request light beside an unchanged environment, or captured light."""
    others = bool(options.placed) or options.captured is not None or options.env_scale != 1.0
    return others or isinstance(sky, CapturedLight)


CITY_METRE = 1.0
"""Splat units to a metre in a city: captures of that size are mostly placed by GPS, whose unit is a metre."""


def mixture_of(
    options: LightingOptions,
    relighter: Relighter,
    look: Appearance,
    sky: Environment,
    level: float,
    asked: Sequence[Any],
) -> CityMixture:
    """The CityMixture that options request beside a light, with sizes and brightness from the coarse city. asked:
    AskedLamps."""
    scale: LampScale = lamp_scale(relighter.scene, look, relighter.occluder, CITY_METRE)
    matrix: Matrix4 = np.asarray(relighter.scene.scene_from_splat, np.float64)
    lamps = tuple(moved(resolve(each, scale), matrix) for each in asked)
    alone = isinstance(sky, CapturedLight)
    captured = float(alone) if options.captured is None else options.captured
    return CityMixture(captured, 0.0 if alone else options.env_scale, level, lamps, scale.irradiance / np.pi)


def environment_shading(relighter: Relighter, sky: Environment, colors: Radiance | None) -> Shading:
    """The scene under an environment alone; black for the captured light."""
    if isinstance(sky, CapturedLight):
        return Shading(np.zeros_like(relighter.scene.colors_linear), 0, [], relighter.options.unplanned)
    return relighter.shading(sky, colors)


def lamps_asked(options: LightingOptions) -> list[Any]:
    """The AskedLamps of options. Raises InputError for lamps that cannot be read."""
    return asked_lamps(options.placed)


def look_of(colors: Radiance | None, captured: Radiance, before: Radiance) -> Appearance:
    """The Appearance of a part: albedo or None for white, captured colours, and captured irradiance."""
    albedo = None if colors is None else np.asarray(colors, np.float32)
    return Appearance(albedo, np.asarray(captured, np.float32), np.asarray(before, np.float32))


def tolerance_of(options: LightingOptions) -> float:
    """The accepted relative error of light."""
    return options.tolerance or DEFAULT_TOLERANCE


def _brightest_in(lamp: "Lamp", low: NDArray[np.float64], high: NDArray[np.float64]) -> float:
    """Upper bound of the luminance of white under a lamp's direct light in a box of x and z."""
    emitters = emitters_of([lamp])
    middle = emitters.middle.astype(np.float64)[:, [0, 2]]
    apart = np.linalg.norm(middle - np.clip(middle, low, high), axis=1) - emitters.reach
    # Both bounds hold: one by the distance, one by the lamp's own radiance next to it.
    far = emitters.power.astype(np.float64) / np.maximum(apart, 1e-9) ** 2
    return float(np.where(apart > 0.0, np.minimum(far, emitters.peak), emitters.peak).sum())
