"""Depth maps of a place fused into a signed distance field whose cells are as large as the pixels that saw the surface.

Like `fusion` for objects, with an octree instead of equal voxels: the band kept on either side of a surface is as
thick as the surface looks in each pixel, and cells that a view cannot see are skipped.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Faces, Floats, Integers, Points, Vector
from ..base.kernels import kernel
from ..base.threads import shared
from ..render.footprints import TILE
from ..render.view import stacked
from .dualmesh import dual_mesh
from .octree import Corners, corners_of, leaves_of, requested_cells
from .sight import FusionSight, Truncation

ENOUGH_WEIGHT = 0.003
"""Sum of weights that a corner needs before it takes part in the surface."""

MOST_CELLS = 1_600_000
"""Cells that the pixels may ask for; more make all of them larger. Each takes about 150 bytes on the way."""

BATCH = 512
"""Points that are tested against a view's pyramid and depth together."""

SLABS = 100
"""Parts into which the points are cut to report progress, in percent."""


def fuse_adaptively(
    sights: Sequence[FusionSight], origin: Vector, stage: Callable[[int], None] = lambda count: None
) -> tuple[NDArray[np.float64], Faces, Floats]:
    """Fuse Sights: returns world vertices (V, 3) float64, faces (F, 3) int32 and the side of each vertex's cell (V,).
    origin: (3,) float64 in the middle of the place: numbers stay small around it."""
    finest = min(float(sight.step[sight.weight > 0].min()) for sight in sights if (sight.weight > 0).any())
    larger = 1.0
    while True:
        steps = [sight.step * np.float32(larger) for sight in sights]
        truncation = Truncation(finest * larger)
        requested = requested_cells(sights, steps, origin, truncation, MOST_CELLS)
        if requested is not None:
            break
        larger *= 1.2
    finest = truncation.finest
    leaves = leaves_of(requested)
    corners = corners_of(leaves)
    maps = packed(sights, origin)
    values, weights = np.zeros(len(corners.positions), np.float32), np.zeros(len(corners.positions), np.float32)
    batches = -(-len(values) // BATCH)
    dealt = np.random.default_rng(0).permutation(batches)
    for part in np.array_split(dealt, SLABS):
        integrate(len(part), corners, part, truncation, maps, values, weights)
        stage(1)
    vertices, faces, levels = dual_mesh(leaves, corners, values, weights, ENOUGH_WEIGHT)
    return vertices * finest + origin, faces, finest * 2.0**levels


class PackedSights(NamedTuple):
    """All maps of M sights one after the other, as the kernels read them. P pixels, T tiles of TILE pixels.

    poses: (M, 3, 4) float64 camera_from_world, of a world about the origin of the fusion. lenses: (M, 4) float64 fx,
    fy, cx, cy. sizes: (M, 2) int64 height and width. starts: (M,) int64 first pixel of each. square_starts: (M,) int64
    first square of each. pixels: (P, 7) float32 normal, camera z, weight, spread and step. deepest: (T,) float32
    camera z behind which a square shows nothing.
    """

    poses: NDArray[np.float64]
    lenses: NDArray[np.float64]
    sizes: NDArray[np.int64]
    starts: NDArray[np.int64]
    square_starts: NDArray[np.int64]
    pixels: NDArray[np.float32]
    deepest: NDArray[np.float32]


def packed(sights: Sequence[FusionSight], origin: Vector) -> PackedSights:
    """All maps of some sights for the kernel; origin: (3,) world."""
    stack = stacked([sight.view for sight in sights])
    square_starts, squares, pixels = [], [], np.empty((stack.sizes.prod(axis=1).sum(), 7), np.float32)
    square_start = 0
    for sight, pose, start in zip(sights, stack.poses, stack.starts, strict=True):
        view = sight.view
        pose[:, 3] += pose[:, :3] @ origin
        square_starts.append(square_start)
        seen = sight.weight > 0
        row = np.concatenate([sight.plane, np.stack([sight.weight, sight.spread, sight.step], axis=-1)], axis=-1)
        pixels[start : start + seen.size] = np.where(seen[..., None], row, 0).reshape(-1, 7)
        rows, columns = -(-view.height // TILE), -(-view.width // TILE)
        deepest = np.zeros((rows * TILE, columns * TILE), np.float32)
        deepest[: view.height, : view.width] = np.where(seen, sight.plane[..., 3] + 3 * sight.spread, 0)
        squares.append(deepest.reshape(rows, TILE, columns, TILE).max(axis=(1, 3)).ravel())
        square_start += rows * columns
    return PackedSights(*stack, np.array(square_starts), pixels, np.concatenate(squares))


@shared
@kernel
def integrate(
    begin: int,
    end: int,
    corners: Corners,
    batches: Integers,
    truncation: Truncation,
    sights: PackedSights,
    values: Floats,
    weights: Floats,
) -> None:
    """Blend every view into the corners of some batches: values (P,) and the sums of their weights (P,), float32."""
    positions, levels = corners.positions, corners.levels
    finest, narrow = truncation.finest, truncation.narrow
    middle, center = np.empty(3), np.empty(3)
    for n in range(begin, end):
        first = batches[n] * BATCH
        last = min(first + BATCH, len(positions))
        points, steps, step = np.empty((last - first, 3)), np.empty(last - first), 0.0
        for i in range(last - first):
            steps[i] = finest * 2.0 ** levels[first + i]
            step = max(step, steps[i])
            for a in range(3):
                points[i, a] = positions[first + i, a] * finest
        square = 0.0
        for a in range(3):
            low, high = points[0, a], points[0, a]
            for i in range(1, last - first):
                low, high = min(low, points[i, a]), max(high, points[i, a])
            middle[a] = (low + high) / 2
            square += (high - low) * (high - low)
        ball = np.sqrt(square) / 2
        total, weight = values[first:last], weights[first:last]
        for v in range(len(sights.poses)):
            pose, lens, size = sights.poses[v], sights.lenses[v], sights.sizes[v]
            camera = (lens[0], lens[1], lens[2], lens[3], size[0], size[1])
            for a in range(3):
                center[a] = pose[a, 0] * middle[0] + pose[a, 1] * middle[1] + pose[a, 2] * middle[2] + pose[a, 3]
            if _unseen(center, ball, 3 * narrow * step, camera, sights.deepest, sights.square_starts[v]):
                continue
            _blend(points, steps, truncation, pose, camera, sights.starts[v], sights.pixels, total, weight)
        for i in range(last - first):
            if weight[i] > 0:
                total[i] *= steps[i] / weight[i]


@kernel
def _unseen(center: Vector, ball: float, margin: float, camera: tuple[Any, ...], deepest: Floats, start: int) -> bool:
    """Whether a ball at `center` (camera frame) lies outside a view's pyramid, or behind all that it sees there."""
    fx, fy, px, py, height, width = camera
    x, y, z = center
    if z < -ball:
        return True
    left, right, top, base = -px / fx, (width - px) / fx, -py / fy, (height - py) / fy
    if x - right * z > ball * np.sqrt(1 + right * right) or left * z - x > ball * np.sqrt(1 + left * left):
        return True
    if y - base * z > ball * np.sqrt(1 + base * base) or top * z - y > ball * np.sqrt(1 + top * top):
        return True
    nearest = z - ball
    if nearest <= ball:
        return False
    # The ball's image: its directions lie within the box x +- ball, y +- ball at the depths z +- ball.
    u0, u1 = min((x - ball) / nearest, (x - ball) / (z + ball)), max((x + ball) / nearest, (x + ball) / (z + ball))
    v0, v1 = min((y - ball) / nearest, (y - ball) / (z + ball)), max((y + ball) / nearest, (y + ball) / (z + ball))
    rows, columns = (height + TILE - 1) // TILE, (width + TILE - 1) // TILE
    first, last = int(max(fx * u0 + px, 0)) // TILE, int(min(max(fx * u1 + px, 0), width - 1)) // TILE
    for row in range(int(max(fy * v0 + py, 0)) // TILE, int(min(max(fy * v1 + py, 0), height - 1)) // TILE + 1):
        for column in range(first, min(last, columns - 1) + 1):
            if row < rows and deepest[start + row * columns + column] + margin > nearest:
                return False
    return True


@kernel
def _blend(
    points: Points,
    steps: Floats,
    truncation: Truncation,
    pose: Floats,
    camera: tuple[Any, ...],
    start: int,
    pixels: Floats,
    values: Floats,
    weights: Floats,
) -> None:
    """Add one view's truncated distances, in units of the truncation, to points (M, 3) with cells of `steps` (M,)."""
    narrow, wide, carve = truncation.narrow, truncation.wide, truncation.carve
    fx, fy, px, py, height, width = camera
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        cz = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        if cz <= 0:
            continue
        cx = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
        cy = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
        u, v = fx * cx / cz + px, fy * cy / cz + py
        if not (0 <= u < width and 0 <= v < height):
            continue
        column, row = int(u), int(v)
        at = start + row * width + column
        surface, trusted = pixels[at, 3], pixels[at, 4]
        if not (surface > 0 and trusted > 0):
            continue
        limit = min(max(pixels[at, 5], narrow * steps[i]), wide * max(pixels[at, 6], steps[i]))
        ahead = surface - cz
        if ahead < -3 * limit or ahead > carve:
            continue
        distance = limit
        if ahead <= 3 * limit:
            # The pixel's surface point, and the point's distance to the tangent plane there.
            dx = cx - (column + 0.5 - px) / fx * surface
            dy = cy - (row + 0.5 - py) / fy * surface
            distance = 0.0
            for a in range(3):
                distance += (pose[0, a] * dx + pose[1, a] * dy - pose[2, a] * ahead) * pixels[at, a]
        if distance < -limit:
            continue
        values[i] += trusted * min(distance / limit, 1.0)
        weights[i] += trusted
