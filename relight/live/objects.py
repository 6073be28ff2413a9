"""Inserted objects of the bundle under its first light: a lit mesh, and its effect on the splats around it; and what
the page needs to move them: a coarse mesh of each, the light that arrives where it stands, its splats.

The page approximates the shadow of a moved object as that of this light, direction by direction: what the object
hides of it, a surface loses, and the mean radiance of the object comes in its place.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Indices
from splat2mesh.splats.splats import SH_C0, Splats
from splat2mesh.surface.decimate import decimate

from ..insert.surroundings import DIRECTIONS, light_at, shown_along
from ..splats.light_ratio import CURVE_OFFSET

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight

FILE, MESH, MOVABLE_FILE = "objects.bin", "inserted.glb", "movable.bin"

UNIT = 1024
"""Range of a gain of 16 bits, as on the page."""

LEAST = 0.01
"""A gain acts on a display colour plus .055 (docs/live.md). A colour with less than LEAST in both has no gain."""


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
        """Its part of MOVABLE_FILE."""
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


class LiveObjects(NamedTuple):
    """glb: bytes of the lit mesh, scene frame; none if all objects are splats. angle_deg: of their light, the first of
    the bundle. rows: (M,) uint32 of the splats that they change, ascending. gains: (M, 3) uint16. movable: each object,
    for the page to move."""

    glb: bytes
    angle_deg: float
    rows: NDArray[np.uint32]
    gains: NDArray[np.uint16]
    movable: Sequence[Movable] = ()

    def in_order(self, order: Indices) -> "LiveObjects":
        """The same for reordered splats. order: (N,) their present rows."""
        back = np.full(int(order.max()) + 1, -1, np.int64)
        back[order] = np.arange(len(order))
        known = self.rows <= order.max()
        rows = np.where(known, back[np.where(known, self.rows, 0)], -1)
        kept = np.flatnonzero(rows >= 0)
        kept = kept[np.argsort(rows[kept])]
        return self._replace(rows=rows[kept].astype(np.uint32), gains=self.gains[kept])

    def tobytes(self) -> bytes:
        """Content of FILE: rows, then gains."""
        return self.rows.astype("<u4").tobytes() + self.gains.astype("<u2").tobytes()

    def described(self) -> dict[str, Any]:
        """Its entry in live.json."""
        mesh = {"mesh": MESH} if self.glb else {}
        entry = {"file": FILE, "rows": len(self.rows), "unit": UNIT, "light": 0, "angle_deg": self.angle_deg, **mesh}
        if self.movable:
            entry["moving"] = MOVABLE_FILE
            entry["movable"] = [each.described(number) for number, each in enumerate(self.movable)]
        return entry


def objects_of(
    without: Splats, shadowed: Splats, glb: bytes, angle_deg: float, movable: Sequence[Movable] = ()
) -> LiveObjects:
    """The LiveObjects of splats under their first light, given without and with the objects, in the same order."""
    before, after = (SH_C0 * np.asarray(each.sh[:, 0], np.float64) + 0.5 + CURVE_OFFSET for each in (without, shadowed))
    gain = np.where(before > LEAST, np.maximum(after, 0.0) / np.maximum(before, LEAST), 1.0)
    packed = np.minimum(np.rint(gain * UNIT), 2**16 - 1).astype(np.uint16)
    rows = np.flatnonzero((packed != UNIT).any(axis=1))
    return LiveObjects(glb, float(angle_deg), rows.astype(np.uint32), packed[rows], movable)
