"""The opacity of space: nested grids of optical depth made from a splat, and rays that march through them.

The innermost grid covers the foreground finely; each further one reaches farther around it, with coarser cells, so
a ray that leaves the garden still meets the house behind it.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bounds, Directions, Floats, Integers, Points, Quaternions, Vector
from ..base.kernels import kernel
from ..base.threads import shared
from ..splats.splats import SOLID, Splats

CELLS, OUTER_CELLS = 12_000_000, 1_500_000
"""Cells of the innermost grid and of each further one: 48 MB, and 6 MB each."""

GROWTH, MOST_LEVELS = 2.0, 7
"""Growth of each further grid's box, and the most grids."""

BEFORE = 0.97
"""Part of the way to a splat on which a ray that is stopped does not see it."""

SAMPLES = 48
"""Most points that distribute a Gaussian over the cells."""

PIXEL_BLOCK = 4
"""Cells along the side of the blocks in which the size of a training pixel is read off."""

FINEST_SHARE = 0.1
"""Of a block's Gaussians, the share that training has shrunk as far as its pixels allow."""

SCALES_PER_PIXEL = 1.4
"""The largest scale of such a Gaussian in training pixels: what training lets shrink."""


OCCUPIED = 0.3
"""Optical depth from which a cell belongs to something."""

STOPPED = -math.log(0.5)
"""Optical depth at which a ray counts as stopped: half of the light is."""


class OpacityGrid(NamedTuple):
    """Nested grids, innermost first. L levels.

    origins: (L, 3) float64 lowest corners. cells: (L,) float64 side of a cell. shapes: (L, 3) int64. starts: (L,)
    int64, where each level begins in `depth`: (C,) float32 optical depth for a ray that crosses the cell.
    pixels: (P,) float32 size of a training pixel per block of PIXEL_BLOCK cells, NaN where no Gaussian lies; levels
    begin at `pixel_starts` (L,).
    """

    origins: NDArray[np.float64]
    cells: NDArray[np.float64]
    shapes: NDArray[np.int64]
    starts: NDArray[np.int64]
    depth: NDArray[np.float32]
    pixels: NDArray[np.float32]
    pixel_starts: NDArray[np.int64]

    @classmethod
    def around(
        cls, splats: Splats, bounds: Bounds, inner_cells: int = CELLS, outer_cells: int = OUTER_CELLS
    ) -> "OpacityGrid":
        """The grids of `splats` around the box `bounds` (2, 3) of their foreground: of so many cells each."""
        center, size = bounds.mean(axis=0), np.ptp(bounds, axis=0)
        solid = splats.means[splats.opacities > SOLID]
        reach = np.abs(solid - center).max(axis=1)
        widest = 2 * np.percentile(reach, 99.9) if len(reach) else size.max()
        levels = 1 + int(np.clip(np.ceil(np.log(max(widest / size.max(), 1)) / np.log(GROWTH)), 0, MOST_LEVELS - 1))
        counts = [outer_cells if level else inner_cells for level in range(levels)]
        origins, cells, grids = nested(splats, splats.opacities, center, size, counts)
        shapes = np.array([grid.shape for grid in grids])
        blocks = -(-shapes // PIXEL_BLOCK)
        starts, pixel_starts = (each.prod(axis=1).cumsum() - each.prod(axis=1) for each in (shapes, blocks))
        depth = np.concatenate([grid.ravel() for grid in grids])
        pixels = np.concatenate([_local_pixels(splats, origins[k], cells[k], blocks[k]) for k in range(levels)])
        return cls(origins, cells, shapes, starts, depth, pixels, pixel_starts)

    def inner(self) -> NDArray[np.float32]:
        """The innermost grid's optical depth, (nx, ny, nz) float32."""
        return self.depth[: self.shapes[0].prod()].reshape(self.shapes[0])

    def finest_pixel(self) -> float:
        """Size of a training pixel where training resolved the innermost grid's surfaces best: its lowest tenth."""
        end = self.pixel_starts[1] if len(self.cells) > 1 else len(self.pixels)
        inner = self.pixels[:end]
        return float(np.percentile(inner[np.isfinite(inner)], 10)) if np.isfinite(inner).any() else float(self.cells[0])

    def march(
        self, points: Points, directions: Directions
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int8]]:
        """Where rays are stopped: (M, 3) points, (K, 3) unit directions -> distance (M, K) float32, inf where never;
        size of the training pixel there (M, K), NaN where unknown; level of the grid in which it was (M, K) int8."""
        shape = len(points), len(directions)
        distance, pixel, level = np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.int8)
        points, directions = np.ascontiguousarray(points, np.float64), np.ascontiguousarray(directions, np.float64)
        _march(len(points), points, directions, self, distance, pixel, level)
        return distance, pixel, level


def nested(
    splats: Splats, opacities: Floats, center: Vector, size: Vector, counts: Sequence[int]
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[NDArray[np.float32]]]:
    """Grids of optical depth about a center (3,), the first of a box of some size (3,), each further one GROWTH times
    as wide: their lowest corners (L, 3), the sides of their cells (L,), and the grids, (X, Y, Z) float32 each.

    opacities: (N,) with which the splats count. counts: of the cells of each grid, about.
    """
    corners, sides, grids = [], [], []
    pattern = normal_points(SAMPLES)
    for level, count in enumerate(counts):
        box = size * GROWTH**level
        cell = float((np.prod(box) / count) ** (1 / 3))
        shape = np.maximum(np.ceil(box / cell).astype(np.int64), 1)
        corner, depth = center - shape * cell / 2, np.zeros(shape.prod(), np.float32)
        deal(splats.means, splats.scales, splats.quats_wxyz, opacities, pattern, corner, cell, shape, depth)
        corners.append(corner)
        sides.append(cell)
        grids.append(depth.reshape(shape))
    return np.array(corners), np.array(sides), grids


def normal_points(count: int) -> NDArray[np.float32]:
    """`count` points of a standard normal distribution: (count, 3) float32."""
    rng = np.random.default_rng(0)
    return rng.standard_normal((count, 3)).astype(np.float32)


def _local_pixels(splats: Splats, origin: Vector, cell: float, blocks: Integers) -> NDArray[np.float32]:
    solid = np.flatnonzero(splats.opacities > SOLID)
    at = np.floor((splats.means[solid] - origin) / (cell * PIXEL_BLOCK)).astype(np.int64)
    inside = ((at >= 0) & (at < blocks)).all(axis=1)
    at, size = at[inside], splats.scales[solid[inside]].max(axis=1)
    key = np.ravel_multi_index(at.T, blocks)
    order = np.lexsort((size, key))
    key, size = key[order], size[order]
    found, first, count = np.unique(key, return_index=True, return_counts=True)
    pixels = np.full(blocks.prod(), np.nan, np.float32)
    pixels[found] = size[first + (FINEST_SHARE * (count - 1)).astype(int)] / SCALES_PER_PIXEL
    return _spread_out(pixels.reshape(blocks)).ravel()


def _spread_out(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same (X, Y, Z) with what is NaN taken from the finest neighbour: a ray may stop just beside the Gaussians."""
    padded = np.pad(pixels, 1, constant_values=np.nan)
    nearest = np.full_like(pixels, np.nan)
    for axis in range(3):
        for shift in (0, 2):
            window = [slice(1, -1)] * 3
            window[axis] = slice(shift, shift + pixels.shape[axis])
            nearest = np.fmin(nearest, padded[tuple(window)])
    return np.where(np.isfinite(pixels), pixels, nearest)


@kernel
def deal(
    means: Points,
    scales: Floats,
    quats: Quaternions,
    opacities: Floats,
    pattern: Points,
    origin: Vector,
    cell: float,
    shape: Integers,
    depth: Floats,
) -> None:
    """Add to `depth`, (C,) cells of a `shape` (3,), what Gaussians take of a ray; `pattern`: `normal_points`."""
    for i in range(len(means)):
        s = scales[i]
        largest = max(s[0], s[1], s[2])
        reach = 3 * largest
        outside = False
        for axis in range(3):
            at = (means[i, axis] - origin[axis]) / cell
            if at < -reach / cell or at > shape[axis] + reach / cell:
                outside = True
        if outside or not opacities[i] > 0.004:
            continue
        smallest = min(s[0], s[1], s[2])
        middle = s[0] + s[1] + s[2] - largest - smallest
        area = 2 * math.pi * largest * middle / (cell * cell)
        count = int(min(max(math.ceil(2 * area), 1), len(pattern)))
        share = min(opacities[i] * area / count, -math.log(max(1 - opacities[i], 0.01)))
        w, x, y, z = quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3]
        for k in range(count):
            if count == 1:
                a, b, c = 0.0, 0.0, 0.0
            else:
                a, b, c = pattern[k, 0] * s[0], pattern[k, 1] * s[1], pattern[k, 2] * s[2]
            px = means[i, 0] + (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c
            py = means[i, 1] + 2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c
            pz = means[i, 2] + 2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c
            u, v, t = (px - origin[0]) / cell, (py - origin[1]) / cell, (pz - origin[2]) / cell
            if 0 <= u < shape[0] and 0 <= v < shape[1] and 0 <= t < shape[2]:
                depth[(int(u) * shape[1] + int(v)) * shape[2] + int(t)] += share


@shared
@kernel
def _march(
    begin: int,
    end: int,
    points: Points,
    directions: Directions,
    grid: OpacityGrid,
    distance: Floats,
    pixel: Floats,
    level: Integers,
) -> None:
    origins, cells, shapes, pixels = grid.origins, grid.cells, grid.shapes, grid.pixels
    for m in range(begin, end):
        for k in range(len(directions)):
            dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
            x, y, z = points[m, 0], points[m, 1], points[m, 2]
            gone, passed, at = 0.0, 0.0, 0
            distance[m, k], pixel[m, k], level[m, k] = np.inf, np.nan, -1
            while True:
                cell = cells[at]
                u = (x + gone * dx - origins[at, 0]) / cell
                v = (y + gone * dy - origins[at, 1]) / cell
                t = (z + gone * dz - origins[at, 2]) / cell
                if not (0 <= u < shapes[at, 0] and 0 <= v < shapes[at, 1] and 0 <= t < shapes[at, 2]):
                    at += 1
                    if at == len(cells):
                        break
                    continue
                i, j, h = int(u), int(v), int(t)
                passed += grid.depth[grid.starts[at] + (i * shapes[at, 1] + j) * shapes[at, 2] + h]
                if passed > STOPPED:
                    distance[m, k], level[m, k] = gone, at
                    by, bz = -(-shapes[at, 1] // PIXEL_BLOCK), -(-shapes[at, 2] // PIXEL_BLOCK)
                    pixel[m, k] = pixels[
                        grid.pixel_starts[at] + ((i // PIXEL_BLOCK) * by + j // PIXEL_BLOCK) * bz + h // PIXEL_BLOCK
                    ]
                    break
                gone += cell
