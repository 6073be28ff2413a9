"""Depth by transmittance, for surfaces that lie deep in a pile of Gaussians: the second search behind `opacityfield`.

The opacity field is opaque at each Gaussian's peak at the latest. Here light fades on both sides of it: along a ray a
Gaussian of opacity a lets v(t) through,

    v(t) = sqrt(1 - G(t)) before its peak,  (1 - a) / sqrt(1 - G(t)) after it,  G(t) = a exp(-(t - peak)^2 / 2 sigma^2),

and the surface lies where the product of all reaches 1 - level. Thin surfaces lie where the first Gaussians begin to
fade, thick ones near their end, so the level rises with the thickness. Source of v: "GGGS", arXiv 2601.17835 (2026),
where the level is .5 everywhere.
"""

import math
from typing import NamedTuple

import numpy as np

from ..base.arrays import Floats, Integers
from ..base.kernels import kernel
from ..base.threads import shared
from .footprints import TILE
from .levelsearch import (
    ACTIVE,
    ALPHA,
    AT,
    ENTRY,
    FARTHEST_Q,
    FRONT,
    HIGH,
    LOW,
    MISSED,
    MOST_STEPS,
    ONE,
    PEAK,
    PEAK_REACH,
    PRECISION,
    SEARCH,
    SLOPE,
    TARGET,
    THROUGH,
    ZERO,
    step,
)
from .rasterize import exp_minus_half


class LevelByThickness(NamedTuple):
    """Share of the light that has faded at the surface, by the thickness of the surface along its normal.

    thicknesses: world units, rising. levels: in (0, 1), one for each; between them it is interpolated, outside held.
    """

    thicknesses: tuple[float, ...]
    levels: tuple[float, ...]

    def of(self, thickness: Floats) -> Floats:
        """Levels (...) float32 of thicknesses (...); NaN stays NaN."""
        return np.interp(thickness, self.thicknesses, self.levels).astype(np.float32)


@shared
@kernel
def search_transmittance(
    begin: int, end: int, lists: Floats, counts: Integers, dealt: Integers, levels: Floats, depth: Floats
) -> None:
    """Move every pixel's depth to where its level of the light has faded.

    lists, counts, dealt: as of `search_level`, after it. levels: (H, W) float32. depth: (H, W) float32 camera z where
    the search begins, NaN where there is no surface; where the level is never reached, it becomes NaN.
    """
    height, width = depth.shape
    tiles_x = (width + TILE - 1) // TILE
    for deal in range(begin, end):
        tile, search = dealt[deal], np.zeros(SEARCH * TILE, np.float32)
        top, left = tile // tiles_x * TILE, tile % tiles_x * TILE
        columns = min(TILE, width - left)
        for row in range(top, min(top + TILE, height)):
            for column in range(np.uint64(TILE)):
                search[AT + column], search[TARGET + column] = ZERO, ONE
            for column in range(columns):
                at, level = depth[row, left + column], levels[row, left + column]
                if at > ZERO:
                    search[AT + np.uint64(column)] = at
                    search[TARGET + np.uint64(column)] = ONE - (ONE - level) * (ONE - level)
            longest = 0
            for column in range(TILE):
                longest = max(longest, counts[tile, row - top, column])
            _search_row(lists[tile, row - top], longest, search)
            for column in range(columns):
                if depth[row, left + column] > ZERO:
                    depth[row, left + column] = search[AT + np.uint64(column)]


@kernel
def _search_row(entries: Floats, longest: int, search: Floats) -> None:
    """Move AT to where one less the squared transmittance reaches TARGET; NaN where it never does."""
    for column in range(np.uint64(TILE)):
        search[LOW + column], search[HIGH + column] = np.float32(np.inf), np.float32(-np.inf)
        search[THROUGH + column] = ONE
    for e in range(longest):
        start = np.uint64(e * ENTRY * TILE)
        for column in range(np.uint64(TILE)):
            share, peak = entries[start + ALPHA + column], entries[start + PEAK + column]
            reach = PEAK_REACH / math.sqrt(entries[start + PRECISION + column])
            low, high = search[LOW + column], search[HIGH + column]
            search[LOW + column] = min(low, peak - reach) if share > ZERO else low
            search[HIGH + column] = max(high, peak + reach) if share > ZERO else high
            search[THROUGH + column] *= (ONE - share) * (ONE - share)
    for column in range(np.uint64(TILE)):
        reached = ONE - search[THROUGH + column] >= search[TARGET + column]
        search[ACTIVE + column] = ONE if reached else ZERO
        search[AT + column] = search[AT + column] if reached else np.float32(np.nan)
        search[MISSED + column] = np.float32(np.inf)
    for _ in range(MOST_STEPS):
        _look_through(entries, longest, search)
        if not step(search):
            break


@kernel
def _look_through(entries: Floats, longest: int, search: Floats) -> None:
    """The squared transmittance up to AT, and how fast it falls there."""
    for column in range(np.uint64(TILE)):
        search[FRONT + column], search[SLOPE + column] = ONE, ZERO
    for e in range(longest):
        start = np.uint64(e * ENTRY * TILE)
        for column in range(np.uint64(TILE)):
            alpha, ahead = entries[start + ALPHA + column], entries[start + PEAK + column] - search[AT + column]
            steep = abs(ahead) * entries[start + PRECISION + column]
            q = abs(ahead) * steep
            share = alpha * exp_minus_half(min(q, FARTHEST_Q))
            share = share if q < FARTHEST_Q else ZERO
            clear = ONE - share
            search[SLOPE + column] += share * steep / clear
            search[FRONT + column] *= clear if ahead > ZERO else (ONE - alpha) * (ONE - alpha) / clear
    for column in range(np.uint64(TILE)):
        search[SLOPE + column] *= search[FRONT + column]
