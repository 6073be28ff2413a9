"""The inputs of the mixing network: several estimates of every shadow, and rotation-invariant numbers about them.

The estimates are the rays' own, those after one and two steps that keep to neighbours in agreement (`filtering`), and
those after one and two more that go by the normals alone: from noisy and unbiased to smooth and biased. Only the bands
depend on the number of bands, so fewer bands are the first part of more.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices, read_only

from ..sh import harmonics
from . import filtering
from .lobes import squared_lobe
from .neighbors import Neighbors
from .sampling import legendre_factors

CENTER, *OTHERS = ESTIMATES = ("agreeing 2", "own", "agreeing 1", "smooth 1", "smooth 2")
"""Estimates by number of averaging steps. Differences of OTHERS to CENTER are what is mixed. Twelve estimates, some
with weights taken from the averaged shadows, gain 1 to 5% more; two and four smooth steps from the own rays, instead of
the last two, up to 5% above 64 rays and nothing below. Neither is worth its time."""

LOG_BAND = len(ESTIMATES)
BAND_FEATURES = LOG_BAND + len(ESTIMATES) * (len(ESTIMATES) - 1) // 2 + len(ESTIMATES) + 2
"""Of a vertex and a degree: squares over the expected noise; cosines between; cosines with Y(n); degree, its root."""

LOG_VERTEX = 4 + LOG_BAND
VERTEX_FEATURES = LOG_VERTEX + 2
"""Of a vertex: partial shadow, noise left after each of two steps, rays, squares of the lowest bands together;
share of the ring that is level, share of it that agrees."""

_TINY = np.float32(1e-30)


@dataclass(frozen=True)
class Estimates:
    """Of N nodes, in the order of ESTIMATES.

    shadows: (S, N, K) float32, T - A, what shadows take from the transfer. model, rest: the center's, as `filtering`.
    noise: (N,) float32, variance to be expected of a coefficient of the own rays. vertex: (N, VERTEX_FEATURES).
    """

    shadows: NDArray[np.float32]
    model: NDArray[np.float32]
    rest: NDArray[np.float32]
    noise: NDArray[np.float32]
    vertex: NDArray[np.float32]


def estimate(
    neighbors: Neighbors,  # N nodes
    normals: NDArray[np.float32],  # (N, 3) float32, unit
    model: NDArray[np.float32],  # (N, 4) float32 of `sampling.gather`
    rest: NDArray[np.float32],  # (N, K) float32 of the same, at least `filtering.GUIDE_BANDS` bands
    rays: int,  # per node
) -> Estimates:
    """Average in all ways: Estimates. Where all nodes within four rings see everything, or nothing, all are equal."""
    count, bands = len(model), math.isqrt(rest.shape[1])
    shadows = np.zeros((len(ESTIMATES), *rest.shape), np.float32)
    rows, nodes = (neighbors.starts, neighbors.columns), np.arange(count)

    def tables(bands: int) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        return (
            legendre_factors(bands),
            (harmonics.lambert_coefficients(bands) / np.pi).astype(np.float32),
            squared_lobe(bands),
        )

    def keep(name: str, model: NDArray[np.float32], rest: NDArray[np.float32]) -> NDArray[np.float32]:
        shadow = shadows[ESTIMATES.index(name)]
        in_slices(filtering._guides, count, normals, model, rest, nodes, *tables(bands), shadow)
        return shadow

    def step(
        model: NDArray[np.float32], rest: NDArray[np.float32], weights: NDArray[np.float32], own: NDArray[np.float32]
    ) -> None:
        for first in range(0, 4 + rest.shape[1], filtering._COLUMNS):
            in_slices(filtering._take, count, model, rest, nodes, first, old)
            in_slices(filtering._blend, count, *rows, weights, own, old, model, rest, nodes, first)

    old = np.zeros((count, filtering._COLUMNS), np.float32)
    guide_columns = filtering.GUIDE_BANDS**2
    guide = np.ascontiguousarray(keep("own", model, rest)[:, :guide_columns])
    partial, spread, left = np.zeros((3, count), np.float32)
    in_slices(filtering._partial_shadow, count, *rows, neighbors.weights, guide, partial)
    noise = filtering.NOISE * rays**filtering.NOISE_POWER
    accepted = np.float32(noise * guide_columns * filtering.TOLERANCE)
    vertex = np.zeros((count, VERTEX_FEATURES), np.float32)
    weights, own, level = np.zeros_like(neighbors.weights), np.zeros(count, np.float32), np.zeros(count, np.float32)

    in_slices(_level, count, *rows, neighbors.weights, level)
    model, rest, spread = model.copy(), rest.copy(), partial.copy()
    for number in (1, 2):
        compared = guide, spread, accepted, weights, own, left
        in_slices(filtering._weigh, count, *rows, neighbors.weights, *compared)
        step(model, rest, weights, own)
        guide = np.ascontiguousarray(keep(f"agreeing {number}", model, rest)[:, :guide_columns])
        vertex[:, number] = left / partial
        if number == 1:
            vertex[:, LOG_VERTEX] = (1.0 / level - 1.0) / np.maximum(np.diff(neighbors.starts), 1)
            vertex[:, LOG_VERTEX + 1] = level / own
        spread, left = left, spread
    center = model.copy(), rest.copy()
    for number in (1, 2):
        step(model, rest, neighbors.weights, level)
        keep(f"smooth {number}", model, rest)
    vertex[:, 0], vertex[:, 3] = partial, rays
    return Estimates(shadows, *center, np.float32(noise) * partial, vertex)


def describe(
    estimates: Estimates,
    begin: int,
    end: int,
    basis: NDArray[np.float32],  # (end - begin, K) float32, Y(n)
    chosen: NDArray[np.int64],  # (M,) int64, which of the nodes from `begin` on, counted from there
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Invariants of M nodes: (M, VERTEX_FEATURES) and (M, B, BAND_FEATURES) float32, as the network takes them."""
    bands = math.isqrt(estimates.shadows.shape[2])
    vertex = estimates.vertex[begin + chosen]
    band = np.zeros((len(chosen), bands, BAND_FEATURES), np.float32)
    _describe(estimates.shadows, begin, basis, estimates.noise[begin:end], chosen, vertex, band)
    return vertex, band


def differing(estimates: Estimates, begin: int, end: int) -> NDArray[np.int64]:
    """Which of the nodes begin..end have estimates that differ, counted from there: (M,) int64."""
    differ = np.zeros(end - begin, bool)
    _differing(estimates.shadows, begin, differ)
    return np.flatnonzero(differ)


def mix(
    estimates: Estimates,
    begin: int,
    chosen: NDArray[np.int64],  # (M,) int64 of `differing`
    weights: NDArray[np.float32],  # (M, B, S - 1) float32
    transfer: NDArray[np.float32],  # (end - begin, K) float32, changed: the center's on entry
) -> None:
    """Add weight times difference to the center, degree by degree, for the chosen nodes."""
    _mix_in(estimates.shadows, begin, chosen, read_only(weights), transfer)


@kernel
def _level(
    begin: int,
    end: int,
    starts: NDArray[np.int64],
    columns: NDArray[np.int32],
    base: NDArray[np.float32],
    own: NDArray[np.float32],
) -> None:
    for i in range(begin, end):
        total = np.float32(1)
        for at in range(starts[i], starts[i + 1]):
            total += base[at]
        own[i] = np.float32(1) / total


@kernel
def _differing(shadows: NDArray[np.float32], begin: int, differ: Mask) -> None:
    for i in range(len(differ)):
        for s in range(1, shadows.shape[0]):
            for k in range(shadows.shape[2]):
                if shadows[s, begin + i, k] != shadows[0, begin + i, k]:
                    differ[i] = True
                    break
            if differ[i]:
                break


@kernel
def _describe(
    shadows: NDArray[np.float32],
    begin: int,
    basis: NDArray[np.float32],
    noise: NDArray[np.float32],
    chosen: NDArray[np.int64],
    vertex: NDArray[np.float32],
    band: NDArray[np.float32],
) -> None:
    count, bands = shadows.shape[0], band.shape[1]
    product, along = np.zeros((count, count), np.float32), np.zeros(count, np.float32)
    low = np.zeros(count, np.float32)
    for row in range(len(chosen)):
        i = chosen[row]
        low[:] = np.float32(0)
        for degree in range(bands):
            _products(shadows[:, begin + i], basis[i], degree * degree, (degree + 1) * (degree + 1), product, along)
            width = np.float32(2 * degree + 1)
            column = count
            for s in range(count):
                if degree < filtering.GUIDE_BANDS:
                    low[s] += product[s, s]
                band[row, degree, s] = product[s, s] / (noise[i] * width)
                for t in range(s):
                    band[row, degree, column] = product[s, t] / np.sqrt(product[s, s] * product[t, t] + _TINY)
                    column += 1
            length = width / np.float32(4.0 * math.pi)
            for s in range(count):
                band[row, degree, column + s] = along[s] / np.sqrt(product[s, s] * length + _TINY)
            band[row, degree, column + count] = degree
            band[row, degree, column + count + 1] = np.sqrt(np.float32(degree))
        for s in range(count):
            vertex[row, 4 + s] = low[s] / (noise[i] * np.float32(filtering.GUIDE_BANDS**2))


@kernel
def _products(
    x: NDArray[np.float32],
    basis: NDArray[np.float32],
    first: int,
    last: int,
    product: NDArray[np.float32],
    along: NDArray[np.float32],
) -> None:
    """Products of the center and the differences to it, with each other (lower half) and with the basis, by order.

    Written out for five estimates: sums in registers are six times faster than in an array.
    """
    zero = np.float32(0)
    p00, p10, p11, p20, p21, p22, p30, p31 = zero, zero, zero, zero, zero, zero, zero, zero
    p32, p33, p40, p41, p42, p43, p44 = zero, zero, zero, zero, zero, zero, zero
    a0, a1, a2, a3, a4 = zero, zero, zero, zero, zero
    for k in range(first, last):
        c, y = x[0, k], basis[k]
        d, e, f, g = x[1, k] - c, x[2, k] - c, x[3, k] - c, x[4, k] - c
        p00, p10, p11, p20, p21 = p00 + c * c, p10 + d * c, p11 + d * d, p20 + e * c, p21 + e * d
        p22, p30, p31, p32, p33 = p22 + e * e, p30 + f * c, p31 + f * d, p32 + f * e, p33 + f * f
        p40, p41, p42, p43, p44 = p40 + g * c, p41 + g * d, p42 + g * e, p43 + g * f, p44 + g * g
        a0, a1, a2, a3, a4 = a0 + c * y, a1 + d * y, a2 + e * y, a3 + f * y, a4 + g * y
    product[0, 0], product[1, 0], product[1, 1], product[2, 0], product[2, 1] = p00, p10, p11, p20, p21
    product[2, 2], product[3, 0], product[3, 1], product[3, 2], product[3, 3] = p22, p30, p31, p32, p33
    product[4, 0], product[4, 1], product[4, 2], product[4, 3], product[4, 4] = p40, p41, p42, p43, p44
    along[0], along[1], along[2], along[3], along[4] = a0, a1, a2, a3, a4


@kernel
def _mix_in(
    shadows: NDArray[np.float32],
    begin: int,
    chosen: NDArray[np.int64],
    weights: NDArray[np.float32],
    transfer: NDArray[np.float32],
) -> None:
    for row in range(len(chosen)):
        i = chosen[row]
        node = begin + i
        for degree in range(weights.shape[1]):
            own, agreeing = weights[row, degree, 0], weights[row, degree, 1]
            nearer, wider = weights[row, degree, 2], weights[row, degree, 3]
            for k in range(degree * degree, (degree + 1) * (degree + 1)):
                center = shadows[0, node, k]
                transfer[i, k] += (
                    own * (shadows[1, node, k] - center)
                    + agreeing * (shadows[2, node, k] - center)
                    + nearer * (shadows[3, node, k] - center)
                    + wider * (shadows[4, node, k] - center)
                )
