"""Ray directions about the normals and their sums in spherical harmonics: the compiled inner loops.

A vertex is computed from its own row alone, so neither the vertex order nor chunking changes a bit.
"""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from numba import njit

GOLDEN_TURN = 0.6180339887498949  # of a full turn, between successive points of the Fibonacci set


def fibonacci_azimuths(rays):
    """Cosine and sine of the azimuths of the cosine-weighted Fibonacci set: (R, 2) float32.

    Point i of R lies at radius sqrt((i + s) / R) of the unit disc, s in [0, 1) the stratum shift; lifted
    onto the hemisphere it is cosine-distributed (Malley's method).
    """
    angle = 2.0 * np.pi * np.modf(np.arange(rays) * GOLDEN_TURN)[0]
    return np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)


def shoot(
    origins,  # (V, 3) float32
    normals,  # (V, 3) float32, unit
    azimuths,  # (R, 2) float32 of `fibonacci_azimuths`
    seed,
    rays,  # (V, R, 6) float32, written: origin and unit direction
):
    """Cosine-distributed rays about every normal.

    Each vertex turns the set by an azimuth of its own and shifts it within its strata, both hashed from the
    bits of its origin, its normal and the seed.
    """
    _in_slices(_shoot, len(origins), origins, normals, azimuths, np.uint64(seed), rays)


def gather(
    rays,  # (V, R, 6) float32 of `shoot`
    occluded,  # (V, R) bool
    transfer,  # (V, K) float32: unoccluded on entry, shadowed on return
):
    """Shadowed transfer from the visibility of the rays, with the unoccluded transfer A as control variate.

    T = a + f (A - a - b): a, b the sums of Y over visible and occluded rays, divided by R, f the visible
    fraction. That is f A + sum (visible - f) Y / R: exactly A where nothing is hidden, 0 where everything is.
    """
    _in_slices(_gather, len(rays), rays, occluded, _norms(math.isqrt(transfer.shape[1])), transfer)


def _in_slices(kernel, count, *arrays):
    """Run a kernel over the vertices 0..count, a slice for each core: the kernels release the GIL."""
    cuts = np.linspace(0, count, (os.cpu_count() or 1) + 1).astype(int)
    spans = [span for span in pairwise(cuts) if span[0] < span[1]]
    if len(spans) == 1:
        return kernel(*spans[0], *arrays)
    with ThreadPoolExecutor(len(spans)) as pool:
        for done in [pool.submit(kernel, *span, *arrays) for span in spans]:
            done.result()


@njit(cache=True, nogil=True)
def _mix(state):
    """The finaliser of SplitMix64 (Steele, Lea, Flood, 2014)."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))


@njit(cache=True, nogil=True)
def _hash(position, normal, seed):
    """64 bits from six float32 and the seed; zeros of either sign count as one."""
    state = _mix(seed + np.uint64(0x9E3779B97F4A7C15))
    values = np.zeros(6, np.float32)
    values[:3] = position
    values[3:] = normal
    for word in (values + np.float32(0.0)).view(np.uint32):
        state = _mix((state ^ np.uint64(word)) + np.uint64(0x9E3779B97F4A7C15))
    return state


@njit(cache=True, nogil=True, error_model="numpy")
def _shoot(begin, end, origins, normals, azimuths, seed, rays):
    count = len(azimuths)
    unit = np.float32(2.0**-24)  # 24 bits fill a float32 below 1
    one, step = np.float32(1), np.float32(1 / count)
    for v in range(begin, end):
        bits = _hash(origins[v], normals[v], seed)
        shift = np.float32(bits >> np.uint64(40)) * unit
        turn = np.float32(2.0 * np.pi) * np.float32((bits >> np.uint64(8)) & np.uint64(0xFFFFFF)) * unit
        cos_turn, sin_turn = np.cos(turn), np.sin(turn)
        # Tangents without a branch: Duff et al., "Building an Orthonormal Basis, Revisited", 2017.
        nx, ny, nz = normals[v]
        sign = np.copysign(one, nz)
        a = -one / (sign + nz)
        b = nx * ny * a
        tx, ty, tz = one + sign * nx * nx * a, sign * b, -sign * nx
        bx, by, bz = b, sign + ny * ny * a, -ny
        px, py, pz = origins[v]
        for i in range(count):
            square = (np.float32(i) + shift) * step
            radius, height = np.sqrt(square), np.sqrt(max(one - square, np.float32(0)))
            u = radius * (cos_turn * azimuths[i, 0] - sin_turn * azimuths[i, 1])
            w = radius * (sin_turn * azimuths[i, 0] + cos_turn * azimuths[i, 1])
            rays[v, i, 0], rays[v, i, 1], rays[v, i, 2] = px, py, pz
            rays[v, i, 3] = u * tx + w * bx + height * nx
            rays[v, i, 4] = u * ty + w * by + height * ny
            rays[v, i, 5] = u * tz + w * bz + height * nz


def _norms(bands):
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
def _gather(begin, end, rays, occluded, norms, transfer):
    count, bands = rays.shape[1], norms.shape[1]
    z, real, imaginary = np.zeros(count, np.float32), np.zeros(count, np.float32), np.zeros(count, np.float32)
    polar, below = np.zeros(count, np.float32), np.zeros(count, np.float32)
    for v in range(begin, end):
        hidden = 0
        for i in range(count):
            hidden += occluded[v, i]
        visible = np.float32(1 - hidden / count)
        for k in range(transfer.shape[1]):
            transfer[v, k] *= visible
        if hidden == 0 or hidden == count:
            continue
        # The recurrence of sh.evaluate, over all rays at once; the weights ride on the powers of x + i y.
        for i in range(count):
            z[i] = rays[v, i, 5]
            real[i] = (np.float32(1 - occluded[v, i]) - visible) / np.float32(count)
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
                transfer[v, center + m] += sum_real
                if m > 0:
                    transfer[v, center - m] += sum_imaginary
            for i in range(count):
                x, y = rays[v, i, 3], rays[v, i, 4]
                real[i], imaginary[i] = x * real[i] - y * imaginary[i], x * imaginary[i] + y * real[i]
