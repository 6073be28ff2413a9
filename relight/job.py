"""One run of relight: a scene and lights, results and a report into folders. Every stage is done when it is asked for.

job = Job("garden", "sunset", LightingOptions(tolerance=0.02), angles_deg=(45.0,))
job.plan                      load, albedo, plan
shaded = job.shaded()         shade
job.write(shaded, folders)    write
"""

import copy
import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.console import peak_mb
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.outputs import staged_folder
from splat2mesh.base.progress import Stages
from splat2mesh.base.strictjson import text_of
from splat2mesh.base.version import VERSION
from splat2mesh.scene.foreign import AnyScene, as_scene
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import source_splats
from splat2mesh.splats.splats import Splats

from .engine.appearance import CHOICES, Appearance, albedo_kept, appearance_of
from .engine.relighter import Relighter, Shading
from .light.environment import Environment
from .light.skies import BUILTIN
from .light.tonemap import auto_exposure
from .options import DEFAULT_TOLERANCE, PLACE_TOLERANCE, LightingOptions
from .output.engine_files import EngineFiles
from .output.kinds import FOR_ENGINES, OF_SPLATS
from .output.live_files import LiveFiles
from .output.results import PICTURE_SIZE, Results
from .transfer.store import Cache

if TYPE_CHECKING:
    from .engine.relit_room import RelitRoom
    from .planning.plan import Plan

DEFAULT_FORMATS = ("glb", "png")
"""What is written where nobody says; with a splat, that too."""

AnyLight = Environment | str | os.PathLike[str]
"""An Environment, a file, or the name of a built-in one."""


REPORT = "report.json"
"""In every folder of results, which is how they are told from other folders."""


class Shaded(NamedTuple):
    """A scene in one light. radiance of `shading`: (V, 3) float32 linear. exposure: display value per unit of it."""

    light: Environment
    shading: Shading
    exposure: float


class Job:
    """A scene under an environment at some angles. Nothing is read or computed before it is asked for.

    Raises InputError, then, for whatever cannot be read or used.
    """

    def __init__(
        self,
        scene: AnyScene,
        env: AnyLight = "studio",
        options: LightingOptions | None = None,
        *,
        angles_deg: Sequence[float] = (0.0,),
        albedo: str | os.PathLike[str] | NDArray[np.floating] | None = None,
        capture_env: AnyLight | None = None,
        exposure_ev: float | None = None,
        formats: Sequence[str] | None = None,
        baked: Sequence[str] = (),
        texture_size: int | None = None,
        splat: str | os.PathLike[str] | None = None,
        sky: str = "new",
        sheet: bool = False,
        lights: Sequence[AnyLight] = (),
        live_mesh: bool = False,
        harmonics: str = "zero",
        animated: bool = False,
        caching: str = "keep",
        stages: Stages | None = None,
        messages: list[str] | None = None,
    ) -> None:
        """What to light, and how.

        options: LightingOptions; within the default tolerance where they name neither that nor a budget. angles_deg:
        of the light. albedo: of `appearance_of`; by default "estimated" for what was made of a splat, "captured" for
        other meshes. capture_env: the light of the capture, where it is known. exposure_ev: show radiance times
        2^exposure_ev. formats: words of `output.kinds.FILES`; by default glb, png and, where the splat of the scene is
        found, splat. baked, texture_size: of `Results`. splat: the splat of the scene, where it is not where
        the scene says. sky: what becomes of its far background, of `splats.SKIES`. sheet: whether the lights are also
        shown beside what was captured. lights: others that what is live has beside its own and the built-in ones.
        live_mesh, harmonics: of `EngineFiles`. animated: whether the scene is an animated .glb. caching: "keep" what is
        computed in the scene's folder, "read" what was kept there, or "none". messages: the warnings so far, for the
        report.
        """
        self._wishes = options or LightingOptions()
        self.stages = stages or Stages()
        self.angles_deg = tuple(angles_deg)
        self._given, self._env, self._capture_env = scene, env, capture_env
        self._albedo, self._exposure_ev = albedo, exposure_ev
        self._formats = None if formats is None else tuple(formats)
        self._baked, self._texture_size = tuple(baked), texture_size
        self._splat, self._sky, self._animated, self._caching = splat, sky, animated, caching
        self._sheet, self._more_lights = sheet, tuple(lights)
        self._live_mesh, self._harmonics = live_mesh, harmonics
        self._messages = [] if messages is None else messages

    def under(self, env: AnyLight) -> "Job":
        """The same job under another light: all that does not depend on the light is shared."""
        self._results  # noqa: B018  what is shared is made first
        other = copy.copy(self)
        for name in ("environment", "plan", "_lights", "_room"):
            other.__dict__.pop(name, None)
        other._env = env
        return other

    # load

    @cached_property
    def environment(self) -> Environment:
        """The light, not turned."""
        with self.stages.stage("environment"):
            return _light(self._env)

    @cached_property
    def scene(self) -> Scene:
        """What is lit; of an animation its first frame."""
        self.environment  # noqa: B018  a light that cannot be read is told before a scene is
        with self.stages.stage("load"):
            return self._animation.scene if self._animated else as_scene(self._given)

    @cached_property
    def splats(self) -> tuple[Splats, list[Path]] | None:
        """The splats that the scene was made from and the paths of their files; None for a mesh, which has none.

        Where nobody asked for them and they are not found, None, with a DataWarning.
        """
        wanted = bool(set(OF_SPLATS) & set(self._formats or ()))
        asked = wanted or (self._of_splats and (bool(self._baked) or self._splat is not None))
        if not asked and "sha256" not in self.scene.source:
            return None
        with self.stages.stage("load"):
            try:
                return source_splats(self.scene, self._splat)
            except InputError as error:
                if asked:
                    raise
                message = f"{error}; without it no splat is relit, and the picture shows the mesh"
                warnings.warn(message, DataWarning, stacklevel=2)
                return None

    @cached_property
    def formats(self) -> tuple[str, ...]:
        """What is written of each light, of `output.kinds.FILES`."""
        if self._formats is not None:
            return self._formats
        return DEFAULT_FORMATS if self.splats is None else (*DEFAULT_FORMATS, "splat")

    @cached_property
    def options(self) -> LightingOptions:
        """The options that were given, with the tolerance that the scene calls for where they name none."""
        return self._wishes.planned(PLACE_TOLERANCE if self.scene.is_place else DEFAULT_TOLERANCE)

    @cached_property
    def relighter(self) -> Relighter:
        """The Relighter of the scene."""
        if self._shows_splats:
            self.splats  # noqa: B018  a splat that is missing is told before any work
        if "usd" in (self._formats or ()):
            from .output.usd import library

            library()  # so is a package
        cache = Cache.of_scene(self.scene, self._caching == "read") if self._caching != "none" else None
        return Relighter(self.scene, self.options, stages=self.stages, cache=cache)

    # albedo

    @cached_property
    def appearance(self) -> Appearance:
        """Albedo and captured colours of the surfaces."""
        relighter = self.relighter
        with self.stages.stage("load"):
            capture_env = None if self._capture_env is None else _light(self._capture_env)
        look = appearance_of(self._choice, capture_env, relighter)
        if self.options.opened:  # a room whose own light is not known is lit by its captured colours
            return look._replace(kept=False)
        shut = look.room is not None and look.room.told["windows"] is None
        return look._replace(kept=True) if shut and self.options.lamp_factor == 1.0 else look

    # plan

    @cached_property
    def plan(self) -> "Plan | None":
        """The Plan for all the angles; None where there is nothing to plan: a method without, a room that is kept."""
        albedo, room = self.appearance.albedo, self._room
        if self.steady:
            return None
        return (room.lit if room else self.relighter).plan_for(self.environment, albedo, len(self.angles_deg))

    def planned(self) -> tuple["Plan | None", str]:
        """The Plan without any work that takes long, and a note on what it leaves open, or "".

        Where the albedo was not estimated yet, it plans with the captured colours.
        """
        if self._choice_name != "estimated" or "appearance" in self.__dict__:
            return self.plan, ""
        relighter = self.relighter
        albedo = albedo_kept(None if self._capture_env is None else _light(self._capture_env), relighter)
        note = "" if albedo is not None else "the albedo is not estimated yet: planned with the captured colours"
        used = self.scene.colors_linear if albedo is None else albedo
        return relighter.plan_for(self.environment, used, len(self.angles_deg)), note

    # shade

    def shaded(self) -> Iterator[Shaded]:
        """Light the scene from angle after angle, all at the same exposure."""
        self.plan  # noqa: B018  for all the angles
        lights = self._lights
        # One light is shaded once; of many the first pass only finds the exposure, or all would be in memory at once.
        first = self._shading(lights[0])
        if not first.radiance.any() and lights[0].radiance.any():
            message = "no vertex receives any light: the scene is closed, or its faces and normals point inwards"
            warnings.warn(message, DataWarning, stacklevel=2)
        exposure = self._exposure(first)
        yield Shaded(lights[0], first, exposure)
        for light in lights[1:]:
            yield Shaded(light, self._shading(light), exposure)

    def relit_splats(self, shaded: Shaded) -> Splats:
        """The splats that the scene was made from, in its light."""
        return self._results.relit_splats(shaded.light, shaded.shading.radiance, shaded.exposure)

    # write

    def write(self, shaded: Shaded, folder: str | os.PathLike[str], overwrite: bool = False) -> dict[str, Any]:
        """Fill a folder with the results of one light; returns their report, JSON-clean.

        Raises InputError where the folder exists, unless it holds results and may be overwritten.
        """
        light, shading, exposure = shaded
        report = self.report(shaded)
        alone = self._sheet and len(self.angles_deg) == 1
        with staged_folder(folder, overwrite, REPORT) as staging:
            report["files"], told = self._results.write(staging, light, shading.radiance, exposure)
            if self._sheet:
                self._results.add_to_sheet(light, shading.radiance, exposure)
                report["files"] += [self._results.write_sheet(staging, 1)] * alone
            report.update(told)
            self._write_report(staging, report)
        return report

    def write_sheet(self, folder: str | os.PathLike[str]) -> Path:
        """Write all lights so far side by side, with what was captured; returns the path of the picture."""
        return Path(folder) / self._results.write_sheet(Path(folder))

    def report(self, shaded: Shaded) -> dict[str, Any]:
        """What was done and how, JSON-clean, without files and times."""
        light, shading, exposure = shaded
        settings = shading.settings
        return {
            "version": VERSION,
            "scene": self._name,
            "vertices": len(shading.radiance),
            "faces": len(self.scene.faces),
            "chunks": len(self.scene.chunks),
            "environment": {"name": light.name, "source": self._light_name, "repaired_pixels": light.repaired},
            "angle_deg": light.rotation_deg,
            "lamps": self.options.lamp_factor,
            "open": self.options.opened,
            "albedo": self._choice_name,
            "capture": self.appearance.capture,
            "method": settings.method,
            "bands": settings.bands,
            "rays": settings.rays,
            "effects": sorted(settings.effects),
            "suns": shading.sun_count,
            "bounces": [round(share, 6) for share in shading.bounces],
            "seed": self._wishes.seed,
            "plan": None if self.plan is None else self.plan.as_dict(),
            "rays_traced": self.relighter.rays_traced,
            "exposure": exposure,
            "files": [],
        }

    def film(
        self, folder: str | os.PathLike[str], fps: float = 24.0, overwrite: bool = False
    ) -> tuple[str, dict[str, Any]]:
        """Light every frame of an animated scene into a folder: a note on what is missing, or "", and the report."""
        from .animation.film import FILM, Frames, animate, frame_times

        self.plan  # noqa: B018
        albedo, animation, (light,) = self.appearance.albedo, self._animation, self._lights
        count = len(frame_times(animation.duration_s, fps))
        shading: Any = None

        def radiance_of(_: Scene, time_s: float) -> NDArray[np.float32]:
            nonlocal shading
            poses = animation.at(time_s)
            if time_s > 0.0:
                self.relighter.update_all({chunk: poses[chunk] for chunk in animation.moving}, 1.0 / fps)
            shading = self.relighter.shading(light, albedo)
            return shading.radiance

        def finish(staging: Path, written: Frames) -> None:
            frames.close()  # the report tells how long they took
            report.update(self.report(Shaded(light, shading, written.exposure)))
            report.update({"animation": animation.name, "frames": written.frames, "fps": fps})
            report["files"] = [f"{number:04d}.png" for number in range(written.frames)] + [FILM] * written.film
            self._write_report(staging, report)

        report: dict[str, Any] = {}
        exposure = None if self._exposure_ev is None else 2.0**self._exposure_ev
        picture: dict[str, Any] = {"width": PICTURE_SIZE[0], "height": PICTURE_SIZE[1], "overwrite": overwrite}
        with ExitStack() as frames:
            advance = frames.enter_context(self.stages.stage("frames", count))
            written = animate(
                animation, radiance_of, light, folder, fps, exposure=exposure, advance=advance, finish=finish, **picture
            )
        return written.note, report

    def session(self) -> dict[str, Any]:
        """Keyword arguments of `viewer.view` for this job: its albedo first, and the lights beside its own."""
        look, room = self.appearance, self._room
        others = {"captured": look.captured, "white": None}
        chosen = self._choice_name if self._choice_name in CHOICES else Path(self._choice_name).stem
        lights = Path(self._light_name)
        exposure = None if self._exposure_ev is None else 2.0**self._exposure_ev
        albedo, by_lamps = (look.albedo, None) if room is None else room.session()
        exposure = room.exposure if room and exposure is None else exposure
        opened = self.options.opened is not None
        return {
            "scene": room.lit.scene if room and opened else self.scene,
            "environment": self._lights[0],
            "options": replace(self.options, budget_s=None).planned(),  # a session has a tolerance
            "albedos": {chosen: albedo, **{name: each for name, each in others.items() if name != chosen}},
            "environments_folder": lights.parent if lights.is_file() else None,
            "exposure": exposure,
            "cache": None if opened else self.relighter.cache,
            "lamps": {} if by_lamps is None else {chosen: by_lamps},
        }

    @cached_property
    def _room(self) -> "RelitRoom | None":
        """The closed room that the scene is, or None."""
        look, options = self.appearance, self.options
        closed = look.capture is not None and "room" in look.capture
        if options.opened and not closed:
            raise InputError("`opened` ceiling: expected a closed room that was captured from within, found none")
        from .engine.relit_room import RelitRoom

        room = RelitRoom(look, self.relighter, self._level) if closed else None
        if options.lamps != "keep" and not (room and room.lamps_found):
            told = "`lamps`: no lamp was found whose strength is known, and none is changed"
            warnings.warn(told, DataWarning, stacklevel=4)
        return room

    @property
    def steady(self) -> bool:
        """Whether no environment changes anything here: a closed room that stays as captured, or has no window."""
        return bool(self._room and self._room.steady)

    @property
    def _level(self) -> float:
        """Captured units per unit of the light's radiance, for it to be as bright as that of the capture was."""
        capture, mean = self.appearance.capture, self.environment.mean_luminance
        return float(capture["brightness"] / mean) if capture and mean > 0.0 else 1.0

    def _shading(self, light: Environment) -> Shading:
        if self._room:
            return self._room.shading(light)
        return self.relighter.shading(light, self.appearance.albedo)

    @cached_property
    def _animation(self) -> Any:
        from .animation.animation import Animation

        return Animation(str(self._given))

    @cached_property
    def _of_splats(self) -> bool:
        """Whether the scene was made from a splat: a mesh's colours are its maker's albedo, a splat's are not."""
        return bool(self.scene.source) or (self.scene.path is not None and Path(self.scene.path).is_dir())

    @property
    def _choice(self) -> Any:
        """What the albedo is taken from."""
        return ("estimated" if self._of_splats else "captured") if self._albedo is None else self._albedo

    @property
    def _choice_name(self) -> str:
        """The same as the report names it."""
        return "array" if isinstance(self._choice, np.ndarray) else str(self._choice)

    @cached_property
    def _lights(self) -> list[Environment]:
        return [self.environment.rotated(angle) for angle in self.angles_deg]

    @cached_property
    def _results(self) -> Results:
        splats = self.splats if self._shows_splats else None
        look, seed = self.appearance, self._wishes.seed
        live = None
        if splats is not None and {"live", "web"} & set(self.formats):
            others = [_light(each) for each in (*self._more_lights, *BUILTIN)]
            tolerance = self._wishes.tolerance
            known = look._replace(kept=True) if look.room else look  # what is live knows no lamps
            live = LiveFiles(self.relighter, known, splats[0], others, self._exposure_of, tolerance, self._sky, seed)
        engines = None
        if self._live_mesh or {*FOR_ENGINES} & {*self.formats}:
            wishes = self._live_mesh, self._harmonics, self._sky
            engines = EngineFiles(self.relighter, look, self.formats, splats, *wishes)
        more = self._texture_size, seed, self._sky, live, engines
        return Results(self.relighter, look, self.formats, self._baked, splats, *more)

    @property
    def _shows_splats(self) -> bool:
        """Whether any result needs the splats: pictures show them too."""
        return bool(self._baked) or self._formats is None or bool({*OF_SPLATS, "png"} & set(self._formats))

    @property
    def _name(self) -> str:
        """The scene as the report names it."""
        if isinstance(self._given, (str, os.PathLike)):
            return str(Path(self._given))
        return str(self.scene.path or self.scene.source.get("file", "a mesh in memory"))

    @property
    def _light_name(self) -> str:
        """The light as the report names it."""
        return self._env.name if isinstance(self._env, Environment) else str(self._env)

    def _write_report(self, folder: str | os.PathLike[str], report: dict[str, Any]) -> None:
        report.update(warnings=list(self._messages), seconds=dict(self.stages.seconds), peak_mb=peak_mb())
        (Path(folder) / REPORT).write_text(text_of(report, indent=1) + "\n", encoding="utf-8")

    def _exposure(self, first: Shading) -> float:
        """Display value per unit of radiance: 2^EV; else that of the capture's camera under as bright a sky, but within
        a stop of what the brightest vertices in any of the lights call for, which it is where no capture is known."""
        if self._exposure_ev is not None:
            return 2.0**self._exposure_ev
        if self._room and self._room.exposure is not None:
            return self._room.exposure
        others = (self._shading(light).radiance for light in self._lights[1:])
        exposure = min([auto_exposure(first.radiance), *map(auto_exposure, others)])
        return self._as_captured(exposure, self.environment)

    def _exposure_of(self, light: Environment, radiance: NDArray[np.float32]) -> float:
        """The same for one other light."""
        if self._exposure_ev is not None:
            return 2.0**self._exposure_ev
        return self._as_captured(auto_exposure(radiance), light)

    def _as_captured(self, exposure: float, light: Environment) -> float:
        capture, mean = self.appearance.capture, light.mean_luminance
        if capture is None or not mean > 0.0:
            return exposure
        return float(min(max(capture["brightness"] / mean, exposure / 2.0), exposure * 2.0))


def _light(source: AnyLight) -> Environment:
    return source if isinstance(source, Environment) else Environment.load(source)
