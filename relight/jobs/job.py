"""A scene and a light, from files to radiance. Every stage runs on first use; `writer` writes the results.

job = Job(RelightRequest("garden", "sunset", LightingOptions(tolerance=0.02), angles_deg=(45.0,)))
job.plan                load, albedo, plan
job.shaded()            shade
"""

import warnings
from collections.abc import Iterator
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning
from splat2mesh.base.progress import Stages

from ..engine.appearance import Appearance, albedo_kept
from ..engine.exposure import level_of
from ..engine.light_mix import LightKind, LightMix, kind_of
from ..engine.relighter import Relighter, Shaded
from ..engine.relit_room import RelitRoom
from ..light.daylight import DaylightRequest
from ..light.environment import Environment
from ..light.loading import light_of
from ..output.kinds import SUN
from ..output.lamps_glb import PlacedLamps
from ..request import AnyLight, RelightRequest
from .inputs import Inputs
from .known_scene import KnownScene
from .meshing import SceneAtHand
from .object_surroundings import surroundings_under

if TYPE_CHECKING:
    from ..engine.placed import LampLight
    from ..planning.plan import Plan

OF_SURFACES = frozenset({"glb", "ply", "npy", "png", "splat"})
"""Formats that need nothing but the light of the surfaces."""


class Job:
    """A relight request under one light, processed stage by stage. Every stage reads and computes on first use.

    request: RelightRequest of one light. stages: Stages that time the work. at_hand: what was read of the scene before.
    known: what is known of the scene under another light. Stages raise InputError for input that cannot be read or
    used.
    """

    def __init__(
        self,
        request: RelightRequest,
        stages: Stages | None = None,
        at_hand: SceneAtHand | None = None,
        known: KnownScene | None = None,
    ) -> None:
        self.request = request
        self.known = KnownScene(Inputs(request, stages, at_hand)) if known is None else known
        self.inputs, self.stages = self.known.inputs, self.known.inputs.stages

    _metre: float | None = None
    """Splat units in a metre, where another pose says it."""

    def under(self, env: AnyLight) -> "Job":
        """The same job under another light. Both share what is known of the scene."""
        return Job(self.request.under(env), known=self.known)

    def posed(self, relighter: Relighter, look: Appearance) -> "Job":
        """The same job on another pose of its scene: that of a Relighter, with its Appearance there."""
        known = copy(self.known)
        known.scene, known.relighter, known.appearance = relighter.scene, relighter, look
        other = Job(self.request, known=known)
        other._metre = self.mix.scale.metre if self.inputs.asked_lamps else None
        return other

    def under_kept_light(self) -> "Job":
        """The same job under the captured light that the folder of the scene keeps by now."""
        known, other = self.known, KnownScene(self.inputs)
        other.scene, other.relighter = known.scene, known.relighter.under_kept_light()
        if self.inputs.splats is not None:
            other.binding = known.binding
        return Job(self.request, known=other)

    def begin(self) -> None:
        """As `KnownScene.begin`."""
        _ = self.known.relighter  # before the light is asked for
        traces = self.light_kind is not LightKind.CAPTURED
        self.known.begin(traces or any(each.has_own for each in self.inputs.lit_parts))

    # the light

    @cached_property
    def environment(self) -> Environment:
        """The light, not turned."""
        if self.request is self.inputs.request:
            return self.inputs.environment
        with self.stages.stage("environment"):
            return light_of(self.request.light)

    @cached_property
    def lights(self) -> list[Environment]:
        """The light, turned by each of the angles."""
        return [self.environment.rotated(angle) for angle in self.request.angles_deg]

    @property
    def light_name(self) -> str:
        """The light as the report names it."""
        env = self.request.light
        return env.name if isinstance(env, (Environment, DaylightRequest)) else str(env)

    @cached_property
    def room(self) -> RelitRoom | None:
        """The closed room that the scene is, or None."""
        look, options, room = self.known.appearance, self.inputs.options, None
        if look.capture is not None and "room" in look.capture:
            room = RelitRoom(look, self.known.relighter, level_of(look.capture["brightness"], self.environment))
        if isinstance(options.lamps, tuple):
            _ = room.lamp_factors if room else options.lamp_factors(0)  # or an InputError
        elif options.lamps != "keep" and not (room and room.lamps_found):
            message = "`lamps`: found no lamp of known strength, so none is changed"
            warnings.warn(message, DataWarning, stacklevel=4)
        return room

    @property
    def assumed(self) -> dict[str, Any] | None:
        """The assumption for an environment without a known way in, JSON-clean: the share of the captured
        light that comes from outside, and the factor on it, RGB; None without an assumption."""
        change = self.mix.assumed
        if self.room is None or change is None:
            return None
        return {"outside": self.room.outside, "change": [round(float(each), 4) for each in change]}

    @property
    def light_kind(self) -> LightKind:
        """What the new light is."""
        return kind_of(self.inputs.options, self.environment)

    @cached_property
    def mix(self) -> LightMix:
        """All light on the scene."""
        asked = self.inputs.options, self.inputs.asked_lamps, self.environment
        relighter, look, exposure_ev = self.known.relighter, self.known.appearance, self.request.exposure_ev
        return LightMix(*asked, relighter, look, self.room, exposure_ev, self._metre)

    @property
    def lamp_light(self) -> "LampLight | None":
        """The light of lamps beside every environment, or None."""
        return self.mix.lamp_light if self.light_kind.adds else None

    # plan

    @cached_property
    def plan(self) -> "Plan | None":
        """The Plan for all angles; None for a method without a plan and for a room that stays as captured."""
        albedo = self.known.appearance.albedo
        if self.known.appearance.as_captured or self.light_kind is LightKind.CAPTURED:
            return None
        return self.known.relighter.plan_for(self.environment, albedo, len(self.request.angles_deg))

    def planned(self) -> tuple["Plan | None", str]:
        """The Plan without any long work, and a note on its assumption, or "".

        Without an estimate of the albedo, it plans with the captured colours.
        """
        if self.inputs.choice_name != "estimated" or self.known.has_appearance:
            return self.plan, ""
        relighter = self.known.relighter
        light = self.known.capture_env()
        known = self.known.gloss is None or self.known.gloss.known
        albedo = None if not known else albedo_kept(light, relighter)
        note = "" if albedo is not None else "the albedo is not estimated yet: planned with the captured colours"
        used = self.known.scene.colors_linear if albedo is None else albedo
        return relighter.plan_for(self.environment, used, len(self.request.angles_deg)), note

    # shade

    def shaded(self) -> Iterator[Shaded]:
        """Light the scene from each angle in turn, all at the same exposure."""
        _ = self.plan  # for all the angles
        lights = self.lights
        # One light is shaded once. With several, a first pass finds the exposure, which avoids holding all in memory.
        first = self.mix.alone_under(lights[0])
        if not first.radiance.any() and lights[0].radiance.any() and not self.light_kind.adds:
            message = "no vertex receives any light: the scene is closed, or its faces and normals point inwards"
            warnings.warn(message, DataWarning, stacklevel=2)
        exposure = self.mix.exposure(lights, first.radiance)
        yield self.beside(Shaded(lights[0], first, exposure))
        for light in lights[1:]:
            yield self.beside(Shaded(light, self.mix.alone_under(light), exposure))

    def let_go(self, shaded: Shaded) -> None:
        """Free the kept bounces, most of the memory, where files need only the light of the surfaces."""
        others = (
            self.light_kind.adds
            or self.inputs.asked_inserts
            or self.request.parts
            or self.request.baked
            or set(self.inputs.formats) - OF_SURFACES
        )
        if not others and self.known.relighter.cache.settings_of("bounces"):
            self.known.relighter.precomputed.forget(shaded.shading.settings._replace(bounce_rays=0))

    def lamps_shown(self, light: Environment, exposure: float) -> "PlacedLamps":
        """The lamps beside a light at an exposure, in the frame of the scene and in display values."""
        known = not self.inputs.asked_lamps or self.request.exposure_ev is None
        radiance = self.known.appearance.captured if known else self.mix.alone_under(light).radiance
        return PlacedLamps(
            self.mix.lamps_shown(light, radiance, exposure), [each.name for each in self.inputs.asked_lamps]
        )

    def beside(self, shaded: Shaded) -> Shaded:
        """What an environment alone shades, with all light beside it and with added objects."""
        shaded = self.mix.mixed(shaded) if self.light_kind.adds else shaded
        if self.known.inserts is None:
            return shaded
        shading = shaded.shading
        around, received = surroundings_under(shaded, self.mix), shading.received
        if received is None:
            received = self.known.appearance.received(shading.radiance, shaded.exposure)
        inserted = self.known.inserts.under(around, received)
        shading = shading._replace(radiance=shading.radiance * inserted.ratio, received=received)
        return shaded._replace(shading=shading, inserted=inserted)

    def light_parts(self, shaded: Shaded) -> dict[str, NDArray[np.float32]]:
        """Exit radiance of surfaces under one of the lights, (V, 3), by the path of the light.

        direct: from the environment. sun: the part of direct from single suns. bounced: from other surfaces. room: from
        the environment and captured lamps in a closed room, whose model does not separate paths. captured: from the
        captured light. lamps: from added lamps, bounces included. All but sun sum to the radiance.
        """
        own, scale, parts = self.mix.alone_under(shaded.light), np.float32(1.0), {}
        if self.light_kind.adds:
            parts, scale = self.mix.parts(self.mix.level(own.radiance)), np.float32(self.mix.env_scale)
        if scale > 0.0 and own.radiance.any():
            if self.room:
                parts["room"] = scale * own.radiance
            else:
                direct, sun = self.known.relighter.direct(shaded.light, own.settings)
                albedo = scale if self.known.appearance.albedo is None else scale * self.known.appearance.albedo
                parts["direct"], parts["bounced"] = albedo * direct, scale * own.radiance - albedo * direct
                parts |= {} if sun is None else {SUN: np.minimum(albedo * sun, parts["direct"])}
        ratio = 1.0 if shaded.inserted is None else shaded.inserted.ratio
        return {name: np.asarray(part * ratio, np.float32) for name, part in parts.items()}
