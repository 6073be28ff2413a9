"""Normalise vertex normals to length 1."""

import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.mesh import without_direction


def unit_normals(normals: ArrayLike) -> NDArray[np.float32]:
    """Bring normals to length 1.

    normals: (V, 3), vectors of any length, in any frame. Returns (V, 3) float32: unit vectors. A degenerate normal
    (`without_direction`) becomes +y, as in Neural-GASh; one DataWarning says how many did.
    """
    normals = np.asarray(normals, np.float64)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = normals / length
    valid = ~without_direction(normals)[:, None]
    if not valid.all():
        message = f"{np.sum(~valid)} of {len(valid)} vertices have no normal: lit as if they faced up"
        warnings.warn(message, DataWarning, stacklevel=3)
    return np.where(valid, unit, [0.0, 1.0, 0.0]).astype(np.float32)
