"""The numbers of the estimate of captured light, as `scripts/fit light` prints them, with the error they leave."""

import json
from pathlib import Path
from typing import NamedTuple

FILE = Path(__file__).parent / "data" / "fitted.json"


class Fitted(NamedTuple):
    """Weights of cues, in nats, and scales of their noise. `fitted.json` holds the values and where they come from.

    parallel, slanted: weight of pairs of neighbours whose normals agree, and of those that differ.
    parallel_slope, slanted_slope: weight against a slope of log colour over log light that is not 1, for each of them.
    difference: of log albedo (RGB), beyond which two neighbours are of two materials.
    contrast: independent patches of the contrast within materials.
    sky, sky_noise, sky_level: weight of the whole upper sky, and its noise in log radiance, of a part and of all of it:
    bands, tone curve, tint.
    clipped, clipped_level, clipped_noise: the same weight of a clipped sky, its usual log radiance, and its noise.
    albedo, albedo_spread: median albedo in luminance, and spread of its logarithm.
    warmth, warmth_spread, green, green_spread: mean log red over blue, and green over both, of albedo; spreads.
    color_spread: factor on the variance of the colour of natural lights.
    sun: nats against a sun.
    """

    parallel: float
    slanted: float
    parallel_slope: float
    slanted_slope: float
    difference: float
    contrast: float
    sky: float
    sky_noise: float
    sky_level: float
    clipped: float
    clipped_level: float
    clipped_noise: float
    albedo: float
    albedo_spread: float
    warmth: float
    warmth_spread: float
    green: float
    green_spread: float
    color_spread: float
    sun: float


FITTED = Fitted(**json.loads(FILE.read_text(encoding="utf-8"))["values"])
