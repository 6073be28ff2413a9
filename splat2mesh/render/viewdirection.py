"""Spherical harmonics of the direction a splat is seen from, in the order and with the signs of 3DGS files."""

import math

from ..base.arrays import Floats
from ..base.kernels import kernel


@kernel
def harmonics_of_direction(x: float, y: float, z: float, count: int, out: Floats) -> None:
    """Real orthonormal harmonics of a unit direction, order l(l+1) + m, with the (-1)^m of 3DGS files."""
    out[0] = math.sqrt(1 / (4 * math.pi))
    if count > 1:
        c = math.sqrt(3 / (4 * math.pi))
        out[1], out[2], out[3] = -c * y, c * z, -c * x
    if count > 4:
        c = math.sqrt(15 / (4 * math.pi))
        out[4], out[5], out[7] = c * x * y, -c * y * z, -c * x * z
        out[6] = math.sqrt(5 / (16 * math.pi)) * (3 * z * z - 1)
        out[8] = c / 2 * (x * x - y * y)
    if count > 9:
        c1 = math.sqrt(21 / (32 * math.pi)) * (5 * z * z - 1)
        c2 = math.sqrt(105 / (16 * math.pi)) * z
        c3 = math.sqrt(35 / (32 * math.pi))
        out[9], out[15] = -c3 * y * (3 * x * x - y * y), -c3 * x * (x * x - 3 * y * y)
        out[10], out[14] = 2 * c2 * x * y, c2 * (x * x - y * y)
        out[11], out[13] = -c1 * y, -c1 * x
        out[12] = math.sqrt(7 / (16 * math.pi)) * z * (5 * z * z - 3)
