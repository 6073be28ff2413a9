"""The baseline of the Neural-GASh paper: Blinn-Phong shading under an ambient light and a few lamps, no shadows."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Points, Vector
from splat2mesh.base.errors import InputError

from ..light.environment import Environment
from ..light.sun_split import split
from ..light.suns import Suns
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
    vertices: Points | None = None,  # (V, 3) scene frame; needed with an eye
    eye: Vector | None = None,  # (3,) scene frame; without one no specular part
    specular: float = 0.0,  # share of light that is reflected as gloss, 0 to 1
    shininess: float = 32.0,
) -> NDArray[np.float32]:
    """Radiance of white vertices, (V, 3) float32, without shadows: with specular = 0 what leaves in all directions.

    diffuse = ambient + sum of weight / pi max(0, n d); gloss = ambient + sum of weight (s + 8) / (8 pi)
    max(0, n h)^s max(0, n d), h halfway between sun and eye; radiance = (1 - specular) diffuse + specular gloss.
    The factor (s + 8) / (8 pi) makes gloss reflect about as much as it receives, whatever the shininess s
    (Akenine-Moller, Haines, Hoffman, "Real-Time Rendering", 3rd ed., 7.6); it is
    exact to a few percent for light along the normal, and loses light at grazing angles.
    Normals are used as `unit_normals` returns them. Raises InputError for options outside these.
    """
    ambient, suns = light if isinstance(light, tuple) else lamps(light)
    if not 0.0 <= specular <= 1.0 or not shininess >= 0.0:
        raise InputError(
            f"expected a specular share from 0 to 1 and a shininess from 0 up, found {specular} and {shininess}"
        )
    found = () if vertices is None else np.shape(vertices)
    if specular > 0.0 and (eye is None or vertices is None or found != np.shape(normals)):
        raise InputError(f"gloss needs an eye and one vertex per normal, found eye {eye} and {found}")
    unit = unit_normals(normals).astype(np.float64)
    cosine = np.maximum(unit @ suns.directions.T, 0.0)
    radiance = np.add(np.asarray(ambient, np.float64), cosine @ (suns.weights / np.pi))
    if specular > 0.0:
        radiance = (1.0 - specular) * radiance + specular * _gloss(
            unit, cosine, ambient, suns, vertices, eye, shininess
        )
    return radiance.astype(np.float32)


def _gloss(
    normals: NDArray[np.float64],
    cosine: NDArray[np.float64],
    ambient: Vector,
    suns: Suns,
    vertices: Points | None,
    eye: Vector | None,
    shininess: float,
) -> NDArray[np.float64]:
    toward_eye = np.asarray(eye, np.float64) - np.asarray(vertices, np.float64)
    toward_eye /= np.maximum(np.linalg.norm(toward_eye, axis=1, keepdims=True), 1e-30)
    gloss = np.broadcast_to(np.asarray(ambient, np.float64), normals.shape).copy()
    for direction, weight, facing in zip(suns.directions, suns.weights, cosine.T, strict=True):
        half = toward_eye + direction
        half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-30)
        lobe = np.maximum((normals * half).sum(axis=1), 0.0) ** shininess * facing
        gloss += lobe[:, None] * weight * ((shininess + 8.0) / (8.0 * np.pi))
    return gloss
