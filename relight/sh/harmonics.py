"""Spherical harmonics: evaluation, projection of an environment, rotation, Lambert's lobe, conversions.

Basis: real, orthonormal, all-positive (no Condon-Shortley phase). Index i = l (l + 1) + m, so that the first
four are constants times 1, y, z, x. B bands are K = B^2 coefficients, in arrays of shape (K,) or (..., K, C),
with the SH axis before the colour axis and any others before both.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Coefficients, Floats
from splat2mesh.base.errors import InputError

MAX_BANDS = 10
_BLOCK = 8192  # directions evaluated at once: the working set of the recurrence stays in the cache
_ROW_NODES = 24  # Gauss-Legendre nodes a row: degree 10 over half a turn (an image of one row) to 1e-15
_Y_POLAR = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # to (z, x, y): the polar axis is y


def check_bands(bands: int) -> int:
    """Return `bands` as an int. Raises InputError unless it is a whole number from 1 to `MAX_BANDS`."""
    if bands != int(bands) or not 1 <= bands <= MAX_BANDS:
        raise InputError(f"`bands` must be a whole number from 1 to {MAX_BANDS}, found {bands}")
    return int(bands)


def bands_of(coefficients: NDArray) -> int:
    """Number of bands B of (K,) or (..., K, C) coefficients. Raises InputError unless K is 1, 4 ... 100."""
    shape = np.shape(coefficients)
    count = shape[-2:][0] if shape else 0
    bands = math.isqrt(count)
    if bands * bands != count or not 1 <= bands <= MAX_BANDS:
        raise InputError(f"SH coefficients must be (..., K, C) with K = 1, 4, 9 ... 100, found shape {shape}")
    return bands


def degrees_and_orders(bands: int) -> tuple[NDArray, NDArray]:
    """Degree l and order m of every coefficient: two (K,) int arrays."""
    degree = np.repeat(np.arange(bands), 2 * np.arange(bands) + 1)
    return degree, np.arange(bands * bands) - degree * (degree + 1)


def evaluate(
    directions: NDArray,  # (N, 3) unit vectors, scene frame
    bands: int,
) -> NDArray:
    """Values of the basis, (N, K), in the dtype of the directions (float64 for integers).

    Source: the normalised recurrence of the associated Legendre functions (Press et al., Numerical Recipes,
    3rd ed., 6.7), with sin^m carried by the powers of x + i y, so that the poles need no care.
    """
    bands = check_bands(bands)
    directions = np.asarray(directions)
    if not np.issubdtype(directions.dtype, np.floating):
        directions = directions.astype(np.float64)
    if directions.ndim != 2 or directions.shape[1] != 3:
        raise InputError(f"directions must have shape (N, 3), found {directions.shape}")
    values = np.zeros((len(directions), bands * bands), directions.dtype)
    for start in range(0, len(directions), _BLOCK):
        block = slice(start, start + _BLOCK)
        values[block] = _evaluate_block(np.ascontiguousarray(directions[block].T), bands).T
    return values


def project_latlong(
    image: NDArray,  # (H, W, 3) linear radiance, canonical lat-long: row 0 is +y, the centre looks at +z
    bands: int,
) -> NDArray:
    """Coefficients (K, 3) float64 of a lat-long environment whose texels are patches of constant radiance.

    The basis is integrated over the area of each texel: in closed form along the row, by Gauss-Legendre down
    the column. So the result does not depend on the resolution at which the same patches are stored.
    """
    bands = check_bands(bands)
    height, width = image.shape[:2]
    order = np.arange(1 - bands, bands)
    longitude = np.pi * (1.0 - 2.0 * (np.arange(width) + 0.5) / width)
    angle = np.abs(order) * longitude[:, None]
    # The integral of cos(m lon) over a texel of width w is its value at the centre times 2 sin(m w / 2) / m.
    azimuthal = np.where(order < 0, np.sin(angle), np.cos(angle)) * np.sinc(order / width) * (2 * np.pi / width)
    polar = _polar_integrals(height, bands)

    coefficients = np.zeros((bands * bands, image.shape[2]))
    _, m = degrees_and_orders(bands)
    rows = max(1, 2**20 // width)  # about a million texels in float64 at a time
    for start in range(0, height, rows):
        texels = np.asarray(image[start : start + rows], np.float64).transpose(0, 2, 1)
        by_order = (texels @ azimuthal)[:, :, m + bands - 1]
        coefficients += np.einsum("hk,hck->kc", polar[start : start + rows], by_order)
    return _y_polar_basis(bands).T @ coefficients


def rotation_matrix(
    rotation: NDArray,  # (3, 3) proper rotation, dst_from_src
    bands: int,
) -> NDArray:
    """The (K, K) float64 orthogonal, band-diagonal matrix M of a rotation R: Y(R d) = M Y(d).

    M also rotates what is described: M c are the coefficients of L(R^-1 d) when c are those of L(d).
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


def rotate(coefficients: NDArray, rotation: NDArray) -> NDArray:
    """Coefficients, same shape, of the environment turned by an active rotation: (3, 3) matrix, any axis."""
    return rotation_matrix(rotation, bands_of(coefficients)) @ coefficients


def lambert_coefficients(bands: int) -> NDArray:
    """Lambert's lobe A_l, (B,) float64: pi, 2 pi / 3, pi / 4, 0 ... (Ramamoorthi & Hanrahan 2001)."""
    lobe = np.zeros(check_bands(bands))
    lobe[:2] = [np.pi, 2.0 * np.pi / 3.0][: len(lobe)]
    for degree in range(2, len(lobe), 2):
        half = degree // 2
        fraction = math.comb(degree, half) / 2**degree / ((degree + 2) * (degree - 1))
        lobe[degree] = 2.0 * np.pi * (fraction if half % 2 else -fraction)
    return lobe


def convolve(coefficients: NDArray) -> NDArray:
    """Irradiance coefficients A_l L_lm, same shape, of radiance; over pi: what leaves a white surface."""
    bands = bands_of(coefficients)
    return _scaled(coefficients, lambert_coefficients(bands)[degrees_and_orders(bands)[0]])


def from_3dgs(coefficients: NDArray) -> NDArray:
    """Our coefficients, same shape and dtype, of those in 3DGS files (dc first): c = (-1)^m c_3dgs."""
    _, order = degrees_and_orders(bands_of(coefficients))
    return _scaled(coefficients, np.where(order % 2, -1, 1).astype(np.int8))


def to_3dgs(coefficients: NDArray) -> NDArray:
    """Coefficients for 3DGS files, of ours: the change of sign of `from_3dgs`, which is its own inverse."""
    return from_3dgs(coefficients)


def quadrature(bands: int) -> tuple[NDArray, NDArray]:
    """Directions (N, 3) and weights (N,) in steradians that integrate products of two functions of B bands.

    Gauss-Legendre in z times equal steps around it: N = B (2 B - 1).
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


def _polar_integrals(height: int, bands: int) -> NDArray[np.float64]:
    """(H, K): the latitude factor of every basis function about y, integrated over each row with its area."""
    node, weight = np.polynomial.legendre.leggauss(_ROW_NODES)
    colatitude = np.pi * (np.arange(height)[:, None] + 0.5 + 0.5 * node) / height
    sine = np.sin(colatitude)
    # At azimuth 0 every cos(m lon) is 1: the basis functions of m >= 0 are their latitude factors there.
    meridian = np.stack([sine, np.zeros_like(sine), np.cos(colatitude)], axis=-1)
    degree, order = degrees_and_orders(bands)
    factors = evaluate(meridian.reshape(-1, 3), bands)[:, degree * (degree + 1) + np.abs(order)]
    area = sine * weight * (0.5 * np.pi / height)
    return np.einsum("hn,hnk->hk", area, factors.reshape(height, _ROW_NODES, -1))


@lru_cache(MAX_BANDS)
def _y_polar_basis(bands: int) -> NDArray[np.float64]:
    """(K, K): coefficients about the polar axis y, of ours."""
    return rotation_matrix(_Y_POLAR, bands)


def _scaled(coefficients: Coefficients, factor: NDArray[np.float64]) -> Coefficients:
    """Coefficients with each SH index multiplied by its factor (K,), along the SH axis."""
    return coefficients * (factor if np.ndim(coefficients) == 1 else factor[:, None])
