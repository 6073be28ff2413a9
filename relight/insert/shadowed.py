"""Splats in the shadow of objects: the change of light is recomputed on finer triangles around the objects.

A mesh of a place has vertices a hand apart, but a contact shadow has an edge. So the triangles that change are
subdivided until they are fine near the object, their vertices traced, and the splats bound to them.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.mesh import Mesh, unit
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

from ..splats import Binding
from ..splats.light_ratio import Usual
from .gathering import Casting, change_at
from .inserts import RAYS, InsertedLight
from .refine import carried, refined
from .surroundings import Receiving

FINENESS = 20.0
"""Edges along the radius of the smallest object, in the region that it changes."""

MOST_FACES = 600_000
"""Number of faces in the changed region above which none is subdivided."""


def shadowed(light: InsertedLight, splats: Splats) -> Splats:
    """The splats under the change of an InsertedLight. A splat that it does not reach keeps every bit."""
    if not (light.ratio != 1.0).any():
        return splats
    with light.inserts.relighter.stages.stage("shadows on splats"):
        return ShadowedSplats([light], splats).under(light)


class ShadowedSplats:
    """Splats bound to triangles that are finer where objects change the light in any of some poses.

    poses: InsertedLight of each. splats: without the objects.
    """

    def __init__(self, poses: list[InsertedLight], splats: Splats) -> None:
        scene, light = poses[0].inserts.relighter.scene, poses[len(poses) // 2]
        self._splats = splats
        radii = [radius for pose in poses for _, radius in pose.standing.spheres]
        smallest = min(radii) * light.standing.frame.diagonal
        changed = np.logical_or.reduce([(pose.ratio != 1.0).any(axis=1) for pose in poses])
        most = MOST_FACES + len(scene.faces)
        faces, self._rounds = refined(scene.vertices, scene.faces, smallest / FINENESS, most, changed)
        vertices, normals = (carried(each, self._rounds) for each in (scene.vertices, scene.normals))
        self._normals = unit(normals).astype(np.float32)
        self._origins = carried(light.around.occluder.origins, self._rounds)
        mesh = Mesh(vertices, self._normals, faces, carried(scene.colors_srgb, self._rounds))
        finer = Scene([mesh], scene_from_splat=scene.scene_from_splat, capture=scene.capture)
        self._binding = Binding(splats, finer, ())

    def under(self, light: InsertedLight) -> Splats:
        """The splats under the change of one of the poses, or a similar one. A splat that it does not reach keeps every
        bit."""
        ratio = self._ratio(light)
        binding, ones, none = self._binding, np.ones_like(ratio), np.zeros(3)
        relit = binding.relit(ones, ratio, usual=Usual(none, np.ones(3), none))
        reached = np.flatnonzero(binding.lit)[(binding.spread(np.log(ratio)) != 0.0).any(axis=1)]
        sh = self._splats.sh.copy()
        sh[reached] = relit.sh[reached]
        return replace(self._splats, sh=sh)

    def _ratio(self, light: InsertedLight) -> NDArray[np.float32]:
        """The ratio (V, 3) of light at the refined vertices. Rays are traced only where the light changes."""
        rounds = self._rounds
        received, later, change = (carried(each, rounds) for each in (light.received, light.later, light.direct))
        rows = np.flatnonzero(carried((light.ratio != 1.0).any(axis=1).astype(np.float32), rounds) > 0.0)
        at = Receiving(self._origins[rows], self._normals[rows])
        how = Casting(RAYS, light.inserts.relighter.seed)
        change[rows] = change_at(light.around, light.standing, light.radiance, how, at)
        return light.compared(received, change + later)
