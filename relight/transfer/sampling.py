"""Ray directions about the normals and their sums in spherical harmonics: the compiled inner loops.

The visibility V of a vertex is split into a linear part and the rest. A ridge fit gives V(d) = a + b . d, whose
transfer is known in closed form (`lobes.add_model`); the rays then only have to carry what is left, V - a - b . d
(`gather`). Against V alone that is a linear control variate. A vertex is computed from its own row alone, so neither
the vertex order nor chunking changes a bit.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Mask
from splat2mesh.base.kernels import kernel
from splat2mesh.base.sphere import GOLDEN_TURN
from splat2mesh.base.threads import in_slices

RIDGE_NORMAL, RIDGE_TANGENT = np.float32(0.01), np.float32(0.1)
"""Added to the second moments of d along the normal (1/18 about its mean) and across it (1/4) in the fit of b.
They bound what few rays make of noise: with 0.003 for both the filtered error at 8 rays is 5% larger, at 64 equal."""

MAX_DOUBLINGS = 2
"""Sets of rays that grew by doubling are 3 to 8% noisier than one made at once after one or two steps (homer and spot,
3 and 8 bands), up to 15% on others, more on regular grids; after three by 40%: the azimuths begin to line up."""

MIN_GROWING = 16
"""Fewer rays are not worth keeping for more: twice 8 rays have 12% more noise than 16."""

# Two irrational steps whose multiples fill the unit square evenly in every run of successive ranks (the plastic
# number's powers, as in the R2 sequence of Roberts, 2018), as fractions of 2^64.
_RANK_STEPS = np.array([0xC13FA9A902A6328F, 0x91E10DA5C79E7B1D], np.uint64)


def fibonacci_azimuths(rays: int) -> NDArray[np.float32]:
    """Cosine and sine of the azimuths of the cosine-weighted Fibonacci set: (R, 2) float32.

    Point i of R lies at radius sqrt((i + s) / R) of the unit disc, s in [0, 1) the stratum shift; lifted
    onto the hemisphere it is cosine-distributed (Malley's method).
    """
    angle = 2.0 * np.pi * np.modf(np.arange(rays) * GOLDEN_TURN)[0]
    return np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)


def hashed_offsets(
    origins: NDArray[np.float32],  # (V, 3) float32
    normals: NDArray[np.float32],  # (V, 3) float32, unit
    seed: int,
) -> NDArray[np.float32]:
    """Offset in the stratum and azimuth of every vertex, (V, 2) float32 in [0, 1), hashed from its own bits."""
    offsets = np.zeros((len(origins), 2), np.float32)
    in_slices(_hashed_offsets, len(origins), origins, normals, np.uint64(seed), offsets)
    return offsets


def ranked_offsets(ranks: Indices, seed: int) -> NDArray[np.float32]:
    """The same for vertices of these ranks (N,) along a curve through space, so that neighbours share the work.

    Vertices whose ranks are close get offsets that fill the unit square evenly, and the mean over a
    neighbourhood has less noise than that of independent offsets (8 rays, two rings: 13%).
    """
    rank = ranks.astype(np.uint64)[:, None]
    start = np.array([_mix(np.uint64(2 * seed % 2**64)), _mix(np.uint64((2 * seed + 1) % 2**64))], np.uint64)
    return ((rank * _RANK_STEPS + start) >> np.uint64(40)).astype(np.float32) * np.float32(2.0**-24)


def next_sets(sets: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The offsets that double sets of rays, [(part of a stratum, part of a turn)]: each half a stratum further, and
    turned so that azimuths interleave evenly.

    The azimuths of n points ranked by radius are multiples of a turn g; of 2 n points they are multiples of g / 2, or
    g / 2 + 1/2, which is as far from every simple fraction.
    """
    turn = GOLDEN_TURN
    for _ in range(len(sets).bit_length() - 1):
        turn = (turn / 2 + 0.5) % 1.0
    return [(shift + 0.5 / len(sets), (by + turn / 2 + 0.5) % 1.0) for shift, by in sets]


def most_grown(base: int) -> int:
    """How many rays sets of `base` may become by doubling."""
    return base << MAX_DOUBLINGS if base >= MIN_GROWING else base


def moved(offsets: NDArray[np.float32], by: tuple[float, float]) -> NDArray[np.float32]:
    """Offsets (N, 2) of one set of rays as those of another, which lies so far from it."""
    return ((offsets + np.array(by, np.float32)) % np.float32(1.0)).astype(np.float32)


def shoot(
    origins: NDArray[np.float32],  # (V, 3) float32
    normals: NDArray[np.float32],  # (V, 3) float32, unit
    azimuths: NDArray[np.float32],  # (R, 2) float32 of `fibonacci_azimuths`
    seed: int,
    rays: NDArray[np.float32],  # (V, R, 6) float32, written: origin and unit direction
) -> None:
    """Cosine-distributed rays about every normal; each vertex turns and shifts the set as `hashed_offsets` say."""
    shoot_at(origins, normals, azimuths, hashed_offsets(origins, normals, seed), rays)


def shoot_at(
    origins: NDArray[np.float32],
    normals: NDArray[np.float32],
    azimuths: NDArray[np.float32],
    offsets: NDArray[np.float32],
    rays: NDArray[np.float32],
) -> None:
    """Like `shoot`, with the given offsets (V, 2): part of a stratum, part of a full turn."""
    in_slices(_shoot, len(origins), origins, normals, azimuths, offsets, rays)


def gather(
    rays: NDArray[np.float32],  # (V, R, 6) float32 of `shoot`
    occluded: Mask,  # (V, R) bool
    normals: NDArray[np.float32],  # (V, 3) float32, unit
    model: NDArray[np.float32],  # (V, 4) float32, written: a, b
    rest: NDArray[np.float32],  # (V, K) float32, written
) -> None:
    """Fit V(d) = a + b . d to the visibility of the rays, and project the residual: sum (V - a - b . d) Y / R.

    a and b come from the visible fraction f = mean V and the moment t = mean V d (less what the set itself
    leans, f (mean d - 2/3 n)) by the normal equations under the cosine lobe, with a ridge on b. Where all rays agree
    b and the rest are exactly 0, and a is exactly 0 or 1.
    """
    in_slices(_gather, len(rays), rays, occluded, normals, legendre_factors(math.isqrt(rest.shape[1])), model, rest)


@kernel
def _mix(state: np.uint64) -> np.uint64:
    """The finaliser of SplitMix64 (Steele, Lea, Flood, 2014)."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))


@kernel
def _hash(position: NDArray[np.float32], normal: NDArray[np.float32], seed: np.uint64) -> np.uint64:
    """64 bits from six float32 and the seed; zeros of either sign count as one."""
    state = _mix(seed + np.uint64(0x9E3779B97F4A7C15))
    values = np.empty(6, np.float32)
    for i in range(3):  # slices would have Numba compile the printing of shapes, which takes seconds
        values[i], values[3 + i] = position[i], normal[i]
    for word in (values + np.float32(0.0)).view(np.uint32):
        state = _mix((state ^ np.uint64(word)) + np.uint64(0x9E3779B97F4A7C15))
    return state


@kernel
def _hashed_offsets(
    begin: int,
    end: int,
    origins: NDArray[np.float32],
    normals: NDArray[np.float32],
    seed: np.uint64,
    offsets: NDArray[np.float32],
) -> None:
    unit = np.float32(2.0**-24)  # 24 bits fill a float32 below 1
    for v in range(begin, end):
        bits = _hash(origins[v], normals[v], seed)
        offsets[v, 0] = np.float32(bits >> np.uint64(40)) * unit
        offsets[v, 1] = np.float32((bits >> np.uint64(8)) & np.uint64(0xFFFFFF)) * unit


@kernel
def _shoot(
    begin: int,
    end: int,
    origins: NDArray[np.float32],
    normals: NDArray[np.float32],
    azimuths: NDArray[np.float32],
    offsets: NDArray[np.float32],
    rays: NDArray[np.float32],
) -> None:
    for v in range(begin, end):
        px, py, pz = origins[v]
        frame = tangents(normals[v, 0], normals[v, 1], normals[v, 2])
        turn = turned(offsets[v, 1])
        for i in range(len(azimuths)):
            rays[v, i, 0], rays[v, i, 1], rays[v, i, 2] = px, py, pz
            rays[v, i, 3], rays[v, i, 4], rays[v, i, 5] = direction(i, offsets[v, 0], turn, frame, azimuths)


@kernel
def tangents(nx: np.float32, ny: np.float32, nz: np.float32) -> tuple[np.float32, ...]:
    """A normal and two unit vectors across it, as nine float32: tangent, bitangent, normal.

    Without a branch: Duff et al., "Building an Orthonormal Basis, Revisited", 2017.
    """
    one = np.float32(1)
    sign = np.copysign(one, nz)
    a = -one / (sign + nz)
    b = nx * ny * a
    return one + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny, nx, ny, nz


@kernel
def turned(offset: np.float32) -> tuple[np.float32, np.float32]:
    """Cosine and sine of a part of a full turn."""
    turn = np.float32(2.0 * np.pi) * offset
    return np.cos(turn), np.sin(turn)


@kernel
def direction(
    ray: int,  # its rank: the higher above the horizon, the lower
    shift: np.float32,  # part of a stratum
    turn: tuple[np.float32, np.float32],  # of `turned`
    frame: tuple[np.float32, ...],  # of `tangents`
    azimuths: NDArray[np.float32],  # (R, 2)
) -> tuple[np.float32, np.float32, np.float32]:
    """The direction of one ray of a cosine-weighted set of R, as float32; it compiles into vectors of many."""
    one, step = np.float32(1), np.float32(1 / len(azimuths))
    tx, ty, tz, bx, by, bz, nx, ny, nz = frame
    square = (np.float32(ray) + shift) * step
    radius, height = np.sqrt(square), np.sqrt(max(one - square, np.float32(0)))
    u = radius * (turn[0] * azimuths[ray, 0] - turn[1] * azimuths[ray, 1])
    w = radius * (turn[1] * azimuths[ray, 0] + turn[0] * azimuths[ray, 1])
    return u * tx + w * bx + height * nx, u * ty + w * by + height * ny, u * tz + w * bz + height * nz


def legendre_factors(bands: int) -> NDArray[np.float32]:
    """Factors of the recurrence in `_gather`, (B, B, 2) float32 by degree and order; [m, m, 0] starts m."""
    factors = np.zeros((bands, bands, 2))
    start = np.sqrt(0.25 / np.pi)
    for m in range(bands):
        factors[m, m, 0] = start * (np.sqrt(2.0) if m else 1.0)
        start *= np.sqrt((2 * m + 3) / (2 * m + 2))
        for degree in range(m + 1, bands):
            factors[degree, m, 0] = np.sqrt((4 * degree**2 - 1) / (degree**2 - m**2))
            factors[degree, m, 1] = (
                np.sqrt(((degree - 1) ** 2 - m**2) / (4 * (degree - 1) ** 2 - 1)) if degree > m + 1 else 0.0
            )
    return factors.astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _gather(
    begin: int,
    end: int,
    rays: NDArray[np.float32],
    occluded: Mask,
    normals: NDArray[np.float32],
    norms: NDArray[np.float32],
    model: NDArray[np.float32],
    rest: NDArray[np.float32],
) -> None:
    count, bands = rays.shape[1], norms.shape[1]
    z, real, imaginary = np.zeros(count, np.float32), np.zeros(count, np.float32), np.zeros(count, np.float32)
    polar, below = np.zeros(count, np.float32), np.zeros(count, np.float32)
    two_thirds, per_ray = np.float32(2 / 3), np.float32(1 / count)
    for v in range(begin, end):
        hidden = 0
        for i in range(count):
            hidden += occluded[v, i]
        visible = np.float32(1 - hidden / count)
        model[v, 0] = visible
        model[v, 1:] = np.float32(0)
        rest[v] = np.float32(0)
        if hidden == 0 or hidden == count:
            continue
        tx, ty, tz = np.float32(0), np.float32(0), np.float32(0)
        for i in range(count):
            real[i] = np.float32(1 - occluded[v, i])
            weight = real[i] - visible
            tx += weight * rays[v, i, 3]
            ty += weight * rays[v, i, 4]
            tz += weight * rays[v, i, 5]
        nx, ny, nz = normals[v]
        tx, ty, tz = tx * per_ray, ty * per_ray, tz * per_ray  # t - 2/3 f n
        along = tx * nx + ty * ny + tz * nz
        slope, across = along / (np.float32(1 / 18) + RIDGE_NORMAL), np.float32(1) / (np.float32(0.25) + RIDGE_TANGENT)
        bx = (tx - along * nx) * across + slope * nx
        by = (ty - along * ny) * across + slope * ny
        bz = (tz - along * nz) * across + slope * nz
        a = visible - two_thirds * slope
        model[v, 0], model[v, 1], model[v, 2], model[v, 3] = a, bx, by, bz
        # The recurrence of sh.evaluate, over all rays at once; the weights ride on the powers of x + i y.
        for i in range(count):
            x, y, z[i] = rays[v, i, 3], rays[v, i, 4], rays[v, i, 5]
            real[i] = (real[i] - a - (bx * x + by * y + bz * z[i])) * per_ray
            imaginary[i] = np.float32(0)
        for m in range(bands):
            for i in range(count):
                polar[i], below[i] = norms[m, m, 0], np.float32(0)
            for degree in range(m, bands):
                sum_real, sum_imaginary = np.float32(0), np.float32(0)
                if degree > m:
                    up, down = norms[degree, m, 0], norms[degree, m, 1]
                    for i in range(count):
                        value = up * (z[i] * polar[i] - down * below[i])
                        below[i], polar[i] = polar[i], value
                for i in range(count):
                    sum_real += polar[i] * real[i]
                    sum_imaginary += polar[i] * imaginary[i]
                center = degree * (degree + 1)
                rest[v, center + m] = sum_real
                if m > 0:
                    rest[v, center - m] = sum_imaginary
            for i in range(count):
                x, y = rays[v, i, 3], rays[v, i, 4]
                real[i], imaginary[i] = x * real[i] - y * imaginary[i], x * imaginary[i] + y * real[i]
