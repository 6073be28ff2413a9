"""Spherical harmonics: evaluation, rotation, Lambert's lobe, conversions.

Basis: real, orthonormal, all-positive (no Condon-Shortley phase). Index i = l (l + 1) + m, so that the first
four are constants times 1, y, z, x. B bands are K = B^2 coefficients, in arrays of shape (K,) or (..., K, C),
with the SH axis before the colour axis and any others before both.
"""

import math

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Coefficients, Directions, Floats
from splat2mesh.base.errors import InputError
from splat2mesh.base.threads import ROWS_AT_ONCE

MAX_BANDS = 10


def check_bands(bands: int) -> int:
    """Return `bands` as an int. Raises InputError unless it is a whole number from 1 to `MAX_BANDS`."""
    if bands != int(bands) or not 1 <= bands <= MAX_BANDS:
        raise InputError(f"`bands` must be a whole number from 1 to {MAX_BANDS}, found {bands}")
    return int(bands)


def bands_of(coefficients: Coefficients) -> int:
    """Return the number of bands of SH coefficients.

    coefficients: (K,) or (..., K, C), index l (l + 1) + m, the SH axis before the colour axis. Returns B, with K = B^2.
    Raises InputError unless K is 1, 4, 9 ... 100.
    """
    shape = np.shape(coefficients)
    count = shape[-2:][0] if shape else 0
    bands = math.isqrt(count)
    if bands * bands != count or not 1 <= bands <= MAX_BANDS:
        raise InputError(f"SH coefficients must be (..., K, C) with K = 1, 4, 9 ... 100, found shape {shape}")
    return bands


def degrees_and_orders(bands: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return degree l and order m of every coefficient.

    bands: B, from 1 up. Returns (K,) int64: K = B^2, in the order of the coefficients.
    """
    degree = np.repeat(np.arange(bands), 2 * np.arange(bands) + 1)
    return degree, np.arange(bands * bands) - degree * (degree + 1)


def evaluate(directions: Directions, bands: int) -> Floats:
    """Evaluate the basis in directions.

    directions: (N, 3), unit vectors, scene frame. bands: B, from 1 to `MAX_BANDS`. Returns (N, K): Y(d), in the dtype
    of the directions; float64 for integers. Raises InputError for another shape, and for bands outside 1..10.

    The normalised recurrence of the associated Legendre functions (Press et al., Numerical Recipes, 3rd ed., 6.7), with
    sin^m carried by the powers of x + i y, so that the poles need no care.
    """
    bands = check_bands(bands)
    directions = np.asarray(directions)
    if not np.issubdtype(directions.dtype, np.floating):
        directions = directions.astype(np.float64)
    if directions.ndim != 2 or directions.shape[1] != 3:
        raise InputError(f"directions must have shape (N, 3), found {directions.shape}")
    values = np.zeros((len(directions), bands * bands), directions.dtype)
    for start in range(0, len(directions), ROWS_AT_ONCE):
        block = slice(start, start + ROWS_AT_ONCE)
        values[block] = _evaluate_block(np.ascontiguousarray(directions[block].T), bands).T
    return values


def rotation_matrix(rotation: Floats, bands: int) -> NDArray[np.float64]:
    """Return the matrix that rotates SH coefficients.

    rotation: (3, 3), proper rotation R, `dst_from_src`. bands: B, from 1 to `MAX_BANDS`. Returns (K, K) float64:
    orthogonal, band-diagonal M with Y(R d) = M Y(d). It also rotates what is described: where c are the coefficients of
    L(d), M c are those of L(R^-1 d). Raises InputError for a matrix that is no rotation, to 1e-6, and for bands outside
    1..10.

    M_ij is the integral of Y_i(R d) Y_j(d), which the quadrature evaluates exactly (to about 1e-14).
    """
    bands = check_bands(bands)
    rotation = np.asarray(rotation, np.float64)
    if rotation.shape != (3, 3) or not np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-6:
        raise InputError(f"expected a (3, 3) rotation matrix, found {rotation.tolist()}")
    directions, weights = quadrature(bands)
    degree, _ = degrees_and_orders(bands)
    matrix = evaluate(directions @ rotation.T, bands).T @ (evaluate(directions, bands) * weights[:, None])
    return np.where(degree[:, None] == degree, matrix, 0.0)


def lambert_coefficients(bands: int) -> NDArray[np.float64]:
    """Return Lambert's lobe, the clamped cosine, in zonal harmonics.

    bands: B, from 1 to `MAX_BANDS`. Returns (B,) float64: A_l: pi, 2 pi / 3, pi / 4, 0 ...

    Source: Ramamoorthi and Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001.
    """
    lobe = np.zeros(check_bands(bands))
    lobe[:2] = [np.pi, 2.0 * np.pi / 3.0][: len(lobe)]
    for degree in range(2, len(lobe), 2):
        half = degree // 2
        fraction = math.comb(degree, half) / 2**degree / ((degree + 2) * (degree - 1))
        lobe[degree] = 2.0 * np.pi * (fraction if half % 2 else -fraction)
    return lobe


def convolve(coefficients: Coefficients) -> Floats:
    """Return the irradiance that radiance gives, by the normal.

    coefficients: (K,) or (..., K, C), radiance L_lm. Returns A_l L_lm, irradiance; over pi it is what leaves a white
    surface. Raises InputError for another number of coefficients.
    """
    bands = bands_of(coefficients)
    return _scaled(coefficients, lambert_coefficients(bands)[degrees_and_orders(bands)[0]])


def from_3dgs(coefficients: Coefficients) -> Floats:
    """Return our coefficients of those in 3DGS files.

    coefficients: (K,) or (..., K, C), in the sign convention of 3DGS, the constant one first. Returns c = (-1)^m
    c_3dgs, in the same dtype. Raises InputError for another number of coefficients.
    """
    _, order = degrees_and_orders(bands_of(coefficients))
    return _scaled(coefficients, np.where(order % 2, -1, 1).astype(np.int8))


def quadrature(bands: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return directions and weights that integrate products of two functions of B bands exactly.

    bands: B, from 1 up. Returns directions: (N, 3) float64, unit vectors, N = B (2 B - 1); weights: (N,) float64, solid
    angles, sr.

    Gauss-Legendre in z times equal steps around it.
    """
    z, weight = np.polynomial.legendre.leggauss(bands)
    angle = 2.0 * np.pi * np.arange(2 * bands - 1) / (2 * bands - 1)
    z, angle = (grid.ravel() for grid in np.meshgrid(z, angle, indexing="ij"))
    radius = np.sqrt(1.0 - z * z)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
    return directions, np.repeat(weight * (2 * np.pi / (2 * bands - 1)), 2 * bands - 1)


def _evaluate_block(xyz: Floats, bands: int) -> Floats:
    """(3, N) directions -> (K, N): for each order m up the degrees, then on to the next power of x + i y."""
    x, y, z = xyz
    values = np.zeros((bands * bands, len(x)), xyz.dtype)
    real, imaginary = np.ones_like(x), np.zeros_like(x)
    sectoral = math.sqrt(0.25 / math.pi)  # normalisation of degree l = m
    for m in range(bands):
        below, polar = np.zeros_like(x), np.full_like(x, sectoral)
        for degree in range(m, bands):
            center = degree * (degree + 1)
            values[center - m] = polar * imaginary
            values[center + m] = polar * real  # after -m: for m = 0 the two are the same row
            up = degree + 1
            a = math.sqrt((4 * up * up - 1) / (up * up - m * m))
            b = math.sqrt((degree * degree - m * m) / (4 * degree * degree - 1)) if degree > m else 0.0
            below, polar = polar, a * (z * polar - b * below)
        real, imaginary = x * real - y * imaginary, x * imaginary + y * real
        sectoral *= math.sqrt((2 * m + 3) / (2 * m + 2)) * (math.sqrt(2.0) if m == 0 else 1.0)
    return values


def _scaled(coefficients: Coefficients, factor: NDArray[np.float64]) -> Coefficients:
    """Coefficients with each SH index multiplied by its factor (K,), along the SH axis."""
    return coefficients * (factor if np.ndim(coefficients) == 1 else factor[:, None])
