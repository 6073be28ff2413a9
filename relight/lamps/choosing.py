"""Which of many lamps a vertex samples: the brightest for certain, and a random few of the others.

The probability of each other lamp is proportional to its brightness in the vertex's neighbourhood. So the cost of a
vertex does not grow with the number of lamps, and its light is right on average.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.threads import ROWS_AT_ONCE, in_batches

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

    def choose(part: slice) -> None:
        usual = _usual(origins[part], emitters, least)
        block = np.arange(len(origins[part])) // BLOCK
        best = np.argpartition(-usual, ALONE, axis=1)[:, :ALONE]
        alone = np.take_along_axis(usual, best, axis=1) > 0.0
        taken[part, :ALONE], weights[part, :ALONE] = np.where(alone, best, -1)[block], alone[block]
        np.put_along_axis(usual, best, 0.0, axis=1)
        total = usual.sum(axis=1)
        share = np.cumsum(usual, axis=1) / np.maximum(total, 1e-300)[:, None]
        at = (np.arange(chance) + offsets[part, :1]) / chance
        found = np.searchsorted((share + np.arange(len(share))[:, None]).ravel(), at + block[:, None], side="right")
        found = np.minimum(found - block[:, None] * count, count - 1)
        bright = usual[block[:, None], found]
        lit = bright > 0.0
        taken[part, ALONE:] = np.where(lit, found, -1)
        weights[part, ALONE:] = np.where(lit, total[block, None] / (chance * np.where(lit, bright, 1.0)), 0.0)

    in_batches(choose, len(origins), BLOCK * max(1, ROWS_AT_ONCE // count))
    return Chosen(taken, weights)


def _usual(origins: NDArray[np.float32], emitters: Emitters, least: float) -> NDArray[np.float64]:
    """What emitters give in the middle of each BLOCK of vertices (V, 3), at most: (B, E); 0 for less than `least`."""
    starts = np.arange(0, len(origins), BLOCK)
    low, high = (each.reduceat(origins, starts, axis=0) for each in (np.minimum, np.maximum))
    radius = 0.5 * np.linalg.norm(high - low, axis=1, keepdims=True)
    distance = scipy.spatial.distance.cdist(0.5 * (low + high), emitters.middle)
    distance = np.maximum(distance - emitters.reach, 0.0)
    mean = np.minimum(emitters.peak, emitters.power / (distance**2 + radius**2 + 1e-12))
    return np.where(emitters.power < least * np.maximum(distance - radius, 0.0) ** 2, 0.0, mean)
