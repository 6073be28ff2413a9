"""The splats that a view sees, nearest first, and the footprint of each in the image.

Splats are culled, sorted once by depth, then projected and assigned to tiles of the image, a batch at a time. The
projection is that of 3D Gaussian splatting (Zwicker et al., EWA Splatting, 2002; Kerbl et al., 3D Gaussian Splatting
for Real-Time Radiance Field Rendering, 2023).
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Indices, Integers, Mask, Matrix3, Points, Quaternions, Vector
from ..base.errors import InputError
from ..base.kernels import kernel
from ..base.threads import cores, read_only, shared
from ..splats.splats import INVISIBLE_OPACITY, Splats
from .view import View
from .viewdirection import harmonics_of_direction

NEAR = 0.01  # default near plane: splat centres closer than this camera z are not drawn
DILATION = 0.3  # px^2 added to both image variances: the pixel's own footprint (Kerbl et al., their low-pass)
GUARD_BAND = 0.3  # the Jacobian is held constant beyond this share of tan(fov / 2) outside the image
MIN_ALPHA = np.float32(INVISIBLE_OPACITY)  # less than one 8-bit step: not drawn
MAX_ALPHA = np.float32(0.99)  # one splat never hides everything behind it
ONE = np.float32(1)

TILE = 16  # pixels along a tile's side
BATCH = 32768  # splats projected and binned at a time: bounds the memory, and hidden batches are never binned
COUNT_ONLY = np.zeros(0, np.int32)  # in place of entries: footprints are counted, not listed

EVERYWHERE = np.zeros(0, np.float32)  # in place of the depths of tiles: none has an end

# One splat in the image: exp(-q/2), q = precision_y dy^2 + precision_x (dx - slope dy)^2. Unlike the usual
# inverse covariance this gives each pixel row its interval, and no digit is lost to cancellation.
FOOTPRINT = np.dtype(
    [(name, np.float64) for name in "x y slope precision_x precision_y cutoff reach_y tip_y".split()]
    + [(name, np.float32) for name in "opacity red green blue depth".split()],
    align=True,
)

Footprint: TypeAlias = Any
"""A record of FOOTPRINT, whose fields kernels read as attributes."""


class Camera(NamedTuple):
    """A View as the kernels read it; `guard` is the x/z and y/z range (x0, x1, y0, y1) of the Jacobian."""

    rotation: Matrix3
    translation: Vector
    center: Vector
    guard: NDArray[np.float64]
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    near: float


class Gaussians(NamedTuple):
    """Splats as the kernels read them, read-only float32: the fields of Splats."""

    means: Points
    scales: Floats
    quats: Quaternions
    opacities: Floats
    sh: Floats


class Batch(NamedTuple):
    """Splats of a view that follow one another in depth.

    order: (M,) int64 indices of the splats, nearest first. footprints: (M,) FOOTPRINT, where they fall.
    starts, entries: tile t is touched by the footprints entries[starts[t] : starts[t + 1]], nearest first.
    """

    order: Indices
    footprints: NDArray[np.void]
    starts: Indices
    entries: NDArray[np.int32]


def footprint_batches(
    splats: Splats, camera: Camera, open_tiles: Mask, deepest: Floats = EVERYWHERE
) -> Iterator[Batch]:
    """Yield the visible splats of a view as Batch after Batch, nearest first, until no tile is open any more.

    splats: Splats (means, scales, quats_wxyz, opacities, sh of 3DGS signs), N >= 0; rows whose geometry is not
        finite are left out. camera: Camera. open_tiles: (tiles,) bool, row after row; the caller that blends a batch
        clears the ones that let no more light through, and they get no more splats. deepest: (tiles,) float32 camera z
        behind which a tile needs no splats, or EVERYWHERE; splats that no tile needs are left out.
    """
    fields = splats.means, splats.scales, splats.quats_wxyz, splats.opacities, splats.sh
    gaussians = Gaussians(*(read_only(field) for field in fields))
    tiles = len(open_tiles)
    depth = np.empty(len(splats), np.float32)
    _cull(len(splats), gaussians, camera, deepest, depth)
    order = _front_to_back(depth)
    chunks = cores()  # pieces of a batch that threads bin independently
    for start in range(0, len(order), BATCH):
        batch = order[start : start + BATCH]
        near = Gaussians(*(read_only(field.take(batch, axis=0)) for field in gaussians))
        footprints = np.zeros(len(batch), FOOTPRINT)
        counts = np.zeros((chunks, tiles), np.int64)
        _project(chunks, near, camera, open_tiles, footprints, counts, np.zeros((chunks, 16)), COUNT_ONLY)
        # Tile after tile, and within a tile chunk after chunk: so each tile's list keeps the depth order.
        ends = counts.T.ravel().cumsum()
        cursors = np.ascontiguousarray((ends - counts.T.ravel()).reshape(tiles, chunks).T)
        starts = np.append(cursors[0], ends[-1])
        entries = np.empty(ends[-1], np.int32)
        _fill(chunks, footprints, camera, open_tiles, cursors, entries)
        yield Batch(batch, footprints, starts, entries)
        if not open_tiles.any():
            return


def camera_of(view: View, near: float = NEAR) -> Camera:
    """The View as a Camera: every field a float64 array, float or int, so that the kernels compile once. Raises
    InputError when `near` is not positive."""
    if not near > 0:
        raise InputError(f"the near plane must lie in front of the camera: expected near > 0, found {near}")
    matrix = np.array(view.camera_from_world, np.float64)
    x0, x1 = -view.cx / view.fx, (view.width - view.cx) / view.fx
    y0, y1 = -view.cy / view.fy, (view.height - view.cy) / view.fy
    band_x, band_y = GUARD_BAND * (x1 - x0) / 2, GUARD_BAND * (y1 - y0) / 2
    return Camera(
        rotation=np.ascontiguousarray(matrix[:3, :3]),
        translation=np.ascontiguousarray(matrix[:3, 3]),
        center=np.ascontiguousarray(view.center, np.float64),
        guard=np.array([x0 - band_x, x1 + band_x, y0 - band_y, y1 + band_y]),
        **{name: float(getattr(view, name)) for name in ("fx", "fy", "cx", "cy")},
        width=int(view.width),
        height=int(view.height),
        near=float(near),
    )


def _front_to_back(depth: Floats) -> Indices:
    """Indices of the finite depths, nearest first, ties by index: (N,) float32 > 0 or inf -> (M,) int64."""
    index = np.flatnonzero(np.isfinite(depth))
    # The bits of positive floats sort like the floats; with the index below them one fast sort has no ties.
    keys = depth[index].view(np.uint32).astype(np.uint64) << np.uint64(32)
    keys |= index.astype(np.uint64)
    keys.sort()
    return (keys & np.uint64(0xFFFFFFFF)).view(np.int64)


@shared
@kernel
def _cull(begin: int, end: int, gaussians: Gaussians, camera: Camera, deepest: Floats, depth: Floats) -> None:
    """Camera z of the splats that may touch a tile that needs them, infinity for the others. A splat's image variance
    along x is at most (fx scale_max / z)^2 (1 + (x/z)^2) plus the dilation."""
    widest = 2 * math.log(1 / MIN_ALPHA)
    scales = gaussians.scales
    for i in range(begin, end):
        depth[i] = np.inf
        x, y, z = camera_point(camera, gaussians.means, i)
        if not (z > camera.near and gaussians.opacities[i] >= MIN_ALPHA):
            continue
        u, v = x / z, y / z
        column, row = camera.fx * u + camera.cx, camera.fy * v + camera.cy
        outside_x = max(-column, column - camera.width, 0.0)
        outside_y = max(-row, row - camera.height, 0.0)
        u, v = _guarded(camera, u, v)
        spread = max(scales[i, 0], scales[i, 1], scales[i, 2]) / z
        square_x = widest * ((camera.fx * spread) ** 2 * (1 + u * u) + DILATION)
        square_y = widest * ((camera.fy * spread) ** 2 * (1 + v * v) + DILATION)
        if outside_x * outside_x <= square_x and outside_y * outside_y <= square_y:
            reach = math.sqrt(square_x), math.sqrt(square_y)
            depth[i] = z if len(deepest) == 0 or _needed(camera, deepest, z, (column, row), reach) else np.inf


@kernel
def _needed(camera: Camera, deepest: Floats, z: float, center: tuple[float, float], reach: tuple[float, float]) -> bool:
    """Whether a tile that a box touches, its centre and half its sides in pixels, needs splats at a depth."""
    (column, row), (reach_x, reach_y) = center, reach
    left, right = int(max(column - reach_x, 0)) // TILE, int(min(column + reach_x, camera.width - 1)) // TILE
    top, bottom = int(max(row - reach_y, 0)) // TILE, int(min(row + reach_y, camera.height - 1)) // TILE
    across = (camera.width + TILE - 1) // TILE
    for tile_row in range(top, bottom + 1):
        for tile in range(tile_row * across + left, tile_row * across + right + 1):
            if z <= deepest[tile]:
                return True
    return False


@shared
@kernel
def _project(
    begin: int,
    end: int,
    gaussians: Gaussians,
    camera: Camera,
    open_tiles: Mask,
    footprints: NDArray[np.void],
    counts: Integers,
    basis: Floats,
    entries: Integers,
) -> None:
    """Footprints of splats, and how many of each chunk touch each open tile: (chunks, tiles). basis: (chunks, 16), room
    for harmonics. entries: none, as nothing is listed yet."""
    chunks, n = counts.shape[0], len(footprints)
    for chunk in range(begin, end):
        for i in range(chunk * n // chunks, (chunk + 1) * n // chunks):
            s = footprints[i]
            _project_one(camera, gaussians, i, s)
            if _bin_one(s, i, camera, open_tiles, counts[chunk], entries):
                _color_one(camera, gaussians, i, basis[chunk], s)


@shared
@kernel
def _fill(
    begin: int,
    end: int,
    footprints: NDArray[np.void],
    camera: Camera,
    open_tiles: Mask,
    cursors: Integers,
    entries: Integers,
) -> None:
    """Write each footprint's index into the lists of its open tiles. cursors: (chunks, tiles), consumed."""
    chunks, n = cursors.shape[0], len(footprints)
    for chunk in range(begin, end):
        for i in range(chunk * n // chunks, (chunk + 1) * n // chunks):
            _bin_one(footprints[i], i, camera, open_tiles, cursors[chunk], entries)


@kernel
def camera_point(camera: Camera, means: Points, i: int) -> tuple[float, float, float]:
    """The centre of splat i in the camera's frame."""
    rotation, t = camera.rotation, camera.translation
    px, py, pz = np.float64(means[i, 0]), np.float64(means[i, 1]), np.float64(means[i, 2])
    return (
        rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + t[0],
        rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + t[1],
        rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz + t[2],
    )


@kernel
def axes_of(quats: Quaternions, k: int) -> tuple[tuple[float, float, float], ...]:
    """The three axes of splat k in the world."""
    w, x, y, z = np.float64(quats[k, 0]), np.float64(quats[k, 1]), np.float64(quats[k, 2]), np.float64(quats[k, 3])
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )


@kernel
def _guarded(camera: Camera, u: float, v: float) -> tuple[float, float]:
    guard = camera.guard
    return min(max(u, guard[0]), guard[1]), min(max(v, guard[2]), guard[3])


@kernel
def _project_one(camera: Camera, gaussians: Gaussians, k: int, out: Footprint) -> None:
    """Write splat k's footprint, all but its colour; with reach_y = -1 (no tiles) when it is not finite."""
    means, scales, quats, opacities = gaussians.means, gaussians.scales, gaussians.quats, gaussians.opacities
    out.reach_y = -1.0
    x, y, z = camera_point(camera, means, k)
    u, v = _guarded(camera, x / z, y / z)
    axes = axes_of(quats, k)
    # Image covariance: the sum over the three axes of (J W axis)(J W axis)^T, J the projection's Jacobian.
    x0, y0 = _image_axis(camera, axes[0], scales[k, 0] / z, u, v)
    x1, y1 = _image_axis(camera, axes[1], scales[k, 1] / z, u, v)
    x2, y2 = _image_axis(camera, axes[2], scales[k, 2] / z, u, v)
    xx = x0 * x0 + x1 * x1 + x2 * x2 + DILATION
    xy = x0 * y0 + x1 * y1 + x2 * y2
    yy = y0 * y0 + y1 * y1 + y2 * y2 + DILATION
    if not math.isfinite(xx + xy + yy):
        return
    cutoff = 2 * math.log(opacities[k] / MIN_ALPHA)
    out.x, out.y = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    out.slope = xy / yy
    # The determinant xx yy - xy^2 as a sum of squares (Cauchy-Binet): nothing cancels in the longest needle.
    areas = (x0 * y1 - x1 * y0) ** 2 + (x0 * y2 - x2 * y0) ** 2 + (x1 * y2 - x2 * y1) ** 2
    out.precision_x = yy / (areas + DILATION * (xx + yy - DILATION))
    out.precision_y = 1 / yy
    out.cutoff, out.reach_y, out.tip_y = cutoff, math.sqrt(cutoff * yy), xy * math.sqrt(cutoff / xx)
    out.opacity, out.depth = opacities[k], z


@kernel
def _image_axis(
    camera: Camera, axis: tuple[float, float, float], spread: float, u: float, v: float
) -> tuple[float, float]:
    """A splat's axis in the image, in pixels: spread is its scale over camera z, (u, v) where J is taken."""
    r, (x, y, z) = camera.rotation, axis
    depthwise = r[2, 0] * x + r[2, 1] * y + r[2, 2] * z
    across = r[0, 0] * x + r[0, 1] * y + r[0, 2] * z - u * depthwise
    down = r[1, 0] * x + r[1, 1] * y + r[1, 2] * z - v * depthwise
    return camera.fx * spread * across, camera.fy * spread * down


@kernel
def _half_chord(s: Footprint, dy: float) -> float:
    """Half the length of the footprint's pixel row at dy: where opacity exp(-q/2) >= 1/255."""
    return math.sqrt(max(s.cutoff - s.precision_y * dy * dy, 0.0) / s.precision_x)


@kernel
def pixel_range(low: float, high: float, start: int, stop: int) -> tuple[int, int]:
    """Range (first, last + 1) of pixels in [start, stop) with centres in [low, high]; clamped as floats."""
    return int(min(max(np.ceil(low - 0.5), start), stop)), int(max(min(np.floor(high + 0.5), stop), start))


@kernel
def _bin_one(s: Footprint, i: int, camera: Camera, open_tiles: Mask, cursors: Integers, entries: Integers) -> bool:
    """Advance the cursor of each open tile that footprint i touches; where there are entries, note i there. A tile is
    touched when the ellipse reaches its range of pixel centres: exact for each row of tiles. Returns whether any tile
    was."""
    tiles_x = (camera.width + TILE - 1) // TILE
    first_row, last_row = pixel_range(s.y - s.reach_y, s.y + s.reach_y, 0, camera.height)
    touched = False
    if first_row >= last_row:
        return touched
    for tile_row in range(first_row // TILE, (last_row - 1) // TILE + 1):
        top = max(tile_row * TILE, first_row) + 0.5 - s.y
        bottom = min(tile_row * TILE + TILE, last_row) - 0.5 - s.y
        # The ellipse ends on the right at +tip_y and on the left at -tip_y, or at the band's nearer edge.
        right_dy = min(max(s.tip_y, top), bottom)
        left_dy = min(max(-s.tip_y, top), bottom)
        left = s.x + s.slope * left_dy - _half_chord(s, left_dy)
        right = s.x + s.slope * right_dy + _half_chord(s, right_dy)
        first, last = pixel_range(left, right, 0, camera.width)
        if first >= last:
            continue
        for tile in range(tile_row * tiles_x + first // TILE, tile_row * tiles_x + (last - 1) // TILE + 1):
            if open_tiles[tile]:
                if len(entries):
                    entries[cursors[tile]] = i
                cursors[tile] += 1
                touched = True
    return touched


@kernel
def _color_one(camera: Camera, gaussians: Gaussians, k: int, basis: Floats, out: Footprint) -> None:
    """Write the sRGB colour towards the camera: max(0, 1/2 + sum of harmonics in the viewing direction)."""
    center, means, sh = camera.center, gaussians.means, gaussians.sh
    x, y, z = means[k, 0] - center[0], means[k, 1] - center[1], means[k, 2] - center[2]
    length = math.sqrt(x * x + y * y + z * z)
    harmonics_of_direction(x / length, y / length, z / length, sh.shape[1], basis)
    red = green = blue = 0.5
    for b in range(sh.shape[1]):
        red += basis[b] * sh[k, b, 0]
        green += basis[b] * sh[k, b, 1]
        blue += basis[b] * sh[k, b, 2]
    if math.isfinite(red + green + blue):
        out.red, out.green, out.blue = max(red, 0.0), max(green, 0.0), max(blue, 0.0)
