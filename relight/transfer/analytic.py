"""Transfer without visibility: the closed form from the normal alone."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..sh import harmonics
from ..sh.normals import unit_normals


def analytic(
    normals: ArrayLike,  # (V, 3), scene frame, any length
    bands: int,
) -> NDArray[np.float32]:
    """Transfer of unoccluded white vertices: (V, K) float32, A_l / pi Y(n).

    Normals are used as `unit_normals` returns them. Raises InputError for bands outside 1..10.
    Source: Ramamoorthi, Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001.
    """
    degree, _ = harmonics.degrees_and_orders(harmonics.check_bands(bands))
    lobe = (harmonics.lambert_coefficients(bands) / np.pi).astype(np.float32)
    return harmonics.evaluate(unit_normals(normals), bands) * lobe[degree]
