"""Conformal geometric algebra Cl(4,1): points, planes and motors as 32 numbers.

Multivectors are arrays (..., 32) in the order of `BLADES`: grade by grade, within a grade lexicographic: 1, e1 ... e5,
e12, e13 ... e12345. e1, e2, e3 are the axes of the scene frame; e4 = e+ squares to +1, e5 = e- to -1. The
null vectors are e0 = (e5 - e4) / 2, the origin, and einf = e4 + e5, with e0 . einf = -1.

A motor is M = T R, a rotation and then a translation t: R is a rotor of `relight.sh.rotors`, T = 1 - t einf / 2, and
M X ~M moves whatever X stands for. Of its 32 numbers 12 can differ from 0 and 8 are independent, since
every e_i einf appears as an equal pair: 1, e12, e13, e23, (e14, e15), (e24, e25), (e34, e35), (e1234, e1235).
"""

from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Directions, Floats, Points
from splat2mesh.base.errors import InputError
from splat2mesh.base.kernels import kernel

from . import rotors
from .normals import unit_normals

BLADES = tuple(blade for grade in range(6) for blade in combinations((1, 2, 3, 4, 5), grade))
"""Basis blades as tuples of the indices of their vectors: the meaning of the last axis of a multivector."""

EUCLIDEAN = slice(1, 4)
"""The coefficients of e1, e2, e3: of a plane its normal."""

ROTOR = [BLADES.index(blade) for blade in ((), (1, 2), (1, 3), (2, 3))]
"""Indices of the four numbers of a rotor."""

_MOMENT = [BLADES.index(blade) for blade in ((1, 4), (2, 4), (3, 4), (1, 2, 3, 4))]
_MOMENT_TWIN = [BLADES.index(blade) for blade in ((1, 5), (2, 5), (3, 5), (1, 2, 3, 5))]

_REVERSAL = np.array([(-1.0) ** (len(blade) * (len(blade) - 1) // 2) for blade in BLADES])

FLOAT32_MAX = float(np.finfo(np.float32).max)

_MOTOR_TOLERANCE = 1e-4  # of the largest number: products of a few float32 motors pass, other multivectors do not


def _product_tables() -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Partner and sign, (32, 32) each: blade i times blade partner[i, k] is sign[i, k] times blade k."""
    bits = [sum(1 << (vector - 1) for vector in blade) for blade in BLADES]
    partner, sign = np.zeros((32, 32), int), np.zeros((32, 32))
    for i, a in enumerate(bits):
        for k, product in enumerate(bits):
            b = a ^ product
            # Each vector of the second factor moves left past those of the first that come after it.
            swaps = sum((a >> (vector + 1)).bit_count() for vector in range(5) if b >> vector & 1)
            partner[i, k] = bits.index(b)
            sign[i, k] = (-1.0) ** (swaps + (a & b & 16 > 0))
    return partner, sign


_PARTNER, _SIGN = _product_tables()


def vertex_motors(
    points: Points,  # (V, 3), scene frame
    normals: Directions,  # (V, 3), scene frame, any length
) -> NDArray[np.float32]:
    """The motors T R of vertices, (V, 32) float32: R takes +y to the normal, T the origin to the point.

    Normals are used as `unit_normals` returns them (degenerate ones are +y, with a warning), R is
    `rotors.taking_up_to`: at exactly (0, -1, 0) Rx(180). Every number is the float64 one rounded once, so that
    points come back to 1.2e-7 of their length, whatever the offset from the origin, and normals to 2.4e-7. As R
    turns about a horizontal axis, e13 is always 0: 11 numbers can differ from 0, 7 are linearly independent.
    Raises InputError for shapes that do not fit and for points that are not finite.
    Source: Geronikolakis et al., "Neural-GASh", arXiv:2507.13917, 2025: a translator times that rotor.
    """
    points, normals = np.asarray(points), np.asarray(normals)
    if points.ndim != 2 or points.shape[1] != 3 or normals.shape != points.shape:
        message = f"points and normals must both have shape (V, 3), found {points.shape} and {normals.shape}"
        raise InputError(message)
    if points.dtype not in (np.float32, np.float64):  # those that the kernel is compiled for
        points = points.astype(np.float64)
    motors = np.zeros((len(points), 32), np.float32)
    broken = _write_vertex_motors(points, unit_normals(normals), motors)
    if broken:
        raise InputError(f"{broken} of {len(points)} points are not finite: remove these vertices first")
    return motors


def motor(
    rotor: Floats,  # (..., 4) of relight.rotors
    translation: Floats,  # (..., 3), scene frame
) -> NDArray[np.float64]:
    """The motor T R, (..., 32) float64: the rotation, then the translation. Raises InputError as `normalise`."""
    s, e12, e13, e23 = np.moveaxis(rotors.normalise(rotor), -1, 0)
    x, y, z = np.moveaxis(_vectors(translation), -1, 0)
    # t R, a vector and a trivector; M = R - t R einf / 2.
    parts = [x * s - y * e12 - z * e13, y * s + x * e12 - z * e23, z * s + x * e13 + y * e23]
    moment = np.stack([*parts, x * e23 - y * e13 + z * e12], axis=-1)
    motors = np.zeros((*moment.shape[:-1], 32))
    motors[..., ROTOR] = np.stack([s, e12, e13, e23], axis=-1)
    motors[..., _MOMENT] = motors[..., _MOMENT_TWIN] = -0.5 * moment
    return motors


def rotor_and_translation(motors: Floats) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The unit rotor (..., 4) and the translation (..., 3) of motors (..., 32), float64: undoes `motor`.

    Raises InputError for a multivector that is no motor, to 1e-4 of its largest number.
    """
    motors = _multivectors(motors)
    rotor, moment = motors[..., ROTOR], motors[..., _MOMENT]
    length = np.linalg.norm(rotor, axis=-1)
    others = np.abs(np.delete(motors, [*ROTOR, *_MOMENT, *_MOMENT_TWIN], axis=-1)).max(axis=-1)
    others = np.maximum(others, np.abs(moment - motors[..., _MOMENT_TWIN]).max(axis=-1))
    with np.errstate(divide="ignore", invalid="ignore"):
        s, e12, e13, e23 = np.moveaxis(rotor / length[..., None], -1, 0)
        x, y, z, xyz = np.moveaxis(moment / length[..., None], -1, 0)
        # -2 (moment) ~R: its vector part is t, its trivector part 0 for a motor.
        vector = [x * s + y * e12 + z * e13 + xyz * e23]
        vector += [y * s - x * e12 + z * e23 - xyz * e13, z * s - x * e13 - y * e23 + xyz * e12]
        others = np.maximum(others, np.abs(xyz * s - x * e23 + y * e13 - z * e12) * length)
        bad = ~(others <= _MOTOR_TOLERANCE * np.abs(motors).max(axis=-1)) | ~(length > 0)
    if bad.any():
        raise InputError(f"{np.sum(bad)} of {bad.size} multivectors are not motors: expected rotation and translation")
    return np.stack([s, e12, e13, e23], axis=-1), -2.0 * np.stack(vector, axis=-1)


def inverse(motors: Floats) -> NDArray[np.float64]:
    """The motor (..., 32) float64 that undoes another: its reverse, normalised."""
    rotor, shift = rotor_and_translation(motors)
    back = rotors.reverse(rotor)
    return motor(back, -_turned(back, shift))


def to_matrix(motors: Floats) -> NDArray[np.float64]:
    """The 4x4 matrices (..., 4, 4) float64, dst_from_src on column vectors, of motors."""
    rotor, shift = rotor_and_translation(motors)
    matrices = np.zeros((*shift.shape[:-1], 4, 4))
    matrices[..., :3, :3], matrices[..., :3, 3], matrices[..., 3, 3] = rotors.to_matrix(rotor), shift, 1.0
    return matrices


def move(motors: Floats, points: Points) -> NDArray[np.float64]:
    """Points (..., 3) float64 moved by motors: down(apply(motors, up(points))), without the loss described in `up`."""
    rotor, shift = rotor_and_translation(motors)
    return _turned(rotor, _vectors(points)) + shift


def up(points: Points) -> NDArray[np.float64]:
    """Points (..., 3) as null vectors (..., 32) float64: x + |x|^2 / 2 einf + e0.

    In this basis the weight, 1, is the difference of two numbers of size |x|^2 / 2, and a sandwich rounds them: moved
    by `apply`, points are off by 1e-8 of their length at offsets of 1e3 and by 2% at 1e6; `move` has no such loss.
    """
    points = _vectors(points)
    half = 0.5 * np.sum(points * points, axis=-1)
    multivectors = np.zeros((*half.shape, 32))
    multivectors[..., EUCLIDEAN] = points
    multivectors[..., 4], multivectors[..., 5] = half - 0.5, half + 0.5
    return multivectors


def down(multivectors: Floats) -> NDArray[np.float64]:
    """Points (..., 3) float64 of null vectors (..., 32) of any weight: undoes `up`.

    Raises InputError for vectors of weight 0, points at infinity.
    """
    multivectors = _multivectors(multivectors)
    weight = multivectors[..., 5] - multivectors[..., 4]  # -X . einf
    if not weight.all():
        raise InputError(f"{np.sum(weight == 0)} of {weight.size} multivectors have no finite point: their weight is 0")
    return multivectors[..., EUCLIDEAN] / weight[..., None]


def plane(
    normals: Directions,  # (..., 3)
    distances: ArrayLike = 0.0,  # (...), from the origin along the normal
) -> NDArray[np.float64]:
    """Planes n . x = d as vectors n + d einf, (..., 32) float64: X lies on one where X . plane = 0.

    With d = 0 the plain vector n. Moved by a motor, its `EUCLIDEAN` part only turns, as a normal does.
    """
    normals = _vectors(normals)
    distances = np.asarray(distances, np.float64)
    multivectors = np.zeros((*np.broadcast_shapes(normals.shape[:-1], distances.shape), 32))
    multivectors[..., EUCLIDEAN] = normals
    multivectors[..., 4] = multivectors[..., 5] = distances
    return multivectors


def apply(motors: Floats, multivectors: Floats) -> NDArray[np.float64]:
    """The sandwich M X ~M, (..., 32) float64: X moved by a unit motor; leading axes broadcast."""
    return geometric_product(geometric_product(motors, multivectors), reverse(motors))


def geometric_product(a: Floats, b: Floats) -> NDArray[np.float64]:
    """The geometric product (..., 32) float64 of multivectors (..., 32); leading axes broadcast."""
    a, b = _multivectors(a), _multivectors(b)
    product = np.zeros((*np.broadcast_shapes(a.shape[:-1], b.shape[:-1]), 32))
    for blade in range(32):
        if a[..., blade].any():  # most blades of points and motors are empty
            product += a[..., blade, None] * (_SIGN[blade] * b[..., _PARTNER[blade]])
    return product


def reverse(multivectors: Floats) -> NDArray[np.float64]:
    """~X, (..., 32) float64: the order of all vectors reversed."""
    return _multivectors(multivectors) * _REVERSAL


def _turned(rotor: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors (..., 3) turned by rotors."""
    return np.einsum("...ij,...j->...i", rotors.to_matrix(rotor), vectors)


def _vectors(values: ArrayLike) -> NDArray[np.float64]:
    values = np.asarray(values, np.float64)
    if values.shape[-1:] != (3,):
        raise InputError(f"points and vectors must have shape (..., 3), found {values.shape}")
    return values


def _multivectors(values: ArrayLike) -> NDArray[np.float64]:
    values = np.asarray(values, np.float64)
    if values.shape[-1:] != (32,):
        raise InputError(f"multivectors must have shape (..., 32), found {values.shape}")
    return values


@kernel
def _write_vertex_motors(points: Points, normals: Directions, motors: NDArray[np.float32]) -> int:
    """The compiled twin of motor(rotors.taking_up_to(n), p), into zeros; returns how many points are not finite."""
    broken = 0
    for v in range(len(points)):
        x, y, z = np.float64(points[v, 0]), np.float64(points[v, 1]), np.float64(points[v, 2])
        nx, ny, nz = np.float64(normals[v, 0]), np.float64(normals[v, 1]), np.float64(normals[v, 2])
        if not abs(x) + abs(y) + abs(z) < FLOAT32_MAX:
            broken += 1
        square = nx * nx + nz * nz
        lean, length = np.sqrt(square), np.sqrt(square + ny * ny)  # the latter 1, up to rounding to float32
        if ny >= 0.0:
            s, e12, e23 = length + ny, nx, -nz
        elif lean > 0.0:
            scale = (length - ny) / lean
            s, e12, e23 = lean, scale * nx, -scale * nz
        else:
            s, e12, e23 = np.float64(0.0), np.float64(0.0), np.float64(-1.0)
        scale = 1.0 / np.sqrt(s * s + e12 * e12 + e23 * e23)
        s, e12, e23 = s * scale, e12 * scale, e23 * scale
        row = motors[v]
        row[0], row[6], row[10] = s, e12, e23
        row[8] = row[9] = -0.5 * (x * s - y * e12)
        row[11] = row[12] = -0.5 * (y * s + x * e12 - z * e23)
        row[13] = row[14] = -0.5 * (z * s + y * e23)
        row[26] = row[27] = -0.5 * (x * e23 + z * e12)
    return broken
