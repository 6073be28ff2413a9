"""How far the model of a room is trusted, region by region: where it does not give the capture back, it is wrong, and
a change of light by it would be wrong there too."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Integers, Radiance
from splat2mesh.scene.color import BLACK

DOUBT = 0.7
"""Difference of the logarithm of what a region received, as modelled and as captured, at which half of a change is
applied. With 0.35 a trained parlour lost 0.6 dB, with 0.9 a lounge 0.2."""

REGION_RINGS = 3
"""Rounds in which doubts are averaged over neighbours: a region is some rings of vertices."""


def trust_in(modelled: Radiance, captured: Radiance, faces: Integers) -> NDArray[np.float32]:
    """(V,) float32 in (0, 1]: trust in a model that says (V, 3) was captured where (V, 3) was, by region."""
    doubt = np.abs(np.log((modelled.mean(axis=1) + BLACK) / (captured.mean(axis=1) + BLACK)))
    return (1.0 / (1.0 + (_of_region(faces, doubt) / DOUBT) ** 2)).astype(np.float32)


def _of_region(faces: Integers, values: Floats) -> Floats:
    """Values (V,) averaged over the faces around each vertex, a few times over."""
    count = np.maximum(3.0 * np.bincount(faces.ravel(), minlength=len(values)), 1.0)
    for _ in range(REGION_RINGS):
        around = values[faces].sum(axis=1)
        values = sum(np.bincount(faces[:, corner], around, len(values)) for corner in range(3)) / count
    return values
