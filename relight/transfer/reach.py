"""Which rays can meet a body at all: those below the horizon or past its box are never traced.

A body is wrapped into one box, and only rays through it are passed on. All of it errs to the safe side. Several boxes
per body cost more than they save.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Mask, Points, Vector
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices

from .occluder import BATCH_RAYS
from .sampling import direction, tangents, turned

MARGIN = np.float32(100.0) * np.finfo(np.float32).eps
"""A box is larger by this, in the unit frame: a hundred roundings."""


class Box(NamedTuple):
    """low, high: (3,) float32, the corners. center: (3,) float32. radius: float32, of the sphere around it."""

    low: NDArray[np.float32]
    high: NDArray[np.float32]
    center: NDArray[np.float32]
    radius: np.float32

    @classmethod
    def around(cls, points: NDArray[np.float32]) -> "Box":
        """That of points (P, 3) float32, unit frame."""
        low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
        radius = np.float32(np.linalg.norm(high - low)) * np.float32(0.5001) + MARGIN
        return cls(low, high, (low + high) / np.float32(2), radius)


class NodeRays(NamedTuple):
    """The rays of N nodes, made one by one where they are wanted.

    origins, normals: (N, 3) float32, unit frame and unit. azimuths: (R, 2) float32 and offsets: (N, 2) float32, as
    `sampling.shoot_at` takes them. directions: (S, 3) float32; with any, the rays of every node go towards these where
    they are above its horizon, and no others. Bits about rays are (N, bytes) uint8 as of `numpy.packbits`.
    """

    origins: NDArray[np.float32]
    normals: NDArray[np.float32]
    azimuths: NDArray[np.float32]
    offsets: NDArray[np.float32]
    directions: NDArray[np.float32]

    @classmethod
    def over_hemispheres(cls, origins: Points, normals: Directions, azimuths: Floats, offsets: Floats) -> "NodeRays":
        """Cosine-distributed rays about the normals."""
        return cls(origins, normals, azimuths, offsets, np.zeros((0, 3), np.float32))

    @classmethod
    def towards(cls, origins: Points, normals: Directions, directions: Directions) -> "NodeRays":
        """Rays towards the same directions."""
        none = np.zeros((0, 2), np.float32)
        return cls(origins, normals, none, none, directions)

    @property
    def each(self) -> int:
        """Rays of a node."""
        return len(self.directions) or len(self.azimuths)


def blocked(
    rays: NodeRays,
    box: Box,  # of the body
    occluded: Callable[[NDArray[np.float32]], Mask],  # of the body: rays (n, 6) float32 -> (n,) bool
    hidden: NDArray[np.uint8],  # (N, bytes) uint8: rays that need no test
) -> NDArray[np.uint8]:
    """Which rays the body stops: bits (N, bytes) uint8; rays that are hidden anyway stay 0."""
    bits, each = np.zeros_like(hidden), rays.each
    batch = max(1, BATCH_RAYS // max(1, each))
    for start in range(0, len(bits), batch):
        count = min(batch, len(bits) - start)
        buffer, index = np.zeros((count * each, 6), np.float32), np.zeros(count * each, np.int32)
        used = np.zeros(count, np.int64)  # at the first row of each slice; its rays begin at that row's place
        in_slices(_through, count, start, rays, box, hidden, buffer, index, used)
        for first in np.flatnonzero(used):
            those = slice(first * each, first * each + used[first])
            _mark(index[those], occluded(buffer[those]), each, bits[start:])
    return bits


@kernel
def _mark(index: NDArray[np.int32], stopped: Mask, rays: int, bits: NDArray[np.uint8]) -> None:
    for j in range(len(index)):
        if stopped[j]:
            row, i = index[j] // rays, index[j] % rays
            bits[row, i >> 3] |= np.uint8(128) >> np.uint8(i & 7)


@kernel
def _near(
    px: np.float32, py: np.float32, pz: np.float32, dx: Vector, dy: Vector, dz: Vector, box: Box, near: Mask
) -> None:
    """Whether rays from a point meet the box, into `near`."""
    low, high = box.low, box.high
    zero, one, tiny = np.float32(0), np.float32(1), np.float32(1e-30)
    lx, ly, lz, hx, hy, hz = low[0] - px, low[1] - py, low[2] - pz, high[0] - px, high[1] - py, high[2] - pz
    for i in range(len(near)):  # whole vectors at a time: nothing here branches
        ix = one / (dx[i] if dx[i] != zero else tiny)
        iy = one / (dy[i] if dy[i] != zero else tiny)
        iz = one / (dz[i] if dz[i] != zero else tiny)
        ax, bx, ay, by, az, bz = lx * ix, hx * ix, ly * iy, hy * iy, lz * iz, hz * iz
        begin = max(max(min(ax, bx), min(ay, by)), min(az, bz))
        end = min(min(max(ax, bx), max(ay, by)), max(az, bz))
        near[i] = (end >= zero) & (begin <= end)


@kernel
def _through(
    begin: int,
    end: int,
    start: int,
    rays: NodeRays,
    box: Box,
    hidden: NDArray[np.uint8],
    buffer: NDArray[np.float32],
    index: NDArray[np.int32],
    used: NDArray[np.int64],
) -> None:
    """Rays of the nodes from `start` + `begin` to `start` + `end` that are not hidden and go through the box, into
    `buffer` from `begin` times the rays of a node on.

    index: (node - start) * rays + ray, for each. used[begin]: how many there are.
    """
    aimed = len(rays.directions) > 0
    count = len(rays.directions) if aimed else len(rays.azimuths)
    at, sun = begin * count, rays.directions
    dx, dy, dz = np.zeros(count, np.float32), np.zeros(count, np.float32), np.zeros(count, np.float32)
    near = np.zeros(count, np.bool_)
    for row in range(begin, end):
        v = start + row
        nx, ny, nz = rays.normals[v]
        px, py, pz = rays.origins[v]
        wx, wy, wz = box.center[0] - px, box.center[1] - py, box.center[2] - pz
        square = wx * wx + wy * wy + wz * wz
        if square > box.radius * box.radius and wx * nx + wy * ny + wz * nz < -box.radius:
            continue
        if aimed:
            for i in range(count):
                dx[i], dy[i], dz[i] = sun[i, 0], sun[i, 1], sun[i, 2]
        else:
            frame, shift, turn = tangents(nx, ny, nz), rays.offsets[v, 0], turned(rays.offsets[v, 1])
            for i in range(count):
                dx[i], dy[i], dz[i] = direction(i, shift, turn, frame, rays.azimuths)
        _near(px, py, pz, dx, dy, dz, box, near)
        for i in range(count):
            if not near[i] or hidden[v, i >> 3] & (np.uint8(128) >> np.uint8(i & 7)):
                continue
            if aimed and nx * dx[i] + ny * dy[i] + nz * dz[i] <= np.float32(0):
                continue
            buffer[at, 0], buffer[at, 1], buffer[at, 2] = px, py, pz
            buffer[at, 3], buffer[at, 4], buffer[at, 5] = dx[i], dy[i], dz[i]
            index[at] = row * count + i
            at += 1
    used[begin] = at - begin * count
