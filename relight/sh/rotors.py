"""Rotors: rotations in four numbers, and their action on light.

A rotor is R = cos(a/2) - sin(a/2) B for a turn by the angle a in the plane of the unit bivector B; it takes x to
R x ~R. Its four numbers are the coefficients of (1, e12, e13, e23), float64, in the scene frame. Every length but 0
means the same rotation, as do R and -R. A unit quaternion w + x i + y j + z k is (w, -z, y, -x).
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Coefficients, Floats
from splat2mesh.base.errors import InputError

from . import harmonics

_Y_TO_Z = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # Rx(+90)


def from_axis_angle(
    axis: ArrayLike,  # (3,), any length but 0
    angle_rad: float,  # right-handed about the axis
) -> NDArray[np.float64]:
    """The unit rotor (4,) of a turn about an axis."""
    axis = np.asarray(axis, np.float64)
    x, y, z = np.sin(0.5 * angle_rad) * (axis / np.linalg.norm(axis))
    rotor = np.array([np.cos(0.5 * angle_rad), -z, y, -x])
    return rotor / np.linalg.norm(rotor)


def rotate(
    coefficients: Coefficients,  # (..., K, C), in the basis of relight.sh
    rotor: Floats,  # (4,)
) -> NDArray[np.float64]:
    """SH coefficients, float64, of what an active rotation turns: L(d) becomes L(R^-1 d), about any axis.

    With u = w + i z = cos(b/2) e^(i (a+c)/2) and v = y - i x = sin(b/2) e^(i (a-c)/2) of its quaternion the rotor
    is Rz(a) Ry(b) Rz(c), and Ry is Rz in the basis turned by a constant: three turns of the pairs (m, -m) and
    two constant products. Where u or v is 0 its phase is free and cancels.
    Faster than the quadrature of harmonics.rotation_matrix, by what `scripts/bench cga` prints, and as exact.
    Raises InputError for another number of coefficients and for a rotor that is zero or not finite.
    """
    coefficients, rotor = np.asarray(coefficients, np.float64), np.asarray(rotor, np.float64)
    bands = harmonics.bands_of(coefficients)
    if rotor.shape != (4,) or not np.isfinite(rotor).all() or not rotor.any():
        raise InputError(f"a rotor must have shape (4,), be finite and not 0, found {rotor.tolist()}")
    scalar, e12, e13, e23 = rotor
    half_sum, half_difference = np.arctan2(-e12, scalar), np.arctan2(e23, e13)
    tilt = 2.0 * np.arctan2(np.hypot(e13, e23), np.hypot(scalar, e12))
    basis = _z_from_y_basis(bands)
    turned = _about_z(coefficients, half_sum - half_difference, bands)
    turned = basis.T @ _about_z(basis @ turned, tilt, bands)
    return _about_z(turned, half_sum + half_difference, bands)


def _about_z(coefficients: Coefficients, angle_rad: float, bands: int) -> NDArray[np.float64]:
    """(..., K, C) turned by Rz(angle): the pairs (m, -m) turn by m times the angle."""
    degree, order = harmonics.degrees_and_orders(bands)
    angle = order * angle_rad
    mirrored = coefficients[..., degree * (degree + 1) - order, :]
    return coefficients * np.cos(angle)[:, None] - mirrored * np.sin(angle)[:, None]


@lru_cache(harmonics.MAX_BANDS)
def _z_from_y_basis(bands: int) -> NDArray[np.float64]:
    """(K, K): the rotation of coefficients that takes +y to +z."""
    return harmonics.rotation_matrix(_Y_TO_Z, bands)
