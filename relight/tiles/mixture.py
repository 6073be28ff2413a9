"""Light on a city beside its environment: remaining captured light, and lamps within their reach."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..engine.light_mix import LightBeside, LightMix
from ..engine.placed import NEGLIGIBLE
from ..lamps.asked import AskedLamp
from ..lamps.emitters import emitters_of

if TYPE_CHECKING:
    from ..lamps.shapes import Lamp


def lamps_near(mix: LightMix, low: NDArray[np.float64], high: NDArray[np.float64]) -> list[AskedLamp]:
    """The requested lamps of a LightMix, without those whose direct light in a box of x and z, (2,) its corners, is
    below the tolerance, relative to the median captured light of the city."""
    least = NEGLIGIBLE * mix.options.accepted_error * mix.scale.irradiance / np.pi
    lamps = zip(mix.asked_lamps, mix.in_scene(mix.asked_lamps), strict=True)
    return [asked for asked, lamp in lamps if _brightest_in(lamp, low, high) > least]


def beside(mix: LightMix, level: float) -> LightBeside:
    """The light beside the environment on a part of a city. level: of the city, as of `LightMix.level`."""
    placed, light = None, mix.lamp_light
    if light is not None:
        placed = light.with_bounces(light.direct_of(*range(len(light.lamps))))
    return mix.beside(level, mix.captured_factor, placed)


def _brightest_in(lamp: "Lamp", low: NDArray[np.float64], high: NDArray[np.float64]) -> float:
    """Upper bound of the luminance of white under a lamp's direct light in a box of x and z."""
    emitters = emitters_of([lamp])
    middle = emitters.middle.astype(np.float64)[:, [0, 2]]
    apart = np.linalg.norm(middle - np.clip(middle, low, high), axis=1) - emitters.reach
    # Both bounds hold: one by the distance, one by the lamp's own radiance next to it.
    far = emitters.power.astype(np.float64) / np.maximum(apart, 1e-9) ** 2
    return float(np.where(apart > 0.0, np.minimum(far, emitters.peak), emitters.peak).sum())
