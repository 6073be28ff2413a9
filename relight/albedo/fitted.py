"""The numbers of the estimate of captured light, as `scripts/fit light` prints them, with the error they leave."""

import json
from pathlib import Path
from typing import NamedTuple

FILE = Path(__file__).parent / "data" / "fitted.json"


class Fitted(NamedTuple):
    """Weights of cues, in nats, and scales of their noise. `fitted.json` holds the values and where they come from.

    parallel, slanted: weight of pairs of neighbours whose normals agree, and of those that differ.
    parallel_slope, slanted_slope: weight against a slope of log colour over log light that is not 1, for either.
    difference: of log albedo (RGB), beyond which two neighbours are of two materials.
    distant, distant_difference: the same of places anywhere whose normals agree.
    sky, sky_noise: weight of the whole upper sky, and its noise in log radiance: bands, tone curve, tint.
    clipped, clipped_level, clipped_noise: the same weight of a clipped sky, its usual log radiance, and its noise.
    albedo, albedo_outdoors: usual median luminance of the albedo of objects, and of soil and plants under a captured
    sky. albedo_spread: of its logarithm, while the form of the light is found.
    warmth, warmth_spread: log red over blue of the mean albedo of objects, and its spread; warmth_outdoors,
    warmth_outdoors_spread: under a captured sky. green, green_spread and so on: green over both.
    doubt: error of sRGB colours for each unit of the spread of the posterior, exceeded by one capture in five.
    """

    parallel: float
    slanted: float
    parallel_slope: float
    slanted_slope: float
    difference: float
    distant: float
    distant_difference: float
    sky: float
    sky_noise: float
    clipped: float
    clipped_level: float
    clipped_noise: float
    albedo: float
    albedo_outdoors: float
    albedo_spread: float
    warmth: float
    warmth_spread: float
    warmth_outdoors: float
    warmth_outdoors_spread: float
    green: float
    green_spread: float
    green_outdoors: float
    green_outdoors_spread: float
    doubt: float


FITTED = Fitted(**json.loads(FILE.read_text(encoding="utf-8"))["values"])
