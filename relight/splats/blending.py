"""The Gaussians of each pixel of some views and their weights: kept once, they draw any colours by sums.

Rendering sums the colours of Gaussians by weights that no light changes. So the weights are found once (`blend_lists`),
and every picture and its transpose is a product of sparse rows. Each tile has one thread, and sums over the Gaussians
have a fixed order: bits do not depend on threads.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask
from splat2mesh.base.errors import InputError
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import shared
from splat2mesh.render.rasterize import ZERO
from splat2mesh.render.screentiles import AREA
from splat2mesh.render.view import View
from splat2mesh.splats.splats import Splats, colors_toward

from .blend_lists import SHARES, in_tiles, listed, within


class Blending(NamedTuple):
    """The shares of Gaussians in the P = T * 256 pixels of all tiles of some views, pixels tile after tile.

    tiles: (L + 1,) int64, tiles[v] is the first of view v. runs: (T + 1,) int64, the first run of each tile, where a
    run is what one Gaussian gives one tile. items: (T + 1,) int64, the first item of each tile. splats: (R,) int32 and
    counts: (R,) uint16, the Gaussian and the number of items of each run, nearest first. pixels: (I,) uint8 within the
    tile and shares: (I,) uint8, an index of SHARES, of each item.
    """

    tiles: NDArray[np.int64]
    runs: NDArray[np.int64]
    items: NDArray[np.int64]
    splats: NDArray[np.int32]
    counts: NDArray[np.uint16]
    pixels: NDArray[np.uint8]
    shares: NDArray[np.uint8]

    def checked(self, count: int) -> "Blending":
        """Itself, where it is one of `count` Gaussians. Raises InputError for what loops cannot trust."""
        tiles, runs, items, splats, counts, pixels, shares = self
        whole = all(each.ndim == 1 for each in self) and [each.dtype.str[1:] for each in self] == _KINDS
        if not whole or len(runs) != len(items) or len(runs) == 0 or len(tiles) == 0:
            raise InputError("kept pictures are of another kind")
        for starts, end in ((tiles, len(runs) - 1), (runs, len(splats)), (items, len(pixels))):
            if starts[0] != 0 or starts[-1] != end or (np.diff(starts) < 0).any():
                raise InputError("kept pictures do not fit together")
        reached = np.append(0, np.cumsum(counts, dtype=np.int64))
        if len(counts) != len(splats) or len(shares) != len(pixels) or (reached[runs] != items).any():
            raise InputError("kept pictures do not fit together")
        if splats.min(initial=0) < 0 or splats.max(initial=-1) >= count:
            raise InputError(f"kept pictures show others than {count} splats")
        return self

    def of_view(self, number: int) -> "Blending":
        """The Blending of one view alone, without a copy of what is large."""
        first, last = self.tiles[number : number + 2]
        runs, items = self.runs[first : last + 1], self.items[first : last + 1]
        run, item = slice(runs[0], runs[-1]), slice(items[0], items[-1])
        tiles = np.array([0, last - first], np.int64)
        lists = self.splats[run], self.counts[run], self.pixels[item], self.shares[item]
        return Blending(tiles, runs - runs[0], items - items[0], *lists)

    def of_pixels(self, wanted: Mask) -> "Blending":
        """The picture of the pixels (P,) bool alone; the others stay black."""
        lists = (each.copy() for each in (self.splats, self.counts, self.pixels, self.shares))
        left, held, *kept = within((np.diff(self.runs), np.diff(self.items), *lists), wanted)
        starts = [np.append(0, np.cumsum(counts, dtype=np.int64)) for counts in (left, held)]
        return Blending(self.tiles, *starts, *kept)

    def drawn(self, colors: NDArray[np.float32]) -> NDArray[np.float32]:
        """The pixels, (P, 3) float32 over black, of Gaussians of colours (N, 3) float32."""
        picture = np.zeros((AREA * (len(self.runs) - 1), 3), np.float32)
        _draw(len(self.runs) - 1, *self[1:], colors, picture)
        return picture

    @property
    def seen(self) -> NDArray[np.int64]:
        """Numbers of the Gaussians that these pixels show."""
        return np.unique(self.splats).astype(np.int64)

    def drawn_toward(
        self, means: NDArray[np.float32], sh: NDArray[np.float32], eye: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        """The pixels, as `drawn`, of Gaussians of centres (N, 3) and colour coefficients (N, K, 3), as seen from an
        eye (3,)."""
        colors, seen = np.zeros((len(means), 3), np.float32), self.seen
        colors[seen] = colors_toward(means[seen], sh[seen], eye.astype(np.float32))
        return self.drawn(colors)

    def spread(self, values: NDArray[np.float32], sums: NDArray[np.float32]) -> None:
        """Add to each Gaussian, sums (N, 3), its shares of the pixels' values (P, 3), float32 both."""
        for first, last in zip(self.tiles[:-1], self.tiles[1:], strict=True):
            begin, end = self.runs[first], self.runs[last]
            seen = np.zeros((end - begin, 3), np.float32)
            lists = self.runs, self.items, self.counts, self.pixels, self.shares
            _gather(last - first, first, *lists, values, seen)
            _add_to(self.splats[begin:end], seen, sums)


Visit: TypeAlias = Callable[[int, NDArray[np.float32], NDArray[np.float32]], Mask | None]
"""Takes the number of a view, its alpha (H, W) and its median depth (H, W), camera z."""

_KINDS = ["i8", "i8", "i8", "i4", "u2", "u1", "u1"]


def blending_of(
    splats: Splats,
    views: Sequence[View],  # in their frame
    near: float,  # camera z of the near plane
    look: Visit = lambda number, alpha, depth: None,
) -> Blending:
    """Return the Blending of some views of splats. `look` is called with each view as `Rendering` shows it.

    The look may return the pixels that are wanted, (H, W) bool: then no other has shares.
    """
    tiles, parts = [0], []
    for number, view in enumerate(views):
        part, alpha, depth = listed(splats, view, near)
        wanted = look(number, alpha, depth)
        if wanted is not None:
            part = within(part, in_tiles(wanted))
        parts.append(part)
        tiles.append(tiles[-1] + len(part[0]))
    runs, items, *lists = ([part[i] for part in parts] for i in range(6))
    starts = [np.append(0, np.cumsum(np.concatenate(counts), dtype=np.int64)) for counts in (runs, items)]
    return Blending(np.array(tiles, np.int64), *starts, *(np.concatenate(each) for each in lists))


@shared
@kernel
def _draw(
    begin: int,
    end: int,
    runs: NDArray[np.int64],
    items: NDArray[np.int64],
    splats: NDArray[np.int32],
    counts: NDArray[np.uint16],
    pixels: NDArray[np.uint8],
    shares: NDArray[np.uint8],
    colors: NDArray[np.float32],
    picture: NDArray[np.float32],
) -> None:
    for tile in range(begin, end):
        part, at = picture[tile * AREA : (tile + 1) * AREA], items[tile]
        for run in range(runs[tile], runs[tile + 1]):
            k = splats[run]
            red, green, blue = colors[k, 0], colors[k, 1], colors[k, 2]
            for i in range(at, at + counts[run]):
                p, share = np.int64(pixels[i]), SHARES[shares[i]]
                part[p, 0] += share * red
                part[p, 1] += share * green
                part[p, 2] += share * blue
            at += counts[run]


@shared
@kernel
def _gather(
    begin: int,
    end: int,
    first: int,
    runs: NDArray[np.int64],
    items: NDArray[np.int64],
    counts: NDArray[np.uint16],
    pixels: NDArray[np.uint8],
    shares: NDArray[np.uint8],
    values: NDArray[np.float32],
    seen: NDArray[np.float32],
) -> None:
    """The picture of each run of a view's tiles, (R, 3); first is the view's first tile."""
    for tile in range(first + begin, first + end):
        at, base = items[tile], tile * AREA
        for run in range(runs[tile], runs[tile + 1]):
            red, green, blue = ZERO, ZERO, ZERO
            for i in range(at, at + counts[run]):
                p, share = base + pixels[i], SHARES[shares[i]]
                red += share * values[p, 0]
                green += share * values[p, 1]
                blue += share * values[p, 2]
            row = run - runs[first]
            seen[row, 0], seen[row, 1], seen[row, 2] = red, green, blue
            at += counts[run]


@kernel
def _add_to(splats: NDArray[np.int32], seen: NDArray[np.float32], sums: NDArray[np.float32]) -> None:
    """Add what runs have seen, (R, 3), to the sums (N, 3) of their Gaussians (R,)."""
    for run in range(len(splats)):
        for c in range(3):
            sums[splats[run], c] += seen[run, c]
