"""The spherical harmonics of splat files, with the signs of 3DGS."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

SH_C0 = float(np.sqrt(1 / (4 * np.pi)))
DEGREE_OF_COEFFICIENTS = {(degree + 1) ** 2: degree for degree in range(4)}


def sh_basis_3dgs(directions: NDArray[Any], degree: int) -> NDArray[Any]:
    """Evaluate the real orthonormal spherical harmonics with the signs of 3DGS files, (-1)^m.

    directions: (N, 3), unit vectors. degree: 0 to 3. Returns (N, (degree + 1)^2): in the dtype of `directions`, index l
    (l + 1) + m.

    Source: Sloan, "Stupid Spherical Harmonics Tricks" (2008), appendix A2, with odd m negated.
    """
    x, y, z = directions.T
    root = [float(np.sqrt(k / np.pi)) for k in (3 / 4, 15 / 4, 5 / 16, 15 / 16, 35 / 32, 105 / 4, 21 / 32, 7 / 16)]
    c1, c2, c20, c22, c33, c32, c31, c30 = root
    basis = [np.full_like(x, SH_C0)]
    if degree > 0:
        basis += [-c1 * y, c1 * z, -c1 * x]
    if degree > 1:
        basis += [c2 * x * y, -c2 * y * z, c20 * (3 * z * z - 1), -c2 * x * z, c22 * (x * x - y * y)]
    if degree > 2:
        basis += [-c33 * y * (3 * x * x - y * y), c32 * x * y * z, -c31 * y * (5 * z * z - 1)]
        basis += [c30 * z * (5 * z * z - 3), -c31 * x * (5 * z * z - 1)]
        basis += [c32 / 2 * z * (x * x - y * y), -c33 * x * (x * x - 3 * y * y)]
    return np.stack(basis, axis=-1)
