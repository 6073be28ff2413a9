"""Inserted objects that the page can move: a coarse mesh of each, the light that arrives where it stands, its splats.

The page approximates the shadow of a moved object as that of this light, direction by direction: what the object
hides of it, a surface loses, and the mean radiance of the object comes in its place.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from splat2mesh.base.arrays import Directions, Faces, Vector
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.decimate import decimate

from ..insert.surroundings import LAMP_RAYS, Receiving, Surroundings, Together
from ..lamps.tracing import lamplight
from ..sh.sphere import fibonacci_sphere

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight

FILE = "movable.bin"

DIRECTIONS = 64
"""Directions of the light, evenly over the sphere: a surface faces half of them, so the shadow has steps of 3%."""

LOOKS = 8192
"""Rays from the middle of an object that find the light of those directions."""

VERTICES = 800
"""Most vertices of the mesh that casts the moved shadow. The page draws it into a map for each direction."""

OWN_SUN = 0.1
"""Share of the light from which a sun or lamp keeps a direction of its own; weaker ones join the nearest direction."""


class Movable(NamedTuple):
    """One object. vertices: (V, 3) float32, faces: (F, 3) int32, scene frame, where it was inserted. directions: (K, 3)
    float32 towards the light, of which the first DIRECTIONS share the sphere evenly. light: (K, 3) float32, radiance
    times solid angle. sent: (K, 3) float32, mean exit radiance of what the object shows along each of these, from
    below for a light above, in its unit. splats: its lit splats, frame of the place's splat, or None."""

    name: str
    vertices: NDArray[np.float32]
    faces: Faces
    directions: NDArray[np.float32]
    light: NDArray[np.float32]
    sent: NDArray[np.float32]
    splats: Splats | None

    def file_of_splats(self, number: int) -> str:
        """Name of the file of its splats in the bundle."""
        return f"inserted_{number + 1}.compressed.ply"

    def tobytes(self) -> bytes:
        """Its part of FILE."""
        arrays = (self.vertices, "<f4"), (self.faces, "<u4"), (self.directions, "<f4")
        lights = (self.light, "<f4"), (self.sent, "<f4")
        return b"".join(array.astype(kind).tobytes() for array, kind in (*arrays, *lights))

    def described(self, number: int) -> dict[str, Any]:
        """Its entry in live.json."""
        sizes = {"vertices": len(self.vertices), "faces": len(self.faces), "directions": len(self.directions)}
        splats = {} if self.splats is None else {"splats": self.file_of_splats(number)}
        return {"name": self.name, **sizes, "even": DIRECTIONS, **splats}


def movables_of(inserted: "InsertedLight", exposure: float) -> list[Movable]:
    """Return the Movable of each object of an InsertedLight. exposure: display value per radiance, for splats."""
    standing, found = inserted.standing, []
    for number, each in enumerate(standing.objects):
        first, last = standing.starts[number : number + 2]
        faces = standing.faces[standing.owner == number] - first
        vertices = standing.vertices[first:last]
        points, coarse = vertices.astype(np.float64), faces
        if len(points) > VERTICES:
            points, coarse = decimate(points, faces, VERTICES)
        directions, light = light_at(inserted.around, standing.spheres[number][0])
        sent = _shown(vertices, faces, inserted.radiance[first:last], directions)
        shape = np.asarray(points, np.float32), np.asarray(coarse, np.int32)
        found.append(Movable(each.name, *shape, directions, light, sent, inserted.splat_put_in(number, exposure)))
    return found


def light_at(around: Surroundings, place: Vector) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Directions (K, 3) and the light (K, 3) from them, radiance times solid angle, at a place (3,) in the unit frame:
    of surfaces and the sky in even directions, and of strong suns and lamps."""
    even, looks = fibonacci_sphere(DIRECTIONS), fibonacci_sphere(LOOKS).astype(np.float32)
    place = np.asarray(place, np.float32)
    start = np.broadcast_to(place, looks.shape)
    seen = around.seen(around.occluder.first_hits(np.hstack([start, looks])), looks)
    nearest = cKDTree(even)
    owner = nearest.query(looks)[1]
    light = np.stack([np.bincount(owner, seen[:, c], len(even)) for c in range(3)], axis=1) * (4.0 * np.pi / LOOKS)
    single, weights = _single(around, place)
    strong = weights.sum(axis=1) > OWN_SUN * (light.sum() + weights.sum())
    np.add.at(light, nearest.query(single[~strong])[1], weights[~strong])
    directions = np.concatenate([even, single[strong]])
    return directions.astype(np.float32), np.concatenate([light, weights[strong]]).astype(np.float32)


def _single(around: Surroundings, place: Vector) -> tuple[Directions, NDArray[np.float64]]:
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
        lit = np.concatenate([lit, np.pi * lamplight(Together(around.occluder, one), each, LAMP_RAYS)])
    return np.concatenate([directions, np.reshape(toward, (-1, 3))]), lit


def _shown(
    vertices: NDArray[np.float32], faces: Faces, radiance: NDArray[np.float32], directions: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Mean radiance (K, 3) of the sides of a surface that rays along directions (K, 3) meet from the front."""
    a, b, c = vertices[faces.T].astype(np.float64)
    across = np.cross(b - a, c - a)
    met = np.maximum(-directions.astype(np.float64) @ across.T, 0.0)
    total = met.sum(axis=1, keepdims=True)
    met = np.where(total > 0.0, met, np.linalg.norm(across, axis=1))
    return np.asarray(met @ radiance[faces].mean(axis=1) / met.sum(axis=1, keepdims=True), np.float32)
