"""The light around an object: the radiance of surfaces, the sky behind them, suns and lamps."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Indices, Mask, Radiance, Rays
from splat2mesh.render.raycaster import Hits, RayCaster, corner_weights
from splat2mesh.scene.scene import Scene

from ..lamps.emitters import Emitters, emitters_of
from ..lamps.shapes import Lamp, MeshLamp
from ..light.environment import Environment
from ..light.sun_split import split
from ..light.suns import Suns
from ..transfer import DEFAULT_BANDS
from ..transfer.occluder import Occluder

MOST_GLOWING = 20_000
"""Most faces of captured lamps that emit. Of more faces, every n-th emits, n times as bright."""


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
