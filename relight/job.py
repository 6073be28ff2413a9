"""A scene and a light, from files to radiance. Every stage is done when it is asked for; `writing` writes the results.

job = Job(RelightRequest("garden", "sunset", LightingOptions(tolerance=0.02), angles_deg=(45.0,)))
job.plan                load, albedo, plan
job.shaded()            shade
"""

import os
import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.choices import check_choice
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.progress import Stages
from splat2mesh.scene.foreign import as_scene
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import source_splats
from splat2mesh.splats.splats import Splats

from .engine.appearance import CHOICES, LEAST_ALBEDO, Appearance, albedo_kept, appearance_of
from .engine.exposure import exposure_as_captured, level_of
from .engine.mixing import CapturedPart, mixed
from .engine.relighter import Relighter, Shaded, Shading
from .light import CAPTURED
from .light.captured import CapturedLight
from .light.environment import Environment
from .light.tonemap import auto_exposure
from .options import DEFAULT_TOLERANCE, PLACE_TOLERANCE, LightingOptions
from .output.kinds import FILES, OF_SPLATS
from .request import AnyLight, RelightRequest
from .transfer.store import Cache

if TYPE_CHECKING:
    from .engine.placed import LampLight
    from .engine.relit_room import RelitRoom
    from .lamps.asked import AskedLamp, LampScale
    from .lamps.shapes import Lamp
    from .live.mixture import Mixture
    from .output.lamps_glb import PlacedLamps
    from .planning.plan import Plan
    from .splats import Binding
    from .viewer.mixture import Mixture
    from .viewer.splats import SplatSource

DEFAULT_FORMATS = ("glb", "png")
"""What is written where nobody says; with a splat, that too."""

OF_ONE_LIGHT = frozenset({"environment", "plan", "lights", "room"})
"""Stages of a Job that another light does not share."""


class Job:
    """A request of a relight, done stage by stage. Nothing is read or computed before it is asked for.

    request: RelightRequest of one light. stages: Stages that time the work.
    Raises InputError, then, for whatever cannot be read or used.
    """

    def __init__(self, request: RelightRequest, stages: Stages | None = None) -> None:
        self.request, self.stages = request, stages or Stages()

    def under(self, env: AnyLight) -> "Job":
        """The same job under another light: all that does not depend on the light is shared."""
        self.require("appearance", "formats")
        other = Job(self.request.under(env), self.stages)
        done = {name: made for name, made in vars(self).items() if name not in vars(other)}
        vars(other).update({name: made for name, made in done.items() if name not in OF_ONE_LIGHT})
        return other

    def require(self, *stages: str) -> None:
        """Do stages now, by the names of their attributes: what fails, fails before the work that follows."""
        for name in stages:
            getattr(self, name)

    # load

    @cached_property
    def environment(self) -> Environment:
        """The light, not turned."""
        with self.stages.stage("environment"):
            return light_of(self.request.env)

    @cached_property
    def scene(self) -> Scene:
        """What is lit; of an animation its first frame."""
        self.require("environment", "asked_lamps")  # a light that cannot be read fails before a scene is read
        with self.stages.stage("load"):
            return self.animation.scene if self.request.animated else as_scene(self.request.scene)

    @cached_property
    def splats(self) -> tuple[Splats, list[Path]] | None:
        """The splats that the scene was made from and the paths of their files; None for a mesh, which has none.

        Where nobody asked for them and they are not found, None, with a DataWarning.
        """
        wanted = bool(set(OF_SPLATS) & set(self.request.formats or ()))
        asked = wanted or (self._of_splats and (bool(self.request.baked) or self.request.splat is not None))
        if not asked and "sha256" not in self.scene.source:
            return None
        with self.stages.stage("load"):
            try:
                return source_splats(self.scene, self.request.splat)
            except InputError as error:
                if asked:
                    raise
                message = f"{error}; without it no splat is relit, and the picture shows the mesh"
                warnings.warn(message, DataWarning, stacklevel=2)
                return None

    @cached_property
    def formats(self) -> tuple[str, ...]:
        """What is written of each light, of `output.kinds.FILES`."""
        if self.request.formats is not None:
            for word in self.request.formats:
                check_choice("formats", word, tuple(FILES))
            return tuple(self.request.formats)
        return DEFAULT_FORMATS if self.splats is None else (*DEFAULT_FORMATS, "splat")

    @cached_property
    def options(self) -> LightingOptions:
        """The options that were given, with the tolerance that the scene calls for where they name none."""
        return self.request.lighting.planned(PLACE_TOLERANCE if self.scene.is_place else DEFAULT_TOLERANCE)

    @cached_property
    def relighter(self) -> Relighter:
        """The Relighter of the scene."""
        if self.shows_splats:
            self.require("splats")  # a missing splat fails before any work
        if "usd" in (self.request.formats or ()):
            from .output.usd import library

            library()  # so is a package
        shown = (lambda: self.binding.used) if self._shows_splats_alone else None
        return Relighter(self.scene, self.options, stages=self.stages, cache=self.cache, shown=shown)

    @cached_property
    def cache(self) -> Cache | None:
        """Where what is computed is kept, or None."""
        return Cache.of_scene(self.scene, self.request.caching == "read") if self.request.caching != "none" else None

    @cached_property
    def binding(self) -> "Binding":
        """The Binding of the splats. Raises InputError where there are none."""
        from .splats import Binding

        if self.splats is None:
            raise InputError(f"{self.name}: no splats belong to this scene")
        with self.stages.stage("bind splats"):
            return Binding(self.splats[0], self.scene, seed=self.request.lighting.seed, cache=self.cache)

    # albedo

    @cached_property
    def appearance(self) -> Appearance:
        """Albedo and captured colours of the surfaces."""
        relighter = self.relighter
        with self.stages.stage("load"):
            capture_env = self._capture_env()
        look = appearance_of(self._choice, capture_env, relighter)
        if self.options.opened:  # a room whose own light is not known is lit by its captured colours
            return look._replace(kept=False)
        shut = look.room is not None and look.room.told["windows"] is None
        return look._replace(kept=True) if shut and self.options.lamps in ("keep", 1.0) else look

    # plan

    @cached_property
    def plan(self) -> "Plan | None":
        """The Plan for all the angles; None where there is nothing to plan: a method without, a room that is kept."""
        albedo, room = self.appearance.albedo, self.room
        if self.steady or self.keeps_captured:
            return None
        return (room.lit if room else self.relighter).plan_for(self.environment, albedo, len(self.request.angles_deg))

    def planned(self) -> tuple["Plan | None", str]:
        """The Plan without any work that takes long, and a note on what it leaves open, or "".

        Where the albedo was not estimated yet, it plans with the captured colours.
        """
        if self.choice_name != "estimated" or "appearance" in self.__dict__:
            return self.plan, ""
        relighter = self.relighter
        albedo = albedo_kept(
            None if self.request.capture_env is None else light_of(self.request.capture_env), relighter
        )
        note = "" if albedo is not None else "the albedo is not estimated yet: planned with the captured colours"
        used = self.scene.colors_linear if albedo is None else albedo
        return relighter.plan_for(self.environment, used, len(self.request.angles_deg)), note

    # shade

    def shaded(self) -> Iterator[Shaded]:
        """Light the scene from angle after angle, all at the same exposure."""
        self.require("plan")  # for all the angles
        lights = self.lights
        # One light is shaded once; of many the first pass only finds the exposure, or all would be in memory at once.
        first = self._shading(lights[0])
        if not first.radiance.any() and lights[0].radiance.any() and not self.mixes:
            message = "no vertex receives any light: the scene is closed, or its faces and normals point inwards"
            warnings.warn(message, DataWarning, stacklevel=2)
        exposure = self._exposure(first)
        yield self._mixed(Shaded(lights[0], first, exposure))
        for light in lights[1:]:
            yield self._mixed(Shaded(light, self._shading(light), exposure))

    def session(self) -> dict[str, Any]:
        """Keyword arguments of `viewer.view` for this job: its albedo first, and the lights beside its own."""
        look, room = self.appearance, self.room
        others = {"captured": look.captured, "white": None}
        chosen = self.choice_name if self.choice_name in CHOICES else Path(self.choice_name).stem
        lights = Path(self.light_name)
        exposure = None if self.request.exposure_ev is None else 2.0**self.request.exposure_ev
        albedo, by_lamps = (look.albedo, None) if room is None else room.session()
        exposure = room.exposure if room and exposure is None else exposure
        opened = self.options.opened is not None
        albedos = {chosen: albedo, **{name: each for name, each in others.items() if name != chosen}}
        mixture = self._mixture_of_session() if self.mixes else None
        if mixture is not None:  # what lamps light is known for one albedo
            albedos, exposure = {chosen: albedo}, mixture.level if exposure is None else exposure
            by_lamps = None if self.keeps_captured or self.steady else by_lamps
        return {
            "scene": room.lit.scene if room and opened else self.scene,
            "environment": self.lights[0],
            "options": replace(self.options, budget_s=None).planned(),  # a session has a tolerance
            "albedos": albedos,
            "environments_folder": lights.parent if lights.is_file() else None,
            "exposure": exposure,
            "cache": None if opened else self.relighter.cache,
            "lamps": {} if by_lamps is None else {chosen: by_lamps},
            "lamps_known": bool(room and room.lamps_found),
            "state": {"lamps": self.options.lamp_factor},
            "splats": None if opened or self.splats is None else self._splats_of_session(chosen, mixture),
            "mixture": mixture,
        }

    def _mixture_of_session(self) -> "Mixture":
        """What the light has beside an environment, as `shaded` mixes it."""
        from .viewer.mixture import Mixture

        options, alone, factor = self.options, self.keeps_captured or self.steady, self.captured_factor
        nothing = Shading(np.zeros_like(self.appearance.captured), 0, [], options.unplanned)
        measured = alone or self._brightness is not None or bool(self.room and self.room.exposure is not None)
        first = nothing if measured else self._shading(self.lights[0])
        level = self._level_of_mixture(Shaded(self.lights[0], first, 1.0))
        rest = self._mixed(Shaded(self.lights[0], nothing, 1.0), level)
        assert rest.shading.received is not None  # of a mixture it is known
        scale = 0.0 if self.steady else options.env_scale
        backdrop = factor if alone else options.env_scale
        parts = rest.shading.radiance, rest.shading.received
        return Mixture(*parts, scale, level, backdrop, self.keeps_captured)

    def _splats_of_session(self, chosen: str, mixture: "Mixture | None" = None) -> "SplatSource":
        """The splats as a session shows them: by its own albedo, or by the captured colours."""
        from .splats import shown_as_sky
        from .viewer.splats import SplatLook, SplatSource

        look, room, splats = self.appearance, self.room, self.splats
        assert splats is not None

        def received(radiance: NDArray[np.float32], exposure: float) -> NDArray[np.float32]:
            if look.kept:  # the session shows the captured colours, times what its lamps are dimmed by
                return look.irradiance * (radiance + LEAST_ALBEDO) / (look.captured + np.float32(LEAST_ALBEDO))
            if room and look.room is not None:
                radiance = room.as_captured(radiance, self.options.unplanned)
            return np.asarray(look.received(radiance, exposure), np.float32)

        def binding() -> "Binding":
            if not look.kept:
                received(np.zeros_like(look.captured), 1.0)  # the light of the capture in a room takes long, once
            return self.binding

        looks = {chosen: SplatLook(look.irradiance, received if mixture is None else mixture.receives(received))}
        if mixture is None and chosen != "captured" and room is None:
            least = np.maximum(look.captured, np.float32(LEAST_ALBEDO))
            looks["captured"] = SplatLook(
                np.ones_like(look.captured), lambda radiance, _: np.asarray(radiance / least, np.float32)
            )
        level = self._brightness if look.kept and mixture is None else None
        return SplatSource(splats[0], binding, looks, lambda: shown_as_sky(splats[0], self.scene, look), level)

    @cached_property
    def room(self) -> "RelitRoom | None":
        """The closed room that the scene is, or None."""
        look, options = self.appearance, self.options
        closed = look.capture is not None and "room" in look.capture
        if options.opened and not closed:
            raise InputError("`opened` ceiling: expected a closed room that was captured from within, found none")
        room = None
        if closed:
            from .engine.relit_room import RelitRoom

            room = RelitRoom(look, self.relighter, self._level)
        if isinstance(options.lamps, tuple):
            options.lamp_factors(room.lamps_found if room else 0)
        elif options.lamps != "keep" and not (room and room.lamps_found):
            told = "`lamps`: no lamp was found whose strength is known, and none is changed"
            warnings.warn(told, DataWarning, stacklevel=4)
        return room

    @property
    def steady(self) -> bool:
        """Whether no environment changes anything here: a closed room that stays as captured, or has no window."""
        return bool(self.room and self.room.steady)

    @property
    def _brightness(self) -> float | None:
        return self.appearance.capture["brightness"] if self.appearance.capture else None

    @property
    def _level(self) -> float:
        """Captured units per unit of the light's radiance, for it to be as bright as that of the capture was."""
        return level_of(self._brightness, self.environment)

    @property
    def keeps_captured(self) -> bool:
        """Whether the light is that of the capture, changed or not."""
        return isinstance(self.environment, CapturedLight)

    @property
    def from_inside(self) -> bool:
        """Whether the scene was captured from within."""
        return self.scene.capture.get("from") == "inside"

    @property
    def lamps_found(self) -> list[dict[str, Any]]:
        """What the report tells of the captured lamps of a closed room, by number."""
        room = self.appearance.room
        return [] if room is None else list(room.told["lamps"])

    @property
    def mixes(self) -> bool:
        """Whether the new light has other parts than an environment as it is."""
        options = self.options
        others = bool(options.placed) or options.captured is not None or options.env_scale != 1.0
        return others or self.keeps_captured

    @cached_property
    def lamp_scale(self) -> "LampScale":
        """How long a metre is here, and how bright the captured light, for what is asked of lamps."""
        from .engine.lamp_scale import lamp_scale

        return lamp_scale(self.scene, self.appearance, self.relighter.occluder)

    @property
    def lamp_scale_known(self) -> bool:
        """Whether the capture tells how long a metre is."""
        return bool(self.scene.capture.get("eyes"))

    @cached_property
    def lamps(self) -> "list[Lamp]":
        """The lamps that are put in, in the frame of the splat and in units of the picture."""
        from .lamps.asked import resolve

        return [resolve(each, self.lamp_scale) for each in self.asked_lamps]

    @cached_property
    def asked_lamps(self) -> "list[AskedLamp]":
        """The lamps that are put in, as they are asked for."""
        from .lamps.placing import asked_lamps

        return asked_lamps(self.request.lighting.placed)

    @cached_property
    def lamp_light(self) -> "LampLight | None":
        """The light of the lamps that are put in, or None."""
        if not self.options.placed:
            return None
        from .engine.placed import LampLight
        from .lamps.moving import moved

        tolerance = self.options.tolerance or DEFAULT_TOLERANCE
        lamps = [moved(lamp, self.scene.scene_from_splat) for lamp in self.lamps]
        return LampLight(self.relighter, self.appearance, lamps, tolerance, self.captured_factor)

    def lamps_shown(self, light: Environment, exposure: float) -> "PlacedLamps":
        """The lamps beside a light that is shown at an exposure, in the frame of the scene and in display values."""
        from .lamps.photometry import times
        from .output.lamps_glb import PlacedLamps

        if self.lamp_light is None:
            return PlacedLamps()
        factor = 1.0
        if self.request.exposure_ev is not None:
            factor = exposure / self.level_under(light, self._shading(light).radiance)
        lamps = [times(lamp, factor) for lamp in self.lamp_light.lamps]
        return PlacedLamps(lamps, [each.name for each in self.asked_lamps])

    @property
    def captured_factor(self) -> float:
        """How much of the captured light stays, where the light is a mixture."""
        given = self.options.captured
        return float(self.keeps_captured or self.steady) if given is None else given

    @property
    def lamps_in_words(self) -> list[str]:
        """A line on each lamp that is put in: where it is, and how bright."""
        from .lamps.asked import in_words
        from .lamps.placing import in_brief

        place = "room" if self.from_inside else "scene"
        return [f"{in_brief(lamp)}: {in_words(lamp, self.lamp_scale, place)}" for lamp in self.lamps]

    def _mixed(self, shaded: Shaded, level: float | None = None) -> Shaded:
        """The same light with all its other parts. level: as of `_level_of_mixture`, where it is known."""
        if not self.mixes:
            return shaded
        options, alone, captured = self.options, self.keeps_captured or self.steady, self.captured_factor
        own = self.room.with_its_own_light() if self.room and captured else self.appearance.captured
        placed = None if self.lamp_light is None else self.lamp_light.placed
        level, shading = self._level_of_mixture(shaded) if level is None else level, shaded.shading
        if alone:  # the shading of a room that no environment changes is what was captured
            shading = shading._replace(radiance=np.zeros_like(own))
        shading = mixed(self.appearance, shading, options.env_scale, CapturedPart(own, captured), placed, level)
        return Shaded(shaded.light, shading, shaded.exposure, captured if alone else options.env_scale)

    def _level_of_mixture(self, shaded: Shaded) -> float:
        """Units of the picture per unit of the environment."""
        if self.keeps_captured or self.steady:
            return 1.0
        if self.room and self.room.exposure is not None:
            return self.room.exposure
        return self._level if self._brightness is not None else auto_exposure(shaded.shading.radiance)

    @property
    def mixture(self) -> "Mixture":
        """What is beside the environment, for what is live."""
        from .live.mixture import Mixture

        options, placed, room = self.options, self.lamp_light is not None, self.room
        asked = placed or options.captured is not None or options.env_scale != 1.0
        colors = room.with_its_own_light() if room and (asked or self.keeps_captured) else None
        names = [each.name for each in self.asked_lamps]
        lamps = self.lamps if placed else []
        exposed = self.request.exposure_ev is not None
        return Mixture(asked, options.captured, options.env_scale, self.lamp_light, lamps, names, colors, exposed)

    def level_under(self, light: Environment, radiance: NDArray[np.float32] | None) -> float:
        """Units of the picture per unit of another light, as `exposure_of` takes it."""
        if isinstance(light, CapturedLight) or self.steady:
            return 1.0
        if self._brightness is None and radiance is not None:
            return auto_exposure(radiance)
        return level_of(self._brightness, light)

    def _shading(self, light: Environment) -> Shading:
        if isinstance(light, CapturedLight):
            return Shading(np.zeros_like(self.appearance.captured), 0, [], self.options.unplanned)
        if self.room:
            return self.room.shading(light)
        return self.relighter.shading(light, self.appearance.albedo)

    def _capture_env(self) -> Environment | None:
        return None if self.request.capture_env is None else light_of(self.request.capture_env)

    @cached_property
    def animation(self) -> Any:
        """The Animation that the scene is a frame of."""
        from .animation.animation import Animation

        return Animation(str(self.request.scene))

    @cached_property
    def _of_splats(self) -> bool:
        """Whether the scene was made from a splat: a mesh's colours are its maker's albedo, a splat's are not."""
        return bool(self.scene.source) or (self.scene.path is not None and Path(self.scene.path).is_dir())

    @property
    def _choice(self) -> Any:
        """What the albedo is taken from."""
        return ("estimated" if self._of_splats else "captured") if self.request.albedo is None else self.request.albedo

    @property
    def choice_name(self) -> str:
        """What the albedo is taken from, as the report names it."""
        return "array" if isinstance(self._choice, np.ndarray) else str(self._choice)

    @cached_property
    def lights(self) -> list[Environment]:
        """The light, turned by each of the angles."""
        return [self.environment.rotated(angle) for angle in self.request.angles_deg]

    @property
    def _shows_splats_alone(self) -> bool:
        """Whether nothing of a place is shown but its splats, so that no vertex beside them needs light of its own."""
        alone = (
            not self.request.baked
            and self.request.formats is not None
            and set(self.request.formats) <= {"splat", "png"}
        )
        return alone and not self.request.animated and self.scene.is_place and self.splats is not None

    @property
    def shows_splats(self) -> bool:
        """Whether any result needs the splats: pictures show them too."""
        baked, formats = self.request.baked, self.request.formats
        return bool(baked) or formats is None or not {*OF_SPLATS, "png"}.isdisjoint(formats)

    @property
    def name(self) -> str:
        """The scene as the report names it."""
        given = self.request.scene
        if isinstance(given, (str, os.PathLike)):
            return str(Path(given))
        return str(self.scene.path or self.scene.source.get("file", "a mesh in memory"))

    @property
    def light_name(self) -> str:
        """The light as the report names it."""
        env = self.request.env
        return env.name if isinstance(env, Environment) else str(env)

    def _exposure(self, first: Shading) -> float:
        """Display value per unit of radiance: 2^EV; else that of the capture's camera under as bright a sky, but within
        a stop of what the brightest vertices in any of the lights call for, which it is where no capture is known."""
        if self.request.exposure_ev is not None:
            return 2.0**self.request.exposure_ev
        if self.mixes:  # lamps are told in units of the picture
            return self._level_of_mixture(Shaded(self.environment, first, 1.0))
        if self.room and self.room.exposure is not None:
            return self.room.exposure
        others = (self._shading(light).radiance for light in self.lights[1:])
        least = min([auto_exposure(first.radiance), *map(auto_exposure, others)])
        return exposure_as_captured(self._brightness, self.appearance.captured, self.environment, least)

    def exposure_of(self, light: Environment, radiance: NDArray[np.float32] | None) -> float:
        """The same for one other light. radiance: None in a room whose exposure is known."""
        if self.request.exposure_ev is not None:
            return 2.0**self.request.exposure_ev
        if radiance is None:
            return level_of(self._brightness, light)
        return exposure_as_captured(self._brightness, self.appearance.captured, light, auto_exposure(radiance))


def light_of(source: AnyLight) -> Environment:
    """The Environment itself, or what is read of a file or made by name."""
    if isinstance(source, Environment):
        return source
    return CapturedLight() if source == CAPTURED else Environment.load(source)
