"""Objects in a scene: turned, scaled, shifted, dropped onto the floor; their triangles, and the sphere around each."""

import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces
from splat2mesh.base.errors import DataWarning
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.mesh import unit
from splat2mesh.scene.scene import Scene

from ..transfer.occluder import Frame, Occluder
from .asked import AskedInsert
from .objects import InsertedObject

ROOM = 1.001
"""Factor by which spheres exceed their content, so that rays beside an edge count."""

MOST_OF_SCENE = 0.5
"""Largest size of an object without a given scale, in diagonals of the scene. Files in centimetres and millimetres
exceed it."""

LEAST_OF_SCENE = 2e-4
"""Smallest size, in diagonals of the scene: a smaller object and its shadow are invisible."""

COLUMNS = 9
"""Points along a side of the grid from which rays search for the floor."""


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


def placed_by(
    asked: AskedInsert,
    vertices: NDArray[np.float32],  # (V, 3) of the object, y up
    scene: Scene,
    occluder: Occluder,  # of that scene
) -> NDArray[np.float64]:
    """Return scene_from_object, (4, 4). Warns with a DataWarning of an object of another unit than the scene's.

    An object stands upright whichever way the splat's own frame is turned; its unit is the splat's.
    """
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    own = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3])))) or 1.0
    size = float(np.linalg.norm(np.ptp(vertices.astype(np.float64), axis=0))) * own
    scale, diagonal = asked.scale, occluder.frame.diagonal
    if scale is None:
        scale = _guessed_scale(asked.name, size, diagonal)
    elif size * scale > diagonal:
        _warn(f"{asked.name} is {size * scale / diagonal:.3g} times as large as the scene: give a smaller scale")
    if size * scale < LEAST_OF_SCENE * diagonal:
        _warn(f"{asked.name} is too small to be seen, {size * scale / diagonal:.1g} of the scene: scale it up")
    angle = np.radians(asked.turn_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    placed = np.eye(4)
    placed[:3, :3] = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]) * scale * own
    placed[:3, 3] = matrix[:3, :3] @ np.asarray(asked.at) + matrix[:3, 3]
    if asked.on == "floor":
        placed[1, 3] += _drop(vertices.astype(np.float64) @ placed[:3, :3].T + placed[:3, 3], occluder)
    return placed


def _guessed_scale(name: str, size: float, diagonal: float) -> float:
    """1, or the power of ten that fits an object of another unit into the scene."""
    if size <= MOST_OF_SCENE * diagonal:
        return 1.0
    scale = 10.0 ** -np.ceil(np.log10(size / (MOST_OF_SCENE * diagonal)))
    _warn(
        f"{name} is {size / diagonal:.3g} times as large as the scene, so its unit is assumed to differ, and it is "
        f"scaled by {scale:g}; give its scale"
    )
    return float(scale)


def _drop(vertices: NDArray[np.float64], occluder: Occluder) -> float:
    """Height by which an object (V, 3) moves up to stand on the highest surface below it, searched from its middle."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    share = (np.arange(COLUMNS) + 0.5) / COLUMNS
    x, z = (grid.ravel() for grid in np.meshgrid(*(low[axis] + share * (high - low)[axis] for axis in (0, 2))))
    middle = 0.5 * (low[1] + high[1])
    rays = np.zeros((len(x), 6), np.float32)
    rays[:, :3] = occluder.frame.unit(np.stack([x, np.full_like(x, middle), z], axis=1))
    rays[:, 4] = -1.0
    distance = occluder.first_hits(rays).distance * occluder.frame.diagonal
    # A surface under one corner alone, such as a table's edge, does not support it: most columns must be no lower.
    met = np.sort(distance[np.isfinite(distance)])
    if not len(met):
        _warn("found no floor below the object: it stays at its position")
        return 0.0
    return float(middle - met[len(met) // 4] - low[1])


def _warn(message: str) -> None:
    warnings.warn(message, DataWarning, stacklevel=5)
