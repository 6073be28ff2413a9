"""Which of many lamps a vertex samples: the brightest for certain, and a random few of the others.

The probability of each other lamp is proportional to its brightness in the vertex's neighbourhood. So the cost of a
vertex does not grow with the number of lamps, and its light is right on average.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import over

from .emitters import Emitters

ALONE = 24
"""Number of brightest emitters that a vertex samples for certain; it samples all if there are no more than these."""

BLOCK = 16
"""Vertices, side by side along a curve through space, that share a list of the brightest. Among 64, which reach over
the gaps between bodies, some have a lamp at hand that is none of the brightest in their middle: single bright dots."""


class Chosen(NamedTuple):
    """Which emitters a run of vertices takes: (V, E) int32, -1 for none, and their weights (V, E) float32."""

    emitters: NDArray[np.int32]
    weights: NDArray[np.float32]


def chosen_at(places: tuple[NDArray[np.float32], ...], emitters: Emitters, least: float, chance: int) -> Chosen:
    """Return the emitters that vertices take, of whose places as of `tracing.Lit`: all where there are few; else the
    brightest, and `chance` others."""
    origins, _, _, offsets = places
    count = len(emitters.kind)
    if count <= ALONE + chance:
        every = np.broadcast_to(np.arange(count, dtype=np.int32), (len(origins), count))
        return Chosen(np.ascontiguousarray(every), np.ones(every.shape, np.float32))
    taken = np.full((len(origins), ALONE + chance), -1, np.int32)
    weights = np.zeros(taken.shape, np.float32)
    blocks = -(-len(origins) // BLOCK)
    each = max(1, blocks // 16)
    spans = [(begin, min(begin + each, blocks)) for begin in range(0, blocks, each)]
    over(_choose, spans, origins, offsets, emitters, np.float32(least), taken, weights)
    return Chosen(taken, weights)


@kernel
def _choose(
    begin: int,
    end: int,
    origins: NDArray,
    offsets: NDArray,
    emitters: Emitters,
    least: float,
    taken: NDArray,
    weights: NDArray,
) -> None:
    """Choose for blocks of vertices: the brightest by what they give at its middle, others by chance."""
    count = len(emitters.kind)
    usual = np.empty(count, np.float32)
    reached = np.empty(count, np.float64)
    best = np.empty(ALONE, np.int64)
    for block in range(begin, end):
        first, last = block * BLOCK, min((block + 1) * BLOCK, len(origins))
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for v in range(first, last):
            for axis in range(3):
                low[axis] = min(low[axis], origins[v, axis])
                high[axis] = max(high[axis], origins[v, axis])
        radius = 0.0
        for axis in range(3):
            radius += (high[axis] - low[axis]) ** 2
        radius = 0.5 * np.sqrt(radius)
        for e in range(count):
            square = 0.0
            for axis in range(3):
                square += (0.5 * (low[axis] + high[axis]) - emitters.middle[e, axis]) ** 2
            distance = max(np.sqrt(square) - emitters.reach[e], 0.0)
            mean = emitters.power[e] / (distance * distance + radius * radius + np.float32(1e-12))
            near = max(distance - radius, 0.0)
            dark = emitters.power[e] < least * near * near
            usual[e] = 0.0 if dark else min(emitters.peak[e], mean)
        alone = _brightest(usual, best)
        total = 0.0
        for e in range(count):
            total += usual[e]
            reached[e] = total
        for v in range(first, last):
            for k in range(alone):
                taken[v, k], weights[v, k] = best[k], 1.0
            if total <= 0.0:
                continue
            chance = taken.shape[1] - ALONE
            for k in range(chance):
                at = (k + offsets[v, 0]) / chance * total
                e = min(np.searchsorted(reached, at, side="right"), count - 1)
                while e > 0 and usual[e] == 0.0:
                    e -= 1
                taken[v, ALONE + k] = e
                weights[v, ALONE + k] = total / (chance * usual[e])


@kernel
def _brightest(most: NDArray, best: NDArray) -> int:
    """The indices of the largest numbers into `best`, and zeros in their place; how many there are above 0."""
    found = 0
    least = np.float32(0.0)
    for e in range(len(most)):
        if most[e] <= least:
            continue
        if found < len(best):
            k = found
            found += 1
        else:
            k = len(best) - 1
        while k > 0 and most[best[k - 1]] < most[e]:
            best[k] = best[k - 1]
            k -= 1
        best[k] = e
        if found == len(best):
            least = most[best[len(best) - 1]]
    for k in range(found):
        most[best[k]] = 0.0
    return found
