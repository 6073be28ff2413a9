"""The light around an object: the radiance of surfaces, the sky behind them, suns and lamps; what arrives from each
direction, and the radiance that the object shows in its place."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Faces, Indices, Mask, Radiance, Rays, Vector
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.render.raycaster import Hits, RayCaster, corner_weights
from splat2mesh.scene.mesh import unit
from splat2mesh.scene.scene import Scene

from ..lamps.emitters import Emitters, emitters_of
from ..lamps.shapes import Lamp, MeshLamp
from ..lamps.tracing import DRAFT_RAYS, lamplight
from ..light.environment import Environment, Suns
from ..light.sun_split import split
from ..transfer import DEFAULT_BANDS
from ..transfer.occluder import Occluder

MOST_GLOWING = 20_000
"""Most faces of captured lamps that emit. Of more faces, every n-th emits, n times as bright."""

DIRECTIONS = 64
"""Directions of the light, evenly over the sphere: a surface faces half of them, so a shadow has steps of 3%."""

NEAR_DEG = 6.0
"""Angle within which the texels of a sun join."""

LOOKS = 8192
"""Rays from the middle of an object that find the light of those directions."""

OWN_SUN = 0.1
"""Share of the light from which a sun or lamp keeps a direction of its own; weaker ones join the nearest direction, or
the harmonics of a page."""


class Sky(NamedTuple):
    """A rotated Environment and the factor on its radiance."""

    environment: Environment
    factor: float


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Light on a scene of V vertices, in one unit.

    occluder: the scene to trace rays in. radiance: (V, 3) float32 exit radiance of surfaces; 0 at lamps. skies: the
    background, without its suns. suns: Suns. lamps: Emitters in the unit frame of the scene, or None.
    """

    occluder: Occluder
    radiance: NDArray[np.float32]
    skies: list[Sky]
    suns: Suns
    lamps: Emitters | None

    def seen(self, hits: Hits, directions: Directions) -> NDArray[np.float32]:
        """(N, 3) radiance along rays of unit directions (N, 3), from a surface or the sky. Back faces are black."""
        found = np.zeros((len(directions), 3), np.float32)
        away = hits.faces < 0
        found[away] = self.sky(directions[away])
        met = ~away
        corners = self.occluder.faces[hits.faces[met]]
        weights = corner_weights(hits.uv[met])
        sent = np.einsum("nk,nkc->nc", weights, self.radiance[corners])
        front = np.einsum("nc,nc->n", self.occluder.normals[corners].sum(axis=1), directions[met]) < 0.0
        found[met] = sent * front[:, None]
        return found

    def sky(self, directions: Directions) -> NDArray[np.float32]:
        """(N, 3) radiance from unit directions (N, 3) without occlusion and suns."""
        found = np.zeros((len(directions), 3), np.float32)
        for sky in self.skies:
            found += np.float32(sky.factor) * sky.environment.lookup(np.asarray(directions, np.float32))
        return found


class Receiving(NamedTuple):
    """Points that receive light. origins: (M, 3) float32, where rays start, unit frame. normals: (M, 3) float32."""

    origins: NDArray[np.float32]
    normals: NDArray[np.float32]

    def of(self, rows: Indices) -> "Receiving":
        """The points of these rows."""
        return Receiving(*(each[rows] for each in self))


class Together(Occluder):
    """A scene's Occluder with other receiving points, whose rays meet objects too."""

    def __init__(self, scene: Occluder, at: Receiving, objects: RayCaster | None = None) -> None:
        self.origins, self.normals, self.faces = at.origins, at.normals, scene.faces
        self._scene, self._objects = scene, objects

    def occluded(self, rays: Rays, far: float = np.inf) -> Mask:
        if self._objects is None:
            return self._scene.occluded(rays, far)
        hidden = self._objects.occluded(rays, far)
        free = ~hidden
        hidden[free] = self._scene.occluded(rays[free], far)
        return hidden


def surroundings_of(
    scene: Scene,
    occluder: Occluder,
    radiance: Radiance,  # (V, 3)
    skies: list[Sky],
    lamps: list[Lamp],  # frame of the scene, unit of the radiance
    glow: NDArray[np.float32] | None = None,  # (V, 3) radiance of captured lamps, 0 elsewhere
) -> Surroundings:
    """Return the Surroundings. Suns are split off the skies and captured lamps become emitters, to give sharp
    shadows."""
    rests, directions, weights = [], [np.zeros((0, 3))], [np.zeros((0, 3))]
    for sky in skies:
        if sky.factor <= 0.0 or not sky.environment.radiance.any():
            continue
        rest, suns = split(sky.environment, DEFAULT_BANDS)
        rests.append(Sky(rest, sky.factor))
        directions.append(suns.directions)
        weights.append(sky.factor * suns.weights)
    sent = np.array(radiance, np.float32)
    lamps = list(lamps)
    if glow is not None and glow.any():
        glowing = np.asarray(glow.any(axis=1))
        own = _lamp_of(scene, glow, glowing)
        lamps += [] if own is None else [own]
        sent[glowing] = 0.0
    emitters = emitters_of(lamps, occluder.frame.center, occluder.frame.diagonal) if lamps else None
    return Surroundings(occluder, sent, rests, Suns(np.concatenate(directions), np.concatenate(weights)), emitters)


def _lamp_of(scene: Scene, glow: NDArray[np.float32], glowing: Mask) -> Lamp | None:
    """The faces whose corners all glow, as one lamp."""
    faces = scene.faces[glowing[scene.faces].all(axis=1)]
    step = -(-len(faces) // MOST_GLOWING)
    if not len(faces):
        return None
    faces = faces[::step]
    used, corners = np.unique(faces, return_inverse=True)
    light = step * glow[faces].mean(axis=1).astype(np.float64)
    corners = corners.reshape(-1, 3)
    # The vertex normals decide which side is the front, not the winding.
    points = scene.vertices[used].astype(np.float64)
    across = np.cross(points[corners[:, 1]] - points[corners[:, 0]], points[corners[:, 2]] - points[corners[:, 0]])
    against = np.einsum("ij,ij->i", across, scene.normals[faces].sum(axis=1)) < 0.0
    corners[against] = corners[against][:, ::-1]
    return MeshLamp(points, corners, light)


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
