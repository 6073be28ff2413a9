"""The number of rays that the first bounce of placed lamps needs, measured on a sample of the vertices."""

import math
import sys
import time

import numpy as np
from numpy.typing import NDArray

from ..transfer.bounces import Interreflection
from ..transfer.first_bounce import first_bounce
from ..transfer.occluder import Occluder
from ..transfer.settings import BOUNCE_RAYS
from . import costs
from .lamp_plan import SAMPLE, RayPlan

CHOICES = tuple(rays for rays in costs.BOUNCE_RAYS if rays >= BOUNCE_RAYS)

BRIGHT = 90.0
"""Percentile of all light above which a vertex counts as if it had that much: the pool of a spot is overexposed where
the rest of the room is seen, and would hide its noise."""


def plan_first_bounce(
    occluder: Occluder,
    sent: NDArray[np.float32],
    matrix: Interreflection,
    beside: NDArray[np.float32],
    tolerance: float,
    seed: int = 0,
) -> RayPlan:
    """Choose the fewest rays that keep to a tolerance; those of the matrix where they do.

    Two independent sets of rays differ by their noise, so no converged reference is traced. That would take 2,048 rays
    from each of 1,024 vertices: more than the work itself in scenes of a few thousand vertices.

    occluder: as `first_bounce` takes it. sent: (V, 3) float32, exit radiance of the surfaces in the direct light of the
    lamps. matrix: the bounces that are there. beside: (V, 3) float32, all other light that vertices receive, irradiance
    over pi: an error counts as a part of all light. tolerance: relative error that is accepted. seed: of the sample and
    of the rays.
    """
    count = len(occluder.origins)
    rows = np.sort(np.random.default_rng(seed).choice(count, min(SAMPLE, count), replace=False))
    there = matrix.bounce(sent)[rows]
    curve: list[tuple[float, float, int]] = []
    for rays in CHOICES:
        start = time.perf_counter()
        one = first_bounce(occluder, sent, rays, rows, seed)
        seconds = (time.perf_counter() - start) * count / len(rows)
        other = first_bounce(occluder, sent, rays, rows, seed + 1)
        mean, noise = (one + other) / np.float32(2.0), _square(one - other) / 2.0
        whole = _brightness(mean + beside[rows])
        if not curve:  # the mean has half of the noise of either, which is no error of the matrix
            curve.append((0.0, math.sqrt(max(_square(there - mean) - noise / 2.0, 0.0)) / whole, 0))
            if curve[0][1] <= tolerance:
                break
        curve.append((seconds, math.sqrt(noise) / whole, rays))
        if curve[-1][1] <= tolerance:
            break
    seconds, error, rays = curve[-1]
    return RayPlan(rays, error, seconds, curve, error <= tolerance)


def _square(off: NDArray[np.float32]) -> float:
    return float(np.square(off).mean(dtype=np.float64))


def _brightness(light: NDArray[np.float32]) -> float:
    """Root mean square of light (N, 3), as BRIGHT counts it."""
    each = np.sqrt(np.square(light, dtype=np.float64).mean(axis=1))
    return max(math.sqrt(float(np.square(np.minimum(each, np.percentile(each, BRIGHT))).mean())), sys.float_info.min)
