"""Lamps that a person points at: lamps not found by colour alone, grown from the place pointed at."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask
from splat2mesh.base.errors import InputError

from ..transfer.occluder import Occluder
from .lamps import GLOWS, Lamp, Pieces

FAR = 0.05
"""Largest distance from a surface, in diagonals, at which a position points at it."""

NEAR = 0.015
"""The same, about the nearest surface: the brightest vertex there is meant. 11 cm in a room of 7.5 m across; a place
that is read off a viewer lies that far beside a small lamp."""

REACH = 0.1
"""The same, about that vertex: how far the lamp goes at most, or a white wall beside it would be part of it."""

LEAST_PEAK = 0.3
"""Least linear value of the brightest channel of a possible lamp, over white."""

AS_BRIGHT, AS_GLOW = 0.75, 0.5
"""Of the brightest vertex: least peak of what belongs to its lamp, and of the glow around it, which has its colour."""


def lamps_at(
    occluder: Occluder,
    captured: NDArray[np.float32],  # (V, 3), areas (V,), bounce (V, 3): as of `lamps.find`
    areas: NDArray[np.float64],
    bounce: NDArray[np.float32],
    places: NDArray[np.floating],  # (P, 3), unit frame
    names: Sequence[str],  # of each place in messages
    found: Sequence[Lamp],  # the known lamps; a place on one of them means it
) -> tuple[list[Lamp], list[int]]:
    """Further lamps that places point at, in their order, and which lamp each means, of `found` and these in a row.

    Raises InputError for a place with no surface near it, or with nothing bright on that.
    """
    more: list[Lamp] = []
    numbers = []
    for place, name in zip(np.asarray(places, np.float64), names, strict=True):
        away = np.linalg.norm(occluder.origins - place, axis=1)
        nearest = float(away.min())
        if not nearest <= FAR:
            problem = f"the nearest surface is {nearest:.0%} of the scene's diagonal away"
            raise InputError(f"`lamps` {name}: {problem}; expected a place on a lamp, in the frame of the splat")
        around = np.flatnonzero(away <= nearest + NEAR)
        known = [*found, *more]
        meant = [number for number, lamp in enumerate(known) if np.isin(around, lamp.rows).any()]
        if not meant:
            seed = around[np.lexsort((away[around], -captured[around].max(axis=1)))[0]]
            peak = float(captured[seed].max())
            if peak < LEAST_PEAK:
                problem = f"what is there was captured at {peak:.2f} of white; a lamp is at {LEAST_PEAK:g} or more"
                raise InputError(f"`lamps` {name}: {problem}")
            more.append(_grown(occluder, captured, areas, bounce, int(seed), known))
            meant = [len(known)]
        numbers.append(min(meant, key=lambda number: away[[*found, *more][number].rows].min()))
    return more, numbers


def _grown(
    occluder: Occluder,
    captured: NDArray[np.float32],
    areas: NDArray[np.float64],
    bounce: NDArray[np.float32],
    seed: int,
    known: Sequence[Lamp],
) -> Lamp:
    """The lamp around a vertex: the connected vertices about as bright as it, glowing if it glows."""
    peak = captured.max(axis=1)
    near: Mask = np.linalg.norm(occluder.origins - occluder.origins[seed], axis=1) < REACH
    for lamp in known:
        near[lamp.rows] = False
    glows = peak > GLOWS * bounce.max(axis=1)
    if glows[seed]:
        near &= glows
    pieces = Pieces(occluder)

    def joined(chosen: Mask) -> NDArray[np.int64]:
        piece = pieces.of(chosen)
        return np.flatnonzero(piece == piece[seed])

    rows = joined(near & (peak >= AS_BRIGHT * peak[seed]))
    around = joined(near & (peak >= AS_GLOW * peak[seed]))

    def mean(of: NDArray[np.int64], values: NDArray[np.floating]) -> NDArray[np.float64]:
        weight = np.maximum(areas[of], 1e-12)
        return np.asarray(weight / weight.sum() @ values[of].astype(np.float64), np.float64)

    area = float(np.maximum(areas[rows], 1e-12).sum())
    return Lamp(rows, area, mean(rows, occluder.origins), mean(rows, occluder.normals), mean(around, captured))
