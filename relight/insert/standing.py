"""Objects in a scene: one set of triangles in its frame, and the sphere around each."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.mesh import unit

from ..transfer.occluder import Frame, Occluder
from .objects import InsertedObject

ROOM = 1.001
"""Factor by which spheres exceed their content, so that rays beside an edge count."""


@dataclass(frozen=True, eq=False)
class Standing:
    """Objects in a scene, V vertices in all, concatenated.

    frame: of the scene. objects: as read. vertices, normals: (V, 3) float32, scene frame. faces: (F, 3) int32.
    albedo, emission: (V, 3) float32. starts: (N + 1,), first vertex of each object. placed: the matrices.
    """

    frame: Frame
    objects: list[InsertedObject]
    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    faces: Faces
    albedo: NDArray[np.float32]
    emission: NDArray[np.float32]
    starts: NDArray[np.int64]
    placed: list[NDArray[np.float64]]

    @classmethod
    def of(cls, frame: Frame, objects: list[InsertedObject], placed: list[NDArray[np.float64]]) -> "Standing":
        """Objects where matrices (4, 4), scene_from_object, place them."""
        vertices, normals, faces, first = [], [], [], [0]
        for each, matrix in zip(objects, placed, strict=True):
            own = each.joined("vertices").astype(np.float64)
            vertices.append((own @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32))
            normals.append(unit(each.joined("normals") @ matrix[:3, :3].T).astype(np.float32))
            faces.append(each.faces + first[-1])
            first.append(first[-1] + len(own))
        albedo, emission = (np.concatenate([each.joined(name) for each in objects]) for name in ("albedo", "emission"))
        joined = np.concatenate(faces).astype(np.int32)
        starts = np.array(first)
        arrays = np.concatenate(vertices), np.concatenate(normals), joined, albedo, emission, starts
        return cls(frame, objects, *arrays, placed)

    @cached_property
    def occluder(self) -> Occluder:
        """The objects alone, in the unit frame of the scene. Rays start as close to them as their own size allows."""
        found = Occluder(self.vertices, self.normals, self.faces)
        found.origins = self.frame.unit(found.origins.astype(np.float64) * found.frame.diagonal + found.frame.center)
        found._caster = self.caster
        return found

    @cached_property
    def caster(self) -> RayCaster:
        """The RayCaster of the objects, in that frame."""
        return RayCaster(self.frame.unit(self.vertices), self.faces)

    @cached_property
    def owner(self) -> NDArray[np.int64]:
        """(F,) number of the object of each face."""
        return np.searchsorted(self.starts, self.faces[:, 0], side="right") - 1

    @cached_property
    def spheres(self) -> list[tuple[NDArray[np.float64], float]]:
        """Middle (3,) and radius of each object, in the unit frame."""
        points = self.frame.unit(self.vertices).astype(np.float64)
        found = []
        for first, last in zip(self.starts[:-1], self.starts[1:], strict=True):
            part = points[first:last]
            middle = 0.5 * (part.min(axis=0) + part.max(axis=0))
            found.append((middle, ROOM * float(np.linalg.norm(part - middle, axis=1).max()) + 1e-6))
        return found
