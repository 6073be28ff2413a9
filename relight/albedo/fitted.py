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
    sky, sky_noise: weight of the whole upper sky, and its noise in log radiance: bands, tone curve, tint.
    clipped, clipped_level, clipped_noise: the same weight of a clipped sky, its usual log radiance, and its noise.
    albedo, warmth, green: usual colour of objects: median luminance, and mean log red over blue, and green over both.
    albedo_outdoors, warmth_outdoors, green_outdoors: the same of soil and plants, under a captured sky.
    albedo_spread, warmth_spread, green_spread: of these logarithms.
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
    clipped: float
    clipped_level: float
    clipped_noise: float
    albedo: float
    albedo_outdoors: float
    albedo_spread: float
    warmth: float
    warmth_outdoors: float
    warmth_spread: float
    green: float
    green_outdoors: float
    green_spread: float
    color_spread: float
    sun: float


FITTED = Fitted(**json.loads(FILE.read_text(encoding="utf-8"))["values"])
