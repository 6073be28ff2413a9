"""Which rays can meet a body at all: what lies behind the horizon, beside its cone, or past its boxes is never traced.

A body is wrapped into boxes, a few runs of neighbouring faces each. From a vertex, the sphere around the boxes fills
a cone; the rays of a vertex are ranked by their height above the horizon (`sampling.fibonacci_azimuths`), so that the
cone leaves one run of ranks, and of these only rays through a box are handed on. All of it errs to the safe side.
"""

import numpy as np
from numba import njit

from .sampling import in_slices

BOXES = 16
"""Per body. For an arm over a table 1 box leaves 2.1 times the rays, 4 leave 1.4, 64 leave 0.8 for more time to test."""

MARGIN = np.float32(1e-5)
"""Boxes are larger by this, in the unit frame: a hundred roundings."""

BATCH_RAYS = 2**20
"""Rays in memory at once, at most: 28 MiB."""


class Boxes:
    """The boxes around a mesh; they follow it when it moves.

    low, high: (B, 3) float32 corners. center, radius: (3,) float32 and float32, the sphere around all of them.
    """

    def __init__(
        self,
        vertices,  # (V, 3) float32, unit frame
        faces,  # (F, 3) integers
    ):
        middle = vertices[faces].mean(axis=1)
        self._runs = [faces[run] for run in _split(middle, np.arange(len(faces)), BOXES)]
        self._corners = np.concatenate([np.unique(run) for run in self._runs])
        sizes = [len(np.unique(run)) for run in self._runs]
        self._starts = np.append(0, np.cumsum(sizes))[:-1]
        del self._runs
        self.move(vertices)

    def move(self, vertices):
        """Refit to new places of the same vertices."""
        corners = vertices[self._corners]
        self.low = np.minimum.reduceat(corners, self._starts) - MARGIN
        self.high = np.maximum.reduceat(corners, self._starts) + MARGIN
        low, high = self.low.min(axis=0), self.high.max(axis=0)
        self.center = (low + high) / np.float32(2)
        self.radius = np.float32(np.linalg.norm(high - low)) * np.float32(0.5001) + MARGIN


def _split(middle, faces, count):
    """Faces as `count` runs, halved at the median of the longest side."""
    if count == 1 or len(faces) < 2:
        return [faces]
    axis = np.ptp(middle[faces], axis=0).argmax()
    half = len(faces) // 2
    order = faces[np.argpartition(middle[faces, axis], half)]
    return _split(middle, order[:half], count // 2) + _split(middle, order[half:], count // 2)


class Hemisphere:
    """The cosine-distributed rays of some nodes, as `sampling.shoot_at` makes them, one by one where they are wanted.

    count: number of nodes. rays: per node. Bits about them are (N, ceil(rays / 8)) uint8 as of `numpy.packbits`.
    """

    def __init__(self, origins, normals, azimuths, offsets):
        self.arrays = origins, normals, azimuths, offsets
        self.count, self.rays = len(origins), len(azimuths)

    def through(self, begin, end, rows, boxes, hidden, buffer, index, used):
        """See `_hemisphere_through`."""
        _hemisphere_through(begin, end, rows, *self.arrays, *boxes, hidden, buffer, index, used)


class Beams:
    """Rays of every node towards the same directions, where these are above its horizon. See Hemisphere."""

    def __init__(self, origins, normals, directions):
        self._arrays = origins, normals, directions
        self.count, self.rays = len(origins), len(directions)

    def through(self, begin, end, rows, boxes, hidden, buffer, index, used):
        """See `_beams_through`."""
        _beams_through(begin, end, rows, *self._arrays, *boxes, hidden, buffer, index, used)


def blocked(
    rays,  # Hemisphere or Beams
    rows,  # (M,) integers, which of its nodes
    boxes,  # Boxes of the body
    occluded,  # of the body: rays (n, 6) float32 -> (n,) bool
    hidden,  # (N, bytes) uint8 of all nodes: rays that need no test
):
    """Which rays the body stops: bits (M, bytes) uint8; rays that are hidden anyway stay 0."""
    bits = np.zeros((len(rows), -(-rays.rays // 8)), np.uint8)
    wrapped = boxes.low, boxes.high, boxes.center, boxes.radius
    batch = max(1, BATCH_RAYS // max(1, rays.rays))
    for start in range(0, len(rows), batch):
        part = rows[start : start + batch]
        buffer, index = np.zeros((len(part) * rays.rays, 6), np.float32), np.zeros(len(part) * rays.rays, np.int32)
        used = np.zeros(len(part), np.int64)  # at the first row of each slice; its rays begin at that row's place
        in_slices(rays.through, len(part), part, wrapped, hidden, buffer, index, used)
        for first in np.flatnonzero(used):
            those = slice(first * rays.rays, first * rays.rays + used[first])
            _mark(index[those], occluded(buffer[those]), rays.rays, bits[start : start + batch])
    return bits


@njit(cache=True, nogil=True)
def _mark(index, stopped, rays, bits):
    for j in range(len(index)):
        if stopped[j]:
            row, i = index[j] // rays, index[j] % rays
            bits[row, i >> 3] |= np.uint8(128) >> np.uint8(i & 7)


@njit(cache=True, nogil=True, inline="always")
def _meets(px, py, pz, dx, dy, dz, low, high):
    """Whether a ray goes through any of the boxes."""
    tiny = np.float32(1e-30)  # in place of 0: the quotients stay finite
    ix = np.float32(1) / (dx if dx != 0 else tiny)
    iy = np.float32(1) / (dy if dy != 0 else tiny)
    iz = np.float32(1) / (dz if dz != 0 else tiny)
    for b in range(len(low)):
        ax, bx = (low[b, 0] - px) * ix, (high[b, 0] - px) * ix
        ay, by = (low[b, 1] - py) * iy, (high[b, 1] - py) * iy
        az, bz = (low[b, 2] - pz) * iz, (high[b, 2] - pz) * iz
        near = max(max(min(ax, bx), min(ay, by)), min(az, bz))
        far = min(min(max(ax, bx), max(ay, by)), max(az, bz))
        if far >= np.float32(0) and near <= far:
            return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def _hemisphere_through(
    begin, end, rows, origins, normals, azimuths, offsets, low, high, center, radius, hidden, buffer, index, used
):
    """Rays of rows[begin:end] that are not hidden and go through a box, into `buffer` from `begin` * rays on.

    index: row * rays + ray, for each. used[begin]: how many there are. Directions are those of `sampling._shoot`, operation by operation.
    """
    count, at = len(azimuths), begin * len(azimuths)
    one, step = np.float32(1), np.float32(1 / len(azimuths))
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
        sign, turn = np.copysign(one, nz), np.float32(2.0 * np.pi) * offsets[v, 1]
        cos_turn, sin_turn = np.cos(turn), np.sin(turn)
        a = -one / (sign + nz)
        b = nx * ny * a
        tx, ty, tz = one + sign * nx * nx * a, sign * b, -sign * nx
        bx, by, bz = b, sign + ny * ny * a, -ny
        for i in range(first, last):
            if hidden[v, i >> 3] & (np.uint8(128) >> np.uint8(i & 7)):
                continue
            square = (np.float32(i) + shift) * step
            radial, height = np.sqrt(square), np.sqrt(max(one - square, np.float32(0)))
            u = radial * (cos_turn * azimuths[i, 0] - sin_turn * azimuths[i, 1])
            w = radial * (sin_turn * azimuths[i, 0] + cos_turn * azimuths[i, 1])
            dx = u * tx + w * bx + height * nx
            dy = u * ty + w * by + height * ny
            dz = u * tz + w * bz + height * nz
            if _meets(px, py, pz, dx, dy, dz, low, high):
                buffer[at, 0], buffer[at, 1], buffer[at, 2] = px, py, pz
                buffer[at, 3], buffer[at, 4], buffer[at, 5] = dx, dy, dz
                index[at] = row * count + i
                at += 1
    used[begin] = at - begin * count


@njit(cache=True, nogil=True, error_model="numpy")
def _beams_through(
    begin, end, rows, origins, normals, directions, low, high, center, radius, hidden, buffer, index, used
):
    """As `_hemisphere_through`, towards given directions above the horizon."""
    count, at = len(directions), begin * len(directions)
    for row in range(begin, end):
        v = rows[row]
        nx, ny, nz = normals[v]
        px, py, pz = origins[v]
        wx, wy, wz = center[0] - px, center[1] - py, center[2] - pz
        square = wx * wx + wy * wy + wz * wz
        if square > radius * radius and wx * nx + wy * ny + wz * nz < -radius:
            continue
        for i in range(count):
            if hidden[v, i >> 3] & (np.uint8(128) >> np.uint8(i & 7)):
                continue
            dx, dy, dz = directions[i]
            if nx * dx + ny * dy + nz * dz > np.float32(0) and _meets(px, py, pz, dx, dy, dz, low, high):
                buffer[at, 0], buffer[at, 1], buffer[at, 2] = px, py, pz
                buffer[at, 3], buffer[at, 4], buffer[at, 5] = dx, dy, dz
                index[at] = row * count + i
                at += 1
    used[begin] = at - begin * count
