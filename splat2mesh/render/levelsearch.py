"""Where the opacity of the Gaussians along each pixel's ray reaches a level: the solver behind `opacityfield`.

Pixels are searched a row of a tile at a time, side by side in the lanes of vector instructions.
"""

import math

import numpy as np

from ..base.arrays import Floats, Integers
from ..base.kernels import kernel
from ..base.threads import shared
from .footprints import TILE
from .rasterize import exp_minus_half

SPREAD_FROM, SPREAD_TO = np.float32(0.2), np.float32(0.6)
"""Opacities between which the spread of the surface is measured."""

TOLERANCE = np.float32(1e-3)
"""Error of the opacity at which a search ends: far less than what the level itself is uncertain by."""

MOST_STEPS = 24
"""Steps after which a search ends in any case; the usual number is three."""

FARTHEST_Q = np.float32(12)
"""(peak - t)^2 / sigma^2 beyond which a Gaussian hides nothing: exp(-12 / 2) is less than a step of 8 bits.

The exponential is good to here, and where its argument is cut here too, no slow denormals arise.
"""

PEAK_REACH = np.float32(math.sqrt(FARTHEST_Q))
"""Standard deviations before a peak where its Gaussian hides nothing yet."""


def lanes(count: int) -> tuple[np.uint64, ...]:
    """Where the first `count` rows of TILE floats begin; unsigned, or loops over them become no vector instructions."""
    return tuple(np.uint64(TILE * i) for i in range(count))


# A Gaussian in the lists of a pixel row: opacity at its peak, camera z of the peak, and 1 / sigma^2 in camera z.
ENTRY = 3
ALPHA, PEAK, PRECISION = lanes(ENTRY)

# What the search keeps of a pixel row.
SEARCH = 14
FIRST, LAST, THROUGH, FRONT, LOW, HIGH, AT, MISSED, SLOPE, RATE, DEPTH_RATE, ACTIVE, DEPTH, SPREAD = lanes(SEARCH)
ZERO, HALF, ONE = np.float32(0), np.float32(0.5), np.float32(1)


@shared
@kernel
def search_level(
    begin: int, end: int, lists: Floats, counts: Integers, dealt: Integers, level: np.float32, out: Floats
) -> None:
    """Find the level in every pixel.

    lists: (tiles, TILE, LIST * ENTRY * TILE) float32, the Gaussians of the pixel rows; consumed.
    counts: (tiles, TILE, TILE) int32, how many each pixel has. dealt: permutation of the tiles, over the threads.
    level: float32 in (0, 1).
    out: (tiles, TILE, 2 * TILE) float32: for each pixel row the camera z where the opacity reaches the level, NaN
        where it never does, then the distance in z between the opacities SPREAD_FROM and SPREAD_TO.
    """
    for deal in range(begin, end):
        tile, search = dealt[deal], np.zeros(SEARCH * TILE, np.float32)
        for row in range(TILE):
            _search_row(lists[tile, row], counts[tile, row], level, search)
            for at in range(2 * TILE):
                out[tile, row, at] = search[DEPTH + np.uint64(at)]


@kernel
def _search_row(entries: Floats, counts: Integers, level: np.float32, search: Floats) -> None:
    """Depth and spread of a pixel row, in search[DEPTH] and search[SPREAD]; NaN where the level is not reached."""
    longest = _even_lengths(entries, counts)
    _ranges(entries, longest, level, search)
    for turn in range(3):  # one call, since each is compiled into the place where it stands
        target = level
        if turn > 0:
            target = SPREAD_TO if turn == 1 else SPREAD_FROM
        if turn > 0:
            _bracket(target, level, search)
        _reach(entries, longest, target, search)
        for column in range(np.uint64(TILE)):
            at = search[AT + column]
            if turn == 0:
                reached = ONE - search[THROUGH + column] >= level
                search[DEPTH + column] = at if reached else np.float32(np.nan)
                search[DEPTH_RATE + column] = search[RATE + column]
            else:
                search[SPREAD + column] = at if turn == 1 else search[SPREAD + column] - at


@kernel
def _even_lengths(entries: Floats, counts: Integers) -> int:
    """Let the shorter lists of a row end with Gaussians that hide nothing; returns the length of the longest."""
    longest = 0
    for column in range(TILE):
        longest = max(longest, counts[column])
    for column in range(TILE):
        for entry in range(counts[column] * ENTRY, longest * ENTRY):
            entries[entry * TILE + column] = 0
    return longest


@kernel
def _ranges(entries: Floats, longest: int, level: np.float32, search: Floats) -> None:
    """Prepare the search for the level: the range in which the opacity rises, all it lets through, and a guess. The
    guess is one standard deviation in front of the first peak beyond which the level is reached."""
    for column in range(np.uint64(TILE)):
        search[LOW + column], search[LAST + column] = np.float32(np.inf), np.float32(-np.inf)
        search[THROUGH + column], search[AT + column] = ONE, ZERO
    for e in range(longest):
        start = np.uint64(e * ENTRY * TILE)
        for column in range(np.uint64(TILE)):
            share, peak = entries[start + ALPHA + column], entries[start + PEAK + column]
            width = ONE / math.sqrt(entries[start + PRECISION + column])
            before, at = search[THROUGH + column], search[AT + column]
            after = before * (ONE - share)
            low, last = search[LOW + column], search[LAST + column]
            search[LOW + column] = min(low, peak - PEAK_REACH * width) if share > ZERO else low
            search[LAST + column] = max(last, peak) if share > ZERO else last
            search[AT + column] = peak - width if (before > ONE - level) & (after <= ONE - level) else at
            search[THROUGH + column] = after
    for column in range(np.uint64(TILE)):
        search[FIRST + column], search[HIGH + column] = search[LOW + column], search[LAST + column]


@kernel
def _bracket(target: np.float32, level: np.float32, search: Floats) -> None:
    """Prepare the search for another opacity than the level, which was found at DEPTH."""
    for column in range(np.uint64(TILE)):
        depth = search[DEPTH + column]
        low = depth if target > level else search[FIRST + column]
        high = search[LAST + column] if target > level else depth
        guess = depth + (target - level) / search[DEPTH_RATE + column]
        search[LOW + column], search[HIGH + column] = low, high
        search[AT + column] = min(max(guess, low), high)


@kernel
def _reach(entries: Floats, longest: int, target: np.float32, search: Floats) -> None:
    """Move AT to where the opacity reaches `target`: Newton's steps, or halves of [LOW, HIGH] where those do badly.
    Where the opacity never reaches it, AT becomes the last peak."""
    for column in range(np.uint64(TILE)):
        reached = ONE - search[THROUGH + column] >= target
        search[ACTIVE + column] = ONE if reached else ZERO
        search[AT + column] = search[AT + column] if reached else search[LAST + column]
        search[MISSED + column] = np.float32(np.inf)
    for _ in range(MOST_STEPS):
        _look(entries, longest, search)
        if not _step(target, search):
            break


@kernel
def _look(entries: Floats, longest: int, search: Floats) -> None:
    """The transmittance in front of AT, and the slope of the opacity there."""
    for column in range(np.uint64(TILE)):
        search[FRONT + column], search[SLOPE + column] = ONE, ZERO
    for e in range(longest):
        start = np.uint64(e * ENTRY * TILE)
        for column in range(np.uint64(TILE)):
            ahead = max(entries[start + PEAK + column] - search[AT + column], ZERO)
            steep = ahead * entries[start + PRECISION + column]
            q = ahead * steep
            share = entries[start + ALPHA + column] * exp_minus_half(min(q, FARTHEST_Q))
            share = share if q < FARTHEST_Q else ZERO
            front, slope = search[FRONT + column], search[SLOPE + column]
            search[SLOPE + column] = slope * (ONE - share) + front * share * steep
            search[FRONT + column] = front * (ONE - share)


@kernel
def _step(target: np.float32, search: Floats) -> int:
    """One step of the search in each ACTIVE pixel; returns how many go on."""
    going = 0
    for column in range(np.uint64(TILE)):
        at, active = search[AT + column], search[ACTIVE + column] > ZERO
        missing, slope = target - (ONE - search[FRONT + column]), search[SLOPE + column]
        low = at if missing > ZERO else search[LOW + column]
        high = search[HIGH + column] if missing > ZERO else at
        newton = at + missing / max(slope, np.float32(1e-12))
        # Newton's steps may leave the range, or jump to and fro across a plateau for ever.
        useful = (low < newton) & (newton < high) & (abs(missing) < HALF * search[MISSED + column])
        moved = newton if useful else HALF * (low + high)
        close = abs(missing) < TOLERANCE
        stuck = abs(moved - at) <= np.float32(1e-6) * abs(at)
        search[LOW + column], search[HIGH + column], search[MISSED + column] = low, high, abs(missing)
        search[AT + column] = at if close | (not active) else moved
        search[RATE + column] = slope if active else search[RATE + column]
        goes_on = active & (not close) & (not stuck)
        search[ACTIVE + column] = ONE if goes_on else ZERO
        going += goes_on
    return going
