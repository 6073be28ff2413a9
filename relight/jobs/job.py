"""A scene and a light, from files to radiance. Every stage runs on first use; `writer` writes the results.

job = Job(RelightRequest("garden", "sunset", LightingOptions(tolerance=0.02), angles_deg=(45.0,)))
job.plan                load, albedo, plan
job.shaded()            shade
"""

import warnings
from collections.abc import Iterator
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning
from splat2mesh.options import ConvertOptions
from splat2mesh.scene.mesh import Mesh

from ..engine.appearance import albedo_kept
from ..engine.light_mix import LightKind
from ..engine.relighter import Shaded, Shading
from ..light import CAPTURED
from ..light.environment import Environment
from ..output.kinds import SUN
from ..output.lamps_glb import PlacedLamps
from ..request import AnyLight, RelightRequest
from .known_scene import KnownScene
from .meshing import is_scene, scene_folder

if TYPE_CHECKING:
    from ..insert.asked import AskedInsert
    from ..insert.insert_plan import InsertPlan
    from ..insert.inserts import Inserts
    from ..insert.objects import InsertedObject
    from ..insert.probe import Light
    from ..planning.plan import Plan

OF_ONE_LIGHT = frozenset({"environment", "plan", "lights", "room", "mix"})
"""Stages of a Job that depend on the light."""

OF_SURFACES = frozenset({"glb", "ply", "npy", "png", "splat"})
"""Formats that need nothing but the light of the surfaces."""


class Job(KnownScene):
    """A relight request, processed stage by stage. Every stage reads and computes on first use.

    request: RelightRequest of one light. stages: Stages that time the work.
    Stages raise InputError for input that cannot be read or used.
    """

    def under(self, env: AnyLight) -> "Job":
        """The same job under another light. Both share every stage that does not depend on the light."""
        self.require("appearance", "formats")
        other = copy(self)
        other.request = self.request.under(env)
        for name in OF_ONE_LIGHT & vars(other).keys():
            delattr(other, name)
        return other

    # plan

    @cached_property
    def plan(self) -> "Plan | None":
        """The Plan for all angles; None for a method without a plan and for a room that stays as captured."""
        albedo, room = self.appearance.albedo, self.room
        if self.appearance.as_captured or self.light_kind is LightKind.CAPTURED:
            return None
        return (room.lit if room else self.relighter).plan_for(self.environment, albedo, len(self.request.angles_deg))

    def planned(self) -> tuple["Plan | None", str]:
        """The Plan without any long work, and a note on its assumption, or "".

        Without an estimate of the albedo, it plans with the captured colours.
        """
        if self.choice_name != "estimated" or "appearance" in vars(self):
            return self.plan, ""
        relighter = self.relighter
        light = self._capture_env()
        known = self.gloss is None or self.gloss.known
        albedo = None if not known else albedo_kept(light, relighter)
        note = "" if albedo is not None else "the albedo is not estimated yet: planned with the captured colours"
        used = self.scene.colors_linear if albedo is None else albedo
        return relighter.plan_for(self.environment, used, len(self.request.angles_deg)), note

    # shade

    def shaded(self) -> Iterator[Shaded]:
        """Light the scene from each angle in turn, all at the same exposure."""
        self.require("plan")  # for all the angles
        lights = self.lights
        # One light is shaded once. With several, a first pass finds the exposure, which avoids holding all in memory.
        first = self.shading(lights[0])
        if not first.radiance.any() and lights[0].radiance.any() and not self.light_kind.adds:
            message = "no vertex receives any light: the scene is closed, or its faces and normals point inwards"
            warnings.warn(message, DataWarning, stacklevel=2)
        exposure = self.mix.exposure(lights, first.radiance)
        yield self._with_others(Shaded(lights[0], first, exposure))
        for light in lights[1:]:
            yield self._with_others(Shaded(light, self.shading(light), exposure))

    def let_go(self, shaded: Shaded) -> None:
        """Free the kept bounces, most of the memory, where files need only the light of the surfaces."""
        others = self.light_kind.adds or self.asked_inserts or self.request.baked or set(self.formats) - OF_SURFACES
        if not others and self.relighter.cache.settings_of("bounces"):
            self.relighter.precomputed.forget(shaded.shading.settings._replace(bounce_rays=0))

    @cached_property
    def inserts(self) -> "Inserts | None":
        """The inserted objects at their positions, or None."""
        if not self.asked_inserts:
            return None
        from ..insert.inserts import Inserts

        return Inserts(self.asked_inserts, self.relighter, lambda: self.appearance, self._object_of)

    @property
    def insert_plan(self) -> "InsertPlan | None":
        """The share of the scene that the objects change, and its cost; None without objects."""
        if self.inserts is None:
            return None
        from ..insert.insert_plan import evenly_lit, plan_inserts

        around = evenly_lit(self.scene, self.relighter.occluder)
        splats = self.splats[0] if self.shows_splats and self.splats is not None else None
        return plan_inserts(self.inserts.standing, self.scene, around, splats)

    def _object_of(self, asked: "AskedInsert") -> "InsertedObject":
        """A requested object. A splat is meshed first, like a scene, and its captured light is removed."""
        if asked in self.inserted_meshes:
            return self.inserted_meshes[asked]
        from ..insert.splat_insert import splat_object

        folder, source = asked.source, asked.source
        if not isinstance(source, Mesh) and not is_scene(source):
            folder, _ = scene_folder(source, ConvertOptions(), self.stages)
        own = Job(RelightRequest(folder, CAPTURED, formats=("splat",)), self.stages)
        assert own.splats is not None  # or an InputError
        return splat_object(asked.name, own.scene, own.binding, len(own.splats[0]), own.appearance)

    def lamps_shown(self, light: Environment, exposure: float) -> "PlacedLamps":
        """The lamps beside a light at an exposure, in the frame of the scene and in display values."""
        known = not self.asked_lamps or self.request.exposure_ev is None
        radiance = self.appearance.captured if known else self.shading(light).radiance
        return PlacedLamps(self.mix.lamps_shown(light, radiance, exposure), [each.name for each in self.asked_lamps])

    def _with_others(self, shaded: Shaded) -> Shaded:
        shaded = self.mix.mixed(shaded) if self.light_kind.adds else shaded
        return shaded if self.inserts is None else self._with_objects(shaded, self.inserts)

    def light_around(self, shaded: Shaded) -> "Light":
        """The skies of one of the lights, and the radiance of captured lamps in it."""
        from .object_surroundings import light_under

        return light_under(shaded, self.mix)

    def _with_objects(self, shaded: Shaded, inserts: "Inserts") -> Shaded:
        from .object_surroundings import surroundings_under

        shading = shaded.shading
        around, received = surroundings_under(shaded, self.mix), shading.received
        if received is None:
            received = self.appearance.received(shading.radiance, shaded.exposure)
        inserted = inserts.under(around, received)
        shading = shading._replace(radiance=shading.radiance * inserted.ratio, received=received)
        return shaded._replace(shading=shading, inserted=inserted)

    def light_parts(self, shaded: Shaded) -> dict[str, NDArray[np.float32]]:
        """Exit radiance of surfaces under one of the lights, (V, 3), by the path of the light.

        direct: from the environment. sun: the part of direct from single suns. bounced: from other surfaces. room: from
        the environment and captured lamps in a closed room, whose model does not separate paths. captured: from the
        captured light. lamps: from added lamps, bounces included. All but sun sum to the radiance.
        """
        own, scale, parts = self.shading(shaded.light), np.float32(1.0), {}
        if self.light_kind.adds:
            parts, scale = self.mix.parts(self.mix.level(own.radiance)), np.float32(self.mix.env_scale)
        if scale > 0.0 and own.radiance.any():
            if self.room:
                parts["room"] = scale * own.radiance
            else:
                direct, sun = self.relighter.direct(shaded.light, own.settings)
                albedo = scale if self.appearance.albedo is None else scale * self.appearance.albedo
                parts["direct"], parts["bounced"] = albedo * direct, scale * own.radiance - albedo * direct
                parts |= {} if sun is None else {SUN: np.minimum(albedo * sun, parts["direct"])}
        ratio = 1.0 if shaded.inserted is None else shaded.inserted.ratio
        return {name: np.asarray(part * ratio, np.float32) for name, part in parts.items()}

    def shading(self, light: Environment) -> Shading:
        """The scene under an environment alone; black for the captured light."""
        return self.mix.alone_under(light)
