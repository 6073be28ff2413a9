"""The projection of a lat-long environment onto spherical harmonics."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance

from .harmonics import MAX_BANDS, check_bands, degrees_and_orders, evaluate, rotation_matrix

_ROW_NODES = 24  # Gauss-Legendre nodes a row: degree 10 over half a turn (an image of one row) to 1e-15

_Y_POLAR = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # to (z, x, y): the polar axis is y


def project_latlong(image: Radiance, bands: int) -> NDArray[np.float64]:
    """Project a lat-long environment onto the basis.

    image: (H, W, 3), linear radiance, canonical lat-long: row 0 is +y, the centre looks at +z. bands: B, from 1 to
    `MAX_BANDS`. Returns (K, 3) float64: radiance coefficients. Raises InputError for bands outside 1..10.

    Texels are patches of constant radiance. The basis is integrated over the area of each: in closed form along the
    row, by Gauss-Legendre down the column. So the result does not depend on the resolution at which the same patches
    are stored.
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
