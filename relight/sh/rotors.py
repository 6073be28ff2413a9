"""Rotors: rotations in four numbers, their composition, and their action on light.

A rotor is R = cos(a/2) - sin(a/2) B for a turn by the angle a in the plane of the unit bivector B; it takes x to
R x ~R. Arrays (..., 4) hold its coefficients of (1, e12, e13, e23), float64, in the scene frame; leading axes
broadcast. Every length but 0 is accepted and means the same rotation, as do R and -R. A unit quaternion
w + x i + y j + z k is (w, -z, y, -x).
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Coefficients, Directions, Floats, Quaternions
from splat2mesh.base.errors import InputError

from . import harmonics

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
IDENTITY.setflags(write=False)

_ROTATION_TOLERANCE = 1e-6  # of a matrix, as in harmonics.rotation_matrix: a product of a few float32 rotations passes
_FROM_QUAT = [0, 3, 2, 1]  # (1, e12, e13, e23) stand for (w, z, y, x) ...
_QUAT_SIGN = np.array([1.0, -1.0, 1.0, -1.0])  # ... with these signs; both are their own inverses
_Y_TO_Z = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # Rx(+90)


def from_axis_angle(
    axis: ArrayLike,  # (..., 3), any length but 0
    angle_rad: ArrayLike,  # (...), right-handed about the axis
) -> NDArray[np.float64]:
    """The rotor (..., 4) of a turn about an axis. Raises InputError for an axis without a direction."""
    axis, half = unit_vectors(axis, "an axis"), 0.5 * np.asarray(angle_rad, np.float64)[..., None]
    scalar, vector = np.broadcast_arrays(np.cos(half), np.sin(half) * axis)
    return from_quat(np.concatenate([scalar[..., :1], vector], axis=-1))


def from_quat(quat_wxyz: Quaternions) -> NDArray[np.float64]:
    """The unit rotor (..., 4) of a quaternion w x y z, (..., 4) of any length but 0."""
    return normalise(np.asarray(quat_wxyz, np.float64)[..., _FROM_QUAT] * _QUAT_SIGN)


def to_quat(rotor: Floats) -> NDArray[np.float64]:
    """The unit quaternion w x y z, (..., 4), of a rotor."""
    return (normalise(rotor) * _QUAT_SIGN)[..., _FROM_QUAT]


def from_matrix(
    rotation: Floats,  # (..., 3, 3), dst_from_src
) -> NDArray[np.float64]:
    """The unit rotor (..., 4) of a rotation matrix, with its scalar not below 0.

    4 q q^T of the quaternion q is linear in the matrix; its row with the largest diagonal element, at least 1,
    is free of cancellation (Shepperd, "Quaternion from Rotation Matrix", 1978).
    Raises InputError unless every matrix is a proper rotation, to 1e-6.
    """
    m = np.asarray(rotation, np.float64)
    if m.shape[-2:] != (3, 3):
        raise InputError(f"rotation matrices must have shape (..., 3, 3), found {m.shape}")
    defect = np.abs(m @ np.swapaxes(m, -1, -2) - np.eye(3)).max(axis=(-2, -1))
    with np.errstate(invalid="ignore"):
        improper = ~(defect < _ROTATION_TOLERANCE) | (np.linalg.det(m) < 0)
    if improper.any():
        raise InputError(f"expected rotation matrices, found {m[improper][0].tolist()}")
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    # fmt: off
    rows = np.stack([
        1 + xx + yy + zz, wx, wy, wz,
        wx, 1 + xx - yy - zz, xy, xz,
        wy, xy, 1 - xx + yy - zz, yz,
        wz, xz, yz, 1 - xx - yy + zz,
    ], axis=-1).reshape(*m.shape[:-2], 4, 4)
    # fmt: on
    largest = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)[..., None, None]
    quat = np.take_along_axis(rows, largest, axis=-2)[..., 0, :]
    return from_quat(np.where(quat[..., :1] < 0, -quat, quat))


def to_matrix(rotor: Floats) -> NDArray[np.float64]:
    """The rotation matrix (..., 3, 3), dst_from_src, of a rotor."""
    w, x, y, z = np.moveaxis(to_quat(rotor), -1, 0)
    # fmt: off
    rows = np.stack([
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ], axis=-1)
    # fmt: on
    return rows.reshape(*w.shape, 3, 3)


def taking_up_to(
    normals: Directions,  # (..., 3), any length but 0
) -> NDArray[np.float64]:
    """The rotor (..., 4) that takes +y to a normal along the great circle: 1 + n e2, normalised; e13 stays 0.

    Every half turn in a plane with e2 takes +y to -y. At exactly (0, -1, 0) it is Rx(180), the limit for normals
    that lean towards +z; towards other sides the limits differ, as they must. Accurate on any lean above 0.
    Raises InputError for a normal without a direction.
    """
    x, y, z = np.moveaxis(unit_vectors(normals, "a normal"), -1, 0)
    lean = np.hypot(x, z)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Below the horizon 1 + y cancels. As (1 + y) (1 - y) = lean^2, scaling by (1 - y) / lean repairs it.
        scale = np.where(y < 0, (1.0 - y) / lean, 1.0)
        rotor = np.stack([np.where(y < 0, lean, 1.0 + y), scale * x, np.zeros_like(x), -scale * z], axis=-1)
    return normalise(np.where(((y < 0) & (lean == 0))[..., None], [0.0, 0.0, 0.0, -1.0], rotor))


def multiply(a: Floats, b: Floats) -> NDArray[np.float64]:
    """The product a b, (..., 4): the rotation b, then a."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    a0, a1, a2, a3 = np.moveaxis(a, -1, 0)
    b0, b1, b2, b3 = np.moveaxis(b, -1, 0)
    # fmt: off
    return np.stack([
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 - a2 * b3 + a3 * b2,
        a0 * b2 + a2 * b0 + a1 * b3 - a3 * b1,
        a0 * b3 + a3 * b0 - a1 * b2 + a2 * b1,
    ], axis=-1)
    # fmt: on


def reverse(rotor: Floats) -> NDArray[np.float64]:
    """~R, (..., 4): of a unit rotor the inverse."""
    return np.asarray(rotor, np.float64) * [1.0, -1.0, -1.0, -1.0]


def inverse(rotor: Floats) -> NDArray[np.float64]:
    """R^-1, (..., 4): ~R over the square of the length. Raises InputError for a rotor of length 0."""
    rotor = _checked(rotor)
    return reverse(rotor) / np.sum(rotor * rotor, axis=-1, keepdims=True)


def normalise(rotor: Floats) -> NDArray[np.float64]:
    """The rotor (..., 4) with length 1: after each product of a long chain it keeps the chain from drifting.

    Raises InputError for a rotor that is zero or not finite.
    """
    rotor = _checked(rotor)
    # Scaled by a power of two first, which is exact: squares may neither overflow nor vanish.
    rotor = np.ldexp(rotor, -np.frexp(np.abs(rotor).max(axis=-1, keepdims=True))[1])
    return rotor / np.linalg.norm(rotor, axis=-1, keepdims=True)


def exp(
    bivector: Floats,  # (..., 3): coefficients of e12, e13, e23
) -> NDArray[np.float64]:
    """The unit rotor (..., 4) e^b = cos |b| + sin |b| b / |b|: a turn by 2 |b|."""
    bivector = np.asarray(bivector, np.float64)
    size = np.linalg.norm(bivector, axis=-1, keepdims=True)
    return np.concatenate([np.cos(size), np.sinc(size / np.pi) * bivector], axis=-1)


def log(rotor: Floats) -> NDArray[np.float64]:
    """The bivector b (..., 3) with e^b = R / |R| and |b| <= pi; for -1, where any plane serves, -pi e23."""
    rotor = normalise(rotor)
    scalar, plane = rotor[..., :1], rotor[..., 1:]
    size = np.linalg.norm(plane, axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        bivector = np.arctan2(size, scalar) / size * plane
    return np.where(size > 0, bivector, np.where(scalar < 0, [0.0, 0.0, -np.pi], 0.0))


def rotate(
    coefficients: Coefficients,  # (K,) with one rotor, or (..., K, C), in the basis of relight.sh
    rotor: Floats,  # (4,) or (..., 4)
) -> NDArray[np.float64]:
    """SH coefficients, float64, of what an active rotation turns: L(d) becomes L(R^-1 d), about any axis.

    With u = w + i z = cos(b/2) e^(i (a+c)/2) and v = y - i x = sin(b/2) e^(i (a-c)/2) of its quaternion the rotor
    is Rz(a) Ry(b) Rz(c), and Ry is Rz in the basis turned by a constant: three turns of the pairs (m, -m) and
    two constant products. Where u or v is 0 its phase is free and cancels. Leading axes broadcast.
    Faster than the quadrature of harmonics.rotation_matrix, by what `scripts/bench cga` prints, and as exact.
    Raises InputError for shapes that do not fit and for a rotor that is zero or not finite.
    """
    coefficients = np.asarray(coefficients, np.float64)
    bands = harmonics.bands_of(coefficients)
    rotor = _checked(rotor)
    if coefficients.ndim == 1:
        if rotor.ndim != 1:
            raise InputError(f"(K,) coefficients take one rotor (4,), found {rotor.shape}; give them as (K, 1)")
        return rotate(coefficients[:, None], rotor)[:, 0]
    try:
        np.broadcast_shapes(coefficients.shape[:-2], rotor.shape[:-1])
    except ValueError:
        message = f"coefficients {coefficients.shape} and rotors {rotor.shape} do not share their leading axes"
        raise InputError(message) from None
    scalar, e12, e13, e23 = np.moveaxis(rotor, -1, 0)
    half_sum, half_difference = np.arctan2(-e12, scalar), np.arctan2(e23, e13)
    tilt = 2.0 * np.arctan2(np.hypot(e13, e23), np.hypot(scalar, e12))
    basis = _z_from_y_basis(bands)
    turned = _about_z(coefficients, half_sum - half_difference, bands)
    turned = basis.T @ _about_z(basis @ turned, tilt, bands)
    return _about_z(turned, half_sum + half_difference, bands)


def rotation_matrix(rotor: Floats, bands: int) -> NDArray[np.float64]:
    """The (..., K, K) float64 matrix M with Y(R d) = M Y(d), as harmonics.rotation_matrix gives it, from a rotor."""
    return rotate(np.eye(harmonics.check_bands(bands) ** 2), rotor)


def unit_vectors(vectors: ArrayLike, what: str) -> NDArray[np.float64]:
    """(..., 3) float64 of length 1. Raises InputError, which names `what`, for one without a direction."""
    vectors = np.asarray(vectors, np.float64)
    if vectors.shape[-1:] != (3,):
        raise InputError(f"{what} must have shape (..., 3), found {vectors.shape}")
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if not ((length > 0) & np.isfinite(length)).all():
        raise InputError(f"{what} must be finite and longer than 0, found one that is not")
    return vectors / length


def _checked(rotor: ArrayLike) -> NDArray[np.float64]:
    """The rotor as float64. Raises InputError unless it is (..., 4), finite and not 0."""
    rotor = np.asarray(rotor, np.float64)
    if rotor.shape[-1:] != (4,):
        raise InputError(f"rotors must have shape (..., 4), found {rotor.shape}")
    bad = ~(np.isfinite(rotor).all(axis=-1) & rotor.any(axis=-1))
    if bad.any():
        raise InputError(f"rotors must be finite and not 0, found {rotor[bad][0].tolist()}")
    return rotor


def _about_z(coefficients: Coefficients, angle_rad: ArrayLike, bands: int) -> NDArray[np.float64]:
    """(..., K, C) turned by Rz(angle), angles (...): the pairs (m, -m) turn by m times the angle."""
    degree, order = harmonics.degrees_and_orders(bands)
    angle = order * np.asarray(angle_rad)[..., None]
    mirrored = coefficients[..., degree * (degree + 1) - order, :]
    return coefficients * np.cos(angle)[..., None] - mirrored * np.sin(angle)[..., None]


@lru_cache(harmonics.MAX_BANDS)
def _z_from_y_basis(bands: int) -> NDArray[np.float64]:
    """(K, K): the rotation of coefficients that takes +y to +z."""
    return harmonics.rotation_matrix(_Y_TO_Z, bands)
