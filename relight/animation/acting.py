"""Objects of animated files: the same triangles, posed at any time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import GltfData
from splat2mesh.scene.mesh import Mesh, unit

from ..insert.asked import AskedInsert
from ..insert.inserts import Inserts
from ..insert.objects import InsertedObject, Part
from .animation import POSES, Animation


class Acting:
    """Inserts of which some move.

    first: their first pose, in which they are placed. duration_s: of the longest animation; those that end before hold
    their last pose. name: of the first animation.
    Raises InputError where none has an animation.
    """

    def __init__(self, inserts: Inserts) -> None:
        self._rest = inserts
        self._animations = [_animation(asked) for asked in inserts.asked]
        found = [each for each in self._animations if each is not None]
        if not found:
            raise InputError("`animated`: no inserted object has an animation; leave it out")
        self.duration_s = max(each.duration_s for each in found)
        self.name = found[0].name
        self.first = inserts.posed(self._objects(0.0), anew=True)

    def at(self, time_s: float) -> Inserts:
        """The objects at a time."""
        return self.first.posed(self._objects(time_s))

    def _objects(self, time_s: float) -> list[InsertedObject]:
        pairs = zip(self._rest.objects, self._animations, strict=True)
        return [each if animation is None else _posed(each, animation, time_s) for each, animation in pairs]

    @property
    def sampled(self) -> list[Inserts]:
        """The objects in some poses, evenly over the time."""
        return [self.at(float(time_s)) for time_s in np.linspace(0.0, self.duration_s, POSES)]


def _animation(asked: AskedInsert) -> Animation | None:
    source = asked.source
    if isinstance(source, Mesh) or Path(source).suffix.lower() not in (".glb", ".gltf"):
        return None
    return Animation(str(source)) if GltfData(str(source)).document.animations else None


def _posed(each: InsertedObject, animation: Animation, time_s: float) -> InsertedObject:
    poses: dict[int, list[tuple[NDArray[np.float32], NDArray[np.float32]]]] = {}
    for chunk, pose in zip(animation.chunks, animation.at(time_s), strict=True):
        poses.setdefault(chunk.node, []).append(pose)
    return replace(each, parts=[_part(part, poses[part.node].pop(0)) for part in each.parts if part.node is not None])


def _part(part: Part, pose: tuple[NDArray[np.float32], NDArray[np.float32]]) -> Part:
    vertices, normals = pose
    return replace(part, vertices=part.carried(vertices), normals=unit(part.carried(normals)).astype(np.float32))
