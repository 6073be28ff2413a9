"""The transfer of the linear part of a vertex's visibility, in closed form: see `sampling`."""

import math

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices

from .sampling import legendre_factors


def add_model(
    normals: NDArray[np.float32],  # (V, 3) float32, unit
    model: NDArray[np.float32],  # (V, 4) float32: a, b
    rest: NDArray[np.float32],  # (V, K) float32
    transfer: NDArray[np.float32],  # (V, K) float32: unoccluded A on entry, shadowed on return
) -> None:
    """Transfer of the visibility a + b . d about every normal, plus the rest.

    T = a A + 2 k_l (b . n) Y(n) + k_l (b . grad) Y(n) + rest, k_l = integral of u^2 P_l(u) over 0..1: the lobes of
    cos^2 along the normal and, across it, of the gradient of cos^2 / 2 (Funk-Hecke).
    """
    bands = math.isqrt(rest.shape[1])
    in_slices(_add_model, len(normals), normals, model, rest, legendre_factors(bands), squared_lobe(bands), transfer)


def squared_lobe(bands: int) -> NDArray[np.float32]:
    """Integrals of u^2 P_l(u) over u = 0..1 by degree l: (B,) float32."""
    nodes, weights = np.polynomial.legendre.leggauss(bands // 2 + 2)  # exact to degree 2 * nodes - 1 >= l + 2
    nodes, weights = (nodes + 1.0) / 2.0, weights / 2.0
    return np.array(
        [weights @ (nodes**2 * np.polynomial.legendre.Legendre.basis(degree)(nodes)) for degree in range(bands)],
        np.float32,
    )


@kernel
def _add_model(
    begin: int,
    end: int,
    normals: NDArray[np.float32],
    model: NDArray[np.float32],
    rest: NDArray[np.float32],
    norms: NDArray[np.float32],
    squared: NDArray[np.float32],
    transfer: NDArray[np.float32],
) -> None:
    for v in range(begin, end):
        for k in range(transfer.shape[1]):
            transfer[v, k] = transfer[v, k] * model[v, 0] + rest[v, k]
        add_lobes(v, normals, np.float32(0), model, norms, squared, squared, transfer)


@kernel
def add_lobes(
    v: int,
    normals: NDArray[np.float32],
    scale: np.float32,
    model: NDArray[np.float32],
    norms: NDArray[np.float32],
    lobe: NDArray[np.float32],
    squared: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Add to row v of `out`: scale lobe_l Y(n) + 2 k_l (b . n) Y(n) + k_l (b . grad) Y(n); see `add_model`."""
    bx, by, bz = model[v, 1], model[v, 2], model[v, 3]
    if bx == 0 and by == 0 and bz == 0 and scale == 0:
        return
    x, y, z = normals[v, 0], normals[v, 1], normals[v, 2]
    along = bx * x + by * y + bz * z
    dx, dy, dz = bx - along * x, by - along * y, bz - along * z
    # The recurrence once more, each quantity beside its derivative along the tangent (dx, dy, dz).
    real, imaginary, d_real, d_imaginary = np.float32(1), np.float32(0), np.float32(0), np.float32(0)
    for m in range(len(lobe)):
        polar, below, d_polar, d_below = norms[m, m, 0], np.float32(0), np.float32(0), np.float32(0)
        for degree in range(m, len(lobe)):
            if degree > m:
                up, down = norms[degree, m, 0], norms[degree, m, 1]
                value = up * (z * polar - down * below)
                d_value = up * (dz * polar + z * d_polar - down * d_below)
                below, polar, d_below, d_polar = polar, value, d_polar, d_value
            center, gradient = degree * (degree + 1), squared[degree]
            level = scale * lobe[degree] + np.float32(2) * along * gradient
            out[v, center + m] += level * polar * real + gradient * (d_polar * real + polar * d_real)
            if m > 0:
                turned = d_polar * imaginary + polar * d_imaginary
                out[v, center - m] += level * polar * imaginary + gradient * turned
        d_real, d_imaginary, real, imaginary = (
            dx * real + x * d_real - dy * imaginary - y * d_imaginary,
            dx * imaginary + x * d_imaginary + dy * real + y * d_real,
            x * real - y * imaginary,
            x * imaginary + y * real,
        )
