"""Motors of vertices in conformal geometric algebra Cl(4,1): a turn and a shift as 32 numbers.

Multivectors are arrays (..., 32), grade by grade, within a grade lexicographic: 1, e1 ... e5, e12, e13 ... e12345.
e1, e2, e3 are the axes of the scene frame; e4 = e+ squares to +1, e5 = e- to -1. The null vector einf is e4 + e5.

A motor is M = T R, a rotation and then a translation t: R is a rotor of `relight.sh.rotors`, T = 1 - t einf / 2, and
M X ~M moves whatever X stands for. Of its 32 numbers 12 can differ from 0 and 8 are independent, since
every e_i einf appears as an equal pair: 1, e12, e13, e23, (e14, e15), (e24, e25), (e34, e35), (e1234, e1235).
"""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Points
from splat2mesh.base.errors import InputError

from .normals import unit_normals

FLOAT32_MAX = float(np.finfo(np.float32).max)


def vertex_motors(
    points: Points,  # (V, 3), scene frame
    normals: Directions,  # (V, 3), scene frame, any length
) -> NDArray[np.float32]:
    """The motors T R of vertices, (V, 32) float32: R takes +y to the normal, T the origin to the point.

    Normals are used as `unit_normals` returns them (degenerate ones are +y, with a warning). R is 1 + n e2, normalised,
    the turn along the great circle; at exactly (0, -1, 0), where every horizontal axis would serve, Rx(180), the
    limit for normals that lean towards +z. Every number is the float64 one rounded once, so that
    points come back to 1.2e-7 of their length, whatever the offset from the origin, and normals to 2.4e-7. As R
    turns about a horizontal axis, e13 is always 0: 11 numbers can differ from 0, 7 are linearly independent.
    Raises InputError for shapes that do not fit and for points that are not finite.
    Source: Geronikolakis et al., "Neural-GASh", arXiv:2507.13917, 2025: a translator times that rotor.
    """
    points, normals = np.asarray(points), np.asarray(normals)
    if points.ndim != 2 or points.shape[1] != 3 or normals.shape != points.shape:
        message = f"points and normals must both have shape (V, 3), found {points.shape} and {normals.shape}"
        raise InputError(message)
    broken = np.count_nonzero(~(np.abs(points).sum(axis=1, dtype=np.float64) < FLOAT32_MAX))
    if broken:
        raise InputError(f"{broken} of {len(points)} points are not finite: remove these vertices first")
    (x, y, z), (nx, ny, nz) = points.T.astype(np.float64), unit_normals(normals).T.astype(np.float64)
    lean = np.sqrt(nx * nx + nz * nz)
    length = np.sqrt(nx * nx + nz * nz + ny * ny)  # 1, up to rounding to float32
    # Below the horizon 1 + y of a normal cancels; as (1 + y) (1 - y) = lean^2, scaling by (1 - y) / lean repairs it.
    up, down = ny >= 0.0, (ny < 0.0) & (lean == 0.0)
    scale = np.where(up | down, 1.0, (length - ny) / np.where(lean > 0.0, lean, 1.0))
    rotor = np.stack([np.where(up, length + ny, lean), scale * nx, np.where(down, -1.0, -scale * nz)])
    s, e12, e23 = rotor / np.sqrt((rotor * rotor).sum(axis=0))
    motors = np.zeros((len(points), 32), np.float32)
    motors[:, [0, 6, 10]] = np.stack([s, e12, e23], axis=1)
    # The pairs of the moment -t R / 2: e14 and e15 to e1234 and e1235.
    moments = x * s - y * e12, y * s + x * e12 - z * e23, z * s + y * e23, x * e23 + z * e12
    for first, moment in zip((8, 11, 13, 26), moments, strict=True):
        motors[:, first] = motors[:, first + 1] = -0.5 * moment
    return motors
