"""The baseline of the Neural-GASh paper: the matt part of Blinn-Phong shading, an ambient light and a few lamps, no
shadows."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Vector

from ..light.environment import Environment, Suns
from ..light.sun_split import split
from ..sh.normals import unit_normals

LAMPS = 16
"""Most lamps taken from an environment: a shader's loop of that time."""


def lamps(environment: Environment, limit: int = LAMPS) -> tuple[NDArray[np.float64], Suns]:
    """(ambient (3,) radiance, Suns): an environment as a shader knows it, at most `limit` lamps in constant light.

    All its energy: if the light has one band, the rest beside the suns is constant.
    """
    rest, suns = split(environment, bands=1, limit=limit)
    return rest.sh(1)[0] / np.sqrt(4.0 * np.pi), suns


def blinn_phong(
    normals: Directions,  # (V, 3), scene frame, any length
    light: Environment | tuple[Vector, Suns],  # Environment, or (ambient (3,), Suns) of `lamps`
) -> NDArray[np.float32]:
    """Radiance that white matt vertices send in all directions, (V, 3) float32, without shadows: ambient + sum of
    weight / pi max(0, n d). Normals are used as `unit_normals` returns them."""
    ambient, suns = light if isinstance(light, tuple) else lamps(light)
    cosine = np.maximum(unit_normals(normals).astype(np.float64) @ suns.directions.T, 0.0)
    return np.add(np.asarray(ambient, np.float64), cosine @ (suns.weights / np.pi)).astype(np.float32)
