"""Which rays can meet a body at all: those below the horizon, outside its cone, or past its boxes are never traced.

A body is wrapped into one box. From a vertex, the sphere around the box fills a cone; the rays of a vertex are ranked
by their height above the horizon (`sampling.fibonacci_azimuths`), so the cone leaves one run of ranks, and of
these only rays through the box are passed on. All of it errs to the safe side. For an arm over a table this takes
5 ns a ray of all, of which a tenth reaches Embree, at 100 ns; several boxes per body cost more than they save.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Mask
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices

from .occluder import BATCH_RAYS
from .sampling import direction, tangents, turned

MARGIN = np.float32(1e-5)
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


class Hemisphere:
    """The cosine-distributed rays of some nodes, as `sampling.shoot_at` makes them, one by one where they are wanted.

    count: number of nodes. rays: per node. Bits about them are (N, ceil(rays / 8)) uint8 as of `numpy.packbits`.
    """

    def __init__(
        self,
        origins: NDArray[np.float32],
        normals: NDArray[np.float32],
        azimuths: NDArray[np.float32],
        offsets: NDArray[np.float32],
    ) -> None:
        self.through, self.arrays = _hemisphere_through, (origins, normals, azimuths, offsets)
        self.count, self.rays = len(origins), len(azimuths)


class Beams:
    """Rays of every node towards the same directions, where these are above its horizon. See Hemisphere."""

    def __init__(
        self, origins: NDArray[np.float32], normals: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> None:
        self.through, self.arrays = _beams_through, (origins, normals, directions)
        self.count, self.rays = len(origins), len(directions)


def blocked(
    rays: Hemisphere | Beams,
    rows: Indices,  # (M,) integers, which of its nodes
    box: Box,  # Box of the body
    occluded: Callable[[NDArray[np.float32]], Mask],  # of the body: rays (n, 6) float32 -> (n,) bool
    hidden: NDArray[np.uint8],  # (N, bytes) uint8 of all nodes: rays that need no test
) -> NDArray[np.uint8]:
    """Which rays the body stops: bits (M, bytes) uint8; rays that are hidden anyway stay 0."""
    bits = np.zeros((len(rows), -(-rays.rays // 8)), np.uint8)
    batch = max(1, BATCH_RAYS // max(1, rays.rays))
    for start in range(0, len(rows), batch):
        part = rows[start : start + batch]
        buffer, index = np.zeros((len(part) * rays.rays, 6), np.float32), np.zeros(len(part) * rays.rays, np.int32)
        used = np.zeros(len(part), np.int64)  # at the first row of each slice; its rays begin at that row's place
        in_slices(rays.through, len(part), part, *rays.arrays, *box, hidden, buffer, index, used)
        for first in np.flatnonzero(used):
            those = slice(first * rays.rays, first * rays.rays + used[first])
            _mark(index[those], occluded(buffer[those]), rays.rays, bits[start : start + batch])
    return bits


@kernel
def _mark(index: NDArray[np.int32], stopped: Mask, rays: int, bits: NDArray[np.uint8]) -> None:
    for j in range(len(index)):
        if stopped[j]:
            row, i = index[j] // rays, index[j] % rays
            bits[row, i >> 3] |= np.uint8(128) >> np.uint8(i & 7)


@kernel
def _near(
    px: np.float32,
    py: np.float32,
    pz: np.float32,
    dx: NDArray[np.float32],
    dy: NDArray[np.float32],
    dz: NDArray[np.float32],
    low: NDArray[np.float32],
    high: NDArray[np.float32],
    near: Mask,
) -> None:
    """Whether rays from a point meet one box, into `near`."""
    zero, one, tiny = np.float32(0), np.float32(1), np.float32(1e-30)
    lx, ly, lz, hx, hy, hz = low[0] - px, low[1] - py, low[2] - pz, high[0] - px, high[1] - py, high[2] - pz
    for i in range(len(near)):
        ix = one / (dx[i] if dx[i] != zero else tiny)
        iy = one / (dy[i] if dy[i] != zero else tiny)
        iz = one / (dz[i] if dz[i] != zero else tiny)
        ax, bx, ay, by, az, bz = lx * ix, hx * ix, ly * iy, hy * iy, lz * iz, hz * iz
        begin = max(max(min(ax, bx), min(ay, by)), min(az, bz))
        end = min(min(max(ax, bx), max(ay, by)), max(az, bz))
        near[i] = (end >= zero) & (begin <= end)


@kernel
def _hemisphere_through(
    begin: int,
    end: int,
    rows: Indices,
    origins: NDArray[np.float32],
    normals: NDArray[np.float32],
    azimuths: NDArray[np.float32],
    offsets: NDArray[np.float32],
    low: NDArray[np.float32],
    high: NDArray[np.float32],
    center: NDArray[np.float32],
    radius: np.float32,
    hidden: NDArray[np.uint8],
    buffer: NDArray[np.float32],
    index: NDArray[np.int32],
    used: NDArray[np.int64],
) -> None:
    """Rays of rows[begin:end] that are not hidden and go through the box, into `buffer` from `begin` * rays on.

    index: row * rays + ray, for each. used[begin]: how many there are.
    """
    count, at = len(azimuths), begin * len(azimuths)
    one = np.float32(1)
    dx, dy, dz = np.zeros(count, np.float32), np.zeros(count, np.float32), np.zeros(count, np.float32)
    near = np.zeros(count, np.bool_)
    for row in range(begin, end):
        v = rows[row]
        nx, ny, nz = normals[v]
        px, py, pz = origins[v]
        shift = offsets[v, 0]
        wx, wy, wz = center[0] - px, center[1] - py, center[2] - pz
        square, along = wx * wx + wy * wy + wz * wz, wx * nx + wy * ny + wz * nz
        first, last = 0, count
        if square > radius * radius:
            if along < -radius:
                continue
            # cos (a - b) and cos (a + b), a between normal and centre, b half the cone's opening.
            distance = np.sqrt(square)
            cosine, half_sine = min(max(along / distance, -one), one), radius / distance
            product = np.sqrt(max(one - cosine * cosine, np.float32(0))) * half_sine
            half_cosine = np.sqrt(max(one - half_sine * half_sine, np.float32(0)))
            high_cosine, low_cosine = cosine * half_cosine + product, cosine * half_cosine - product
            if cosine < half_cosine:  # the normal is outside the cone
                if high_cosine <= np.float32(-1e-3):
                    continue
                high_cosine = max(high_cosine, np.float32(0)) + np.float32(1e-3)
                first = max(0, int(count * (one - high_cosine * high_cosine) - shift) - 1)
            if low_cosine > np.float32(1e-3):
                low_cosine -= np.float32(1e-3)
                last = min(count, int(count * (one - low_cosine * low_cosine) - shift) + 2)
        frame, turn = tangents(nx, ny, nz), turned(offsets[v, 1])
        for i in range(first, last):  # whole vectors at a time: nothing here branches
            dx[i], dy[i], dz[i] = direction(i, shift, turn, frame, azimuths)
        _near(px, py, pz, dx[first:last], dy[first:last], dz[first:last], low, high, near[first:last])
        for i in range(first, last):
            if near[i] and not hidden[v, i >> 3] & (np.uint8(128) >> np.uint8(i & 7)):
                buffer[at, 0], buffer[at, 1], buffer[at, 2] = px, py, pz
                buffer[at, 3], buffer[at, 4], buffer[at, 5] = dx[i], dy[i], dz[i]
                index[at] = row * count + i
                at += 1
    used[begin] = at - begin * count


@kernel
def _beams_through(
    begin: int,
    end: int,
    rows: Indices,
    origins: NDArray[np.float32],
    normals: NDArray[np.float32],
    directions: NDArray[np.float32],
    low: NDArray[np.float32],
    high: NDArray[np.float32],
    center: NDArray[np.float32],
    radius: np.float32,
    hidden: NDArray[np.uint8],
    buffer: NDArray[np.float32],
    index: NDArray[np.int32],
    used: NDArray[np.int64],
) -> None:
    """Like `_hemisphere_through`, towards given directions above the horizon."""
    count, at = len(directions), begin * len(directions)
    dx, dy, dz = directions[:, 0].copy(), directions[:, 1].copy(), directions[:, 2].copy()
    near = np.zeros(count, np.bool_)
    for row in range(begin, end):
        v = rows[row]
        nx, ny, nz = normals[v]
        px, py, pz = origins[v]
        wx, wy, wz = center[0] - px, center[1] - py, center[2] - pz
        square = wx * wx + wy * wy + wz * wz
        if square > radius * radius and wx * nx + wy * ny + wz * nz < -radius:
            continue
        _near(px, py, pz, dx, dy, dz, low, high, near)
        for i in range(count):
            above = nx * dx[i] + ny * dy[i] + nz * dz[i] > np.float32(0)
            if near[i] and above and not hidden[v, i >> 3] & (np.uint8(128) >> np.uint8(i & 7)):
                buffer[at, 0], buffer[at, 1], buffer[at, 2] = px, py, pz
                buffer[at, 3], buffer[at, 4], buffer[at, 5] = dx[i], dy[i], dz[i]
                index[at] = row * count + i
                at += 1
    used[begin] = at - begin * count
