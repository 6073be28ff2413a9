"""Objects in a scene under one light after another: the light on them, and their effect on the scene and its splats.

A mesh of a place has vertices a hand apart, but a contact shadow has an edge. So for splats the triangles that change
are subdivided until they are fine near the object, their vertices traced, and the splats bound to them.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.color import luminance
from splat2mesh.scene.mesh import Mesh, unit
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.joining import joined
from splat2mesh.splats.splats import Splats

from ..engine.appearance import CAPTURE
from ..engine.relit_room import SOFTNESS
from ..planning.costs import FOLLOWED
from ..splats import Binding
from ..splats.light_ratio import Usual
from .asked import AskedInsert
from .gathering import Casting, change_at, light_on
from .objects import InsertedObject
from .refine import carried, refined
from .standing import Standing, placed_by
from .surroundings import Receiving, Surroundings

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..engine.relighter import Relighter

RAYS = 32
"""Rays from each vertex to each object, in the first pass over what it changes."""

GLIMPSE_RAYS, GLIMPSE_CONE = 8, 1.0 / 16.0
"""Rays of a quick preview, and the part of a hemisphere that an object must fill to be considered in it."""

LEAST_RATIO = 0.03
"""Least share of the light that remains: no shadow is black, and captured colours do not resolve darker ones."""

LEAST_CHANGE = 0.004
"""Least change of the logarithm of the light. Smaller changes are invisible and dropped; so far surfaces keep every
bit."""

BURIED = 0.9
"""Share of dark vertices above which an object is inside a wall."""

FINENESS = 20.0
"""Edges along the radius of the smallest object, in the region that it changes."""

MOST_FACES = 600_000
"""Number of faces in the changed region above which none is subdivided."""


class Inserts:
    """Objects in the scene of a Relighter.

    asked: the requested objects. look: returns the Appearance, whose albedo bounces use. objects: returns them as
    read, in their own frames. placed: their matrices; without they are placed anew. Raises InputError, on first use,
    for files that cannot be read.
    """

    def __init__(
        self,
        asked: Sequence[AskedInsert],
        relighter: "Relighter",
        look: "Callable[[], Appearance]",
        objects: Callable[[], list[InsertedObject]],
        placed: list[NDArray[np.float64]] | None = None,
    ) -> None:
        self.asked, self.relighter, self._look = list(asked), relighter, look
        self._objects, self._placed = objects, placed

    @property
    def look(self) -> "Appearance":
        return self._look()

    def moved(self, asked: Sequence[AskedInsert]) -> "Inserts":
        """The same objects in other positions, without reading them again."""
        return Inserts(asked, self.relighter, self._look, lambda: self.objects)

    def posed(self, objects: list[InsertedObject], anew: bool = False) -> "Inserts":
        """The same objects in other poses, placed by the same matrices or anew."""
        return Inserts(self.asked, self.relighter, self._look, lambda: objects, None if anew else self.placed)

    @cached_property
    def objects(self) -> list[InsertedObject]:
        """The objects as read, in their own frames."""
        return self._objects()

    @cached_property
    def placed(self) -> list[NDArray[np.float64]]:
        """Of each object, scene_from_object, (4, 4)."""
        if self._placed is not None:
            return self._placed
        scene, occluder = self.relighter.scene, self.relighter.occluder
        objects = zip(self.asked, self.objects, strict=True)
        return [placed_by(asked, each.joined("vertices"), scene, occluder) for asked, each in objects]

    @cached_property
    def standing(self) -> Standing:
        """The objects at their positions."""
        with self.relighter.stages.stage("objects"):
            return Standing.of(self.relighter.occluder.frame, self.objects, self.placed)

    def under(
        self, around: Surroundings, received: NDArray[np.float32], check: Callable[[int], None] = lambda count: None
    ) -> "InsertedLight":
        """Return the light on the objects and their effect. around: the light on the scene without them. received: (V,
        3) irradiance over pi of its vertices in that light. check: called now and then with the progress; may raise."""
        stages, seed = self.relighter.stages, self.relighter.seed
        with stages.stage("light on objects"):
            light = light_on(around, self.standing, seed, check)
        self._check_lit(light, received)
        radiance = self.standing.albedo * light + self.standing.emission
        with stages.stage("shadows of objects", len(received)) as advance:
            # Leaves use their normals too: beside an object, their orientation matters (.70 of the shadow in a trained
            # garden, .69 as volumes).
            at = Receiving(around.occluder.origins, around.occluder.normals)

            def done(count: int) -> None:
                check(count)
                advance(count)

            direct = change_at(around, self.standing, radiance, Casting(RAYS, seed), at, done)
            check(0)
        return InsertedLight(self, around, received, light, radiance, direct, self._later(direct))

    def glimpse(self, before: "InsertedLight") -> "InsertedLight":
        """Return an approximation by few rays, without bounces. before: the result for the same objects at other
        positions, whose light they keep."""
        around = before.around
        at, seed = Receiving(around.occluder.origins, around.occluder.normals), self.relighter.seed
        change = change_at(around, self.standing, before.radiance, Casting(GLIMPSE_RAYS, seed, GLIMPSE_CONE), at)
        kept = before.received, before.light, before.radiance
        return InsertedLight(self, around, *kept, change, np.zeros_like(change))

    def _later(self, direct: NDArray[np.float32]) -> NDArray[np.float32]:
        """Change of the light that surfaces bounce to each other, for a change of light (V, 3) on them."""
        albedo, later = self.look.albedo, np.zeros_like(direct)
        if albedo is None or not direct.any():
            return later
        interreflection, sent = self.relighter.transport(CAPTURE).interreflection, direct
        with self.relighter.stages.stage("bounces"):
            for _ in range(FOLLOWED):
                sent = interreflection.bounce(albedo * sent)
                later += sent
        return later

    def _check_lit(self, light: NDArray[np.float32], received: NDArray[np.float32]) -> None:
        usual = float(np.median(luminance(received)))
        starts = self.standing.starts
        for asked, first, last in zip(self.asked, starts[:-1], starts[1:], strict=True):
            dark = float((luminance(light[first:last]) < LEAST_RATIO * usual).mean())
            if dark > BURIED and usual > 0.0:
                message = f"{asked.name} is in the dark, in a wall or below the ground: move it"
                warnings.warn(message, DataWarning, stacklevel=4)


@dataclass(frozen=True, eq=False)
class InsertedLight:
    """Objects in one light; V vertices of the scene, W of the objects.

    around: the light without them. received: (V, 3) irradiance over pi in it. light: (W, 3) float32 irradiance over pi
    of the objects. radiance: (W, 3) their exit radiance. direct, later: (V, 3) change of the scene's irradiance over
    pi, direct and by bounces.
    """

    inserts: Inserts
    around: Surroundings
    received: NDArray[np.float32]
    light: NDArray[np.float32]
    radiance: NDArray[np.float32]
    direct: NDArray[np.float32]
    later: NDArray[np.float32]

    @property
    def standing(self) -> Standing:
        return self.inserts.standing

    @cached_property
    def softness(self) -> float:
        """Added to all irradiance before comparison."""
        return SOFTNESS * float(np.median(self.received))

    @cached_property
    def ratio(self) -> NDArray[np.float32]:
        """(V, 3) ratio of the light at the scene's vertices with and without the objects; exactly 1 where no change is
        visible."""
        return self.compared(self.received, self.direct + self.later)

    def compared(self, received: NDArray[np.float32], change: NDArray[np.float32]) -> NDArray[np.float32]:
        """The ratio of changed light (V, 3) to the light before."""
        ratio = np.ones(change.shape, np.float32)
        rows = np.flatnonzero(change.any(axis=1))
        before = np.asarray(received[rows], np.float64) + max(self.softness, 1e-12)
        logs = np.log(np.maximum((before + change[rows]) / before, LEAST_RATIO))
        shrunk = np.sign(logs) * np.maximum(np.abs(logs) - LEAST_CHANGE, 0.0)
        ratio[rows] = np.exp(shrunk)
        return ratio

    def splat_put_in(self, number: int, exposure: float) -> Splats | None:
        """One of the objects as lit splats in the frame of the place's splat; None for a mesh. exposure: units of the
        picture per unit of the radiance."""
        each, starts = self.standing.objects[number], self.standing.starts
        if each.splat is None:
            return None
        back = np.linalg.inv(np.asarray(self.inserts.relighter.scene.scene_from_splat, np.float64))
        light = self.light[starts[number] : starts[number + 1]] * np.float32(exposure)
        return each.splat.relit(light, back @ self.standing.placed[number])

    def splats_put_in(self, exposure: float) -> Splats | None:
        """The splats among the objects together, as `splat_put_in` returns them; None without."""
        each = [self.splat_put_in(number, exposure) for number in range(len(self.standing.objects))]
        found = [splats for splats in each if splats is not None]
        return joined(found) if found else None


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
