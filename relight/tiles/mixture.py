"""Light on a city beside its environment, as tasks share it: remaining captured light, and lamps within their reach."""

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine.appearance import Appearance
from ..engine.light_mix import LightBeside, LightMix, light_beside
from ..engine.placed import NEGLIGIBLE, LampLight
from ..engine.relighter import Relighter
from ..lamps.asked import AskedLamp, Brightness, LampScale, resolve
from ..lamps.emitters import emitters_of
from ..lamps.fields import asked_lamp
from ..lamps.spec import fields_of

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
    def of(cls, mix: LightMix, level: float) -> "CityMixture":
        """The CityMixture of a LightMix on the coarse city."""
        lamps = tuple(mix.in_scene(mix.asked_lamps))
        return cls(mix.captured_factor, mix.env_scale, level, lamps, mix.scale.irradiance / np.pi)

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

    def beside(self, relighter: Relighter, look: Appearance) -> LightBeside:
        """The light beside the environment on the scene of a Relighter."""
        placed = None
        if self.lamps:
            light = LampLight(relighter, look, self.lamps, relighter.options.accepted_error, self.captured)
            placed = light.with_bounces(light.direct_of(*range(len(self.lamps))))
        found = light_beside(look, look.captured, self.captured, placed, self.level)
        return found._replace(env_scale=self.env_scale)


def _brightest_in(lamp: "Lamp", low: NDArray[np.float64], high: NDArray[np.float64]) -> float:
    """Upper bound of the luminance of white under a lamp's direct light in a box of x and z."""
    emitters = emitters_of([lamp])
    middle = emitters.middle.astype(np.float64)[:, [0, 2]]
    apart = np.linalg.norm(middle - np.clip(middle, low, high), axis=1) - emitters.reach
    # Both bounds hold: one by the distance, one by the lamp's own radiance next to it.
    far = emitters.power.astype(np.float64) / np.maximum(apart, 1e-9) ** 2
    return float(np.where(apart > 0.0, np.minimum(far, emitters.peak), emitters.peak).sum())
