"""Inserted objects that the page can move: a coarse mesh of each, the light that arrives where it stands, its splats.

The page approximates the shadow of a moved object as that of this light, direction by direction: what the object
hides of it, a surface loses, and the mean radiance of the object comes in its place.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.decimate import decimate

from ..insert.arriving import DIRECTIONS, light_at, shown_along

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight

FILE = "movable.bin"

VERTICES = 800
"""Most vertices of the mesh that casts the moved shadow. The page draws it into a map for each direction."""


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
        sent = shown_along(vertices, faces, inserted.radiance[first:last], directions)
        shape = np.asarray(points, np.float32), np.asarray(coarse, np.int32)
        found.append(Movable(each.name, *shape, directions, light, sent, inserted.splat_put_in(number, exposure)))
    return found
