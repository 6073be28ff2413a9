"""Light that arrives at an object from each direction, and the radiance that the object shows in its place."""

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Vector
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.mesh import unit

from ..lamps.tracing import DRAFT_RAYS, lamplight
from .surroundings import Receiving, Surroundings, Together

DIRECTIONS = 64
"""Directions of the light, evenly over the sphere: a surface faces half of them, so a shadow has steps of 3%."""

NEAR_DEG = 6.0
"""Angle within which the texels of a sun join."""

LOOKS = 8192
"""Rays from the middle of an object that find the light of those directions."""

OWN_SUN = 0.1
"""Share of the light from which a sun or lamp keeps a direction of its own; weaker ones join the nearest direction, or
the harmonics of a page."""


def light_at(around: Surroundings, place: Vector) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Directions (K, 3) and the light (K, 3) from them, radiance times solid angle, at a place (3,) in the unit frame:
    of surfaces and the sky in even directions, and of strong suns and lamps."""
    even, looks = fibonacci_sphere(DIRECTIONS), fibonacci_sphere(LOOKS).astype(np.float32)
    place = np.asarray(place, np.float32)
    start = np.broadcast_to(place, looks.shape)
    seen = around.seen(around.occluder.first_hits(np.hstack([start, looks])), looks)
    nearest = scipy.spatial.cKDTree(even)
    owner = nearest.query(looks)[1]
    light = np.stack([np.bincount(owner, seen[:, c], len(even)) for c in range(3)], axis=1) * (4.0 * np.pi / LOOKS)
    single, weights = clustered(*_single(around, place))
    strong = weights.sum(axis=1) > OWN_SUN * (light.sum() + weights.sum())
    np.add.at(light, nearest.query(single[~strong])[1], weights[~strong])
    directions = np.concatenate([even, single[strong]])
    return directions.astype(np.float32), np.concatenate([light, weights[strong]]).astype(np.float32)


def _single(around: Surroundings, place: Vector) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions (S, 3) of suns and lamps and their irradiance (S, 3) on a surface that faces each."""
    directions, lamps = np.asarray(around.suns.directions, np.float64).reshape(-1, 3), around.lamps
    toward, emitters = [], []
    for number in np.unique(lamps.lamp) if lamps is not None else ():
        assert lamps is not None
        emitters.append(lamps.of_lamp(int(number)))
        way = emitters[-1].middle.mean(axis=0, dtype=np.float64) - place
        toward.append(way / max(float(np.linalg.norm(way)), 1e-12))
    at = Receiving(np.broadcast_to(place, directions.shape).astype(np.float32), directions.astype(np.float32))
    lit = np.zeros((0, 3))
    if len(directions):
        rays = np.hstack([at.origins, at.normals])
        lit = around.suns.weights * ~around.occluder.occluded(rays)[:, None]
    for way, each in zip(toward, emitters, strict=True):
        one = Receiving(np.array([place], np.float32), np.array([way], np.float32))
        lit = np.concatenate([lit, np.pi * lamplight(Together(around.occluder, one), each, DRAFT_RAYS)])
    return np.concatenate([directions, np.reshape(toward, (-1, 3))]), lit


def clustered(
    directions: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions (S, 3) of lights and their irradiance (S, 3), those near a stronger one joined with it."""
    near, count = directions @ directions.T > np.cos(np.radians(NEAR_DEG)), 0
    label = np.full(len(directions), -1)
    for row in np.argsort(-weights.sum(axis=1), kind="stable"):
        if label[row] < 0:
            label[near[row] & (label < 0)] = count
            count += 1
    ways, found = np.zeros((2, count, 3))
    np.add.at(ways, label, directions * weights.sum(axis=1, keepdims=True))
    np.add.at(found, label, weights)
    return unit(ways), found


def shown_along(
    vertices: NDArray[np.float32], faces: Faces, radiance: NDArray[np.float32], directions: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Mean radiance (K, 3) of the sides of a surface that rays along directions (K, 3) meet from the front."""
    a, b, c = vertices[faces.T].astype(np.float64)
    across = np.cross(b - a, c - a)
    met = np.maximum(-directions.astype(np.float64) @ across.T, 0.0)
    total = met.sum(axis=1, keepdims=True)
    met = np.where(total > 0.0, met, np.linalg.norm(across, axis=1))
    return np.asarray(met @ radiance[faces].mean(axis=1) / met.sum(axis=1, keepdims=True), np.float32)
