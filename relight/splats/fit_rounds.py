"""Loops of the fit in views: each tile is drawn and compared in the processor's nearest cache, and no picture is kept.

The sums are those of `Blending.drawn` and `Blending.spread`, in their order: to the bit.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import shared
from splat2mesh.render.rasterize import ZERO
from splat2mesh.render.screentiles import AREA

from .blend_lists import SHARES
from .blending import Blending, add_to, draw_tile


class FitRounds(NamedTuple):
    """The pixels of a Blending that a fit compares. known: (Q,) int64, ascending. first: (T + 1,) int64, the first of
    each tile."""

    blending: Blending
    known: NDArray[np.int64]
    first: NDArray[np.int64]

    @classmethod
    def of(cls, blending: Blending, known: NDArray[np.int64]) -> "FitRounds":
        """Those of the pixels `known`, (Q,) int64 ascending."""
        return cls(blending, known, np.searchsorted(known, AREA * np.arange(len(blending.runs))))

    def begin(self, colors: NDArray[np.float32], gains: NDArray[np.float32], weight: NDArray[np.float32]) -> None:
        """Multiply gains (Q, 3) by the picture of colours (N, 3), and add to weight (N, 1) the shares of each Gaussian
        in the known pixels, float32 all."""
        for begin, count, runs, seen in self._views(1):
            _wanted(count, begin, *self.blending[1:], self.first, self.known, colors, gains, seen)
            add_to(self.blending.splats[runs], seen, weight)

    def spread(self, colors: NDArray[np.float32], wanted: NDArray[np.float32], sums: NDArray[np.float32]) -> None:
        """Add to each Gaussian, sums (N, 3), its shares of what the picture of colours (N, 3) lacks of `wanted` (Q, 3),
        float32 all."""
        for begin, count, runs, seen in self._views(3):
            _errors(count, begin, *self.blending[1:], self.first, self.known, colors, wanted, seen)
            add_to(self.blending.splats[runs], seen, sums)

    def _views(self, width: int) -> list[tuple[int, int, slice, NDArray[np.float32]]]:
        """Of each view its first tile, how many there are, its runs, and what these will have seen."""
        tiles, runs = self.blending.tiles, self.blending.runs
        ends = [(first, last, slice(runs[first], runs[last])) for first, last in pairwise(tiles)]
        most = max((part.stop - part.start for _, _, part in ends), default=0)
        seen = np.zeros((most, width), np.float32)  # written whole before it is read
        return [(int(first), int(last - first), part, seen[: part.stop - part.start]) for first, last, part in ends]


@shared
@kernel
def _wanted(
    begin: int,
    end: int,
    first_tile: int,
    runs: NDArray[np.int64],
    items: NDArray[np.int64],
    splats: NDArray[np.int32],
    counts: NDArray[np.uint16],
    pixels: NDArray[np.uint8],
    shares: NDArray[np.uint8],
    first: NDArray[np.int64],
    known: NDArray[np.int64],
    colors: NDArray[np.float32],
    gains: NDArray[np.float32],
    seen: NDArray[np.float32],
) -> None:
    picture, counted = np.empty((AREA, 4), np.float32), np.empty(AREA, np.float32)
    for tile in range(first_tile + begin, first_tile + end):
        counted[:] = ZERO
        picture[:, :] = ZERO
        draw_tile(tile, runs, items, splats, counts, pixels, shares, colors, picture)
        for q in range(first[tile], first[tile + 1]):
            p = known[q] - tile * AREA
            counted[p] = np.float32(1)
            for c in range(3):
                gains[q, c] *= picture[p, c]
        at = items[tile]
        for run in range(runs[tile], runs[tile + 1]):
            total = ZERO
            for i in range(at, at + counts[run]):
                total += SHARES[shares[i]] * counted[pixels[i]]
            seen[run - runs[first_tile], 0] = total
            at += counts[run]


@shared
@kernel
def _errors(
    begin: int,
    end: int,
    first_tile: int,
    runs: NDArray[np.int64],
    items: NDArray[np.int64],
    splats: NDArray[np.int32],
    counts: NDArray[np.uint16],
    pixels: NDArray[np.uint8],
    shares: NDArray[np.uint8],
    first: NDArray[np.int64],
    known: NDArray[np.int64],
    colors: NDArray[np.float32],
    wanted: NDArray[np.float32],
    seen: NDArray[np.float32],
) -> None:
    picture, error = np.empty((AREA, 4), np.float32), np.empty((AREA, 4), np.float32)
    for tile in range(first_tile + begin, first_tile + end):
        picture[:, :], error[:, :] = ZERO, ZERO
        draw_tile(tile, runs, items, splats, counts, pixels, shares, colors, picture)
        for q in range(first[tile], first[tile + 1]):
            p = known[q] - tile * AREA
            for c in range(3):
                error[p, c] = wanted[q, c] - picture[p, c]
        at = items[tile]
        for run in range(runs[tile], runs[tile + 1]):
            red, green, blue = ZERO, ZERO, ZERO
            for i in range(at, at + counts[run]):
                p, share = np.int64(pixels[i]), SHARES[shares[i]]
                red += share * error[p, 0]
                green += share * error[p, 1]
                blue += share * error[p, 2]
            row = run - runs[first_tile]
            seen[row, 0], seen[row, 1], seen[row, 2] = red, green, blue
            at += counts[run]
