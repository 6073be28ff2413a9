"""One run of relight: a scene and lights from files, results and a report into folders."""

import json
from pathlib import Path

from splat2mesh.base.console import peak_mb
from splat2mesh.base.outputs import staged_folder
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import source_splats

from . import __version__
from .engine.appearance import CHOICES, appearance_of
from .engine.relighter import Relighter
from .light.environment import Environment
from .light.tonemap import auto_exposure
from .output.results import PICTURE_SIZE, Results
from .planning.plan import DEFAULT_TOLERANCE
from .sh import harmonics
from .transfer.store import Cache


class Job:
    """A scene and an environment as the options of the command name them, and the Relighter for them.

    Raises InputError for whatever of it cannot be read or used.
    """

    def __init__(self, options, angles, stages, messages):
        self.options, self.stages, self._messages = options, stages, messages
        self.source = Path(options.scene)
        with stages.stage("environment"):
            if options.bands is not None:
                harmonics.check_bands(options.bands)
            self.environment = Environment.load(options.env)
        with stages.stage("load"):
            if options.animate:
                from .animation.animation import Animation

                self._animation = Animation(self.source)
            self.scene = self._animation.scene if options.animate else Scene.load(self.source)
            self._splats = self._source(options) if "splat" in options.format or options.bake else None
        tolerance = DEFAULT_TOLERANCE if options.tolerance is None else options.tolerance
        with stages.stage("load"):
            cache = None if options.no_cache else Cache.of_scene(self.scene)
            capture_env = Environment.load(options.capture_env) if options.capture_env else None
        self.relighter = Relighter(
            self.scene,
            options.method,
            options.bands,
            options.rays,
            options.seed,
            options.effects,
            stages,
            None if options.budget is not None else tolerance,
            options.budget,
            cache,
        )
        # A mesh file's colours are its maker's albedo; a splat's hold the light of its capture.
        self._choice = options.albedo or ("estimated" if self.source.is_dir() else "captured")
        self.appearance = appearance_of(self._choice, capture_env, self.relighter)
        self.albedo = self.appearance.albedo
        planned = not options.view
        self.plan = self.relighter.plan_for(self.environment, self.albedo, len(angles)) if planned else None
        self._lights = [self.environment.rotated(angle) for angle in angles]

    def _source(self, options):
        """(Splats, paths) that the scene was made from; None for a mesh file, whose textures need none."""
        if self.source.is_dir() or "splat" in options.format:
            return source_splats(self.scene, options.splat)
        return None

    def session(self):
        """Keyword arguments of `viewer.view` for this job: its albedo first, and the lights beside its own."""
        options = self.options
        others = {"captured": self.appearance.captured, "white": None}
        chosen = self._choice if self._choice in CHOICES else Path(self._choice).stem
        lights = Path(options.env)
        return {
            "scene": self.scene,
            "environment": self._lights[0],
            "albedos": {chosen: self.albedo, **{name: each for name, each in others.items() if name != chosen}},
            "environments_folder": lights.parent if lights.is_file() else None,
            "exposure": None if options.exposure is None else 2.0**options.exposure,
            "tolerance": DEFAULT_TOLERANCE if options.tolerance is None else options.tolerance,
            "method": options.method,
            "effects": options.effects,
            "seed": options.seed,
            "bands": options.bands,
            "rays": options.rays,
            "cache": self.relighter.cache,
        }

    def results(self, folders):
        """Light the scene and fill a folder for each angle; yields the report of each, JSON-clean."""
        options = self.options
        baked = tuple(options.bake or ())
        results = Results(
            self.relighter, self.appearance, options.format, baked, self._splats, options.texture_size, options.seed
        )
        # One light is shaded once; of many the first pass only finds the exposure, or all would be in memory at once.
        first = self.relighter.shading(self._lights[0], self.albedo)
        exposure = self._exposure(first)
        for light, folder in zip(self._lights, folders, strict=True):
            shading = first if light is self._lights[0] else self.relighter.shading(light, self.albedo)
            report = self._report(light, shading, exposure)
            with staged_folder(folder) as staging:
                report["files"], told = results.write(staging, light, shading.radiance, exposure)
                report.update(told)
                self._write_report(staging, report)
            yield report

    def _write_report(self, folder, report):
        report.update(warnings=list(self._messages), seconds=dict(self.stages.seconds), peak_mb=peak_mb())
        (Path(folder) / "report.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")

    def film(self, folder):
        """Light every frame of an animated scene into a folder: a note on what is missing, or "", and the report."""
        from .animation.film import FILM, animate, frame_times

        options, animation, (light,) = self.options, self._animation, self._lights
        count = len(frame_times(animation.duration_s, options.fps))

        def radiance_of(_, time_s):
            poses = animation.at(time_s)
            if time_s > 0.0:
                self.relighter.update_all({chunk: poses[chunk] for chunk in animation.moving}, 1.0 / options.fps)
            self._shading = self.relighter.shading(light, self.albedo)
            return self._shading.radiance

        exposure = None if options.exposure is None else 2.0**options.exposure
        picture = {"width": PICTURE_SIZE[0], "height": PICTURE_SIZE[1], "overwrite": options.overwrite}
        with self.stages.stage("frames", count) as advance:
            written = animate(
                animation, radiance_of, light, folder, options.fps, exposure=exposure, advance=advance, **picture
            )
        report = self._report(light, self._shading, written.exposure)
        report |= {"animation": animation.name, "frames": written.frames, "fps": options.fps}
        report["files"] = [f"{number:04d}.png" for number in range(written.frames)] + [FILM] * written.film
        self._write_report(folder, report)
        return written.note, report

    def _report(self, light, shading, exposure):
        options, settings = self.options, shading.settings
        return {
            "version": __version__,
            "scene": str(self.source),
            "vertices": len(shading.radiance),
            "faces": len(self.scene.faces),
            "chunks": len(self.scene.chunks),
            "environment": {"name": light.name, "source": options.env, "repaired_pixels": light.repaired},
            "angle_deg": light.rotation_deg,
            "albedo": self._choice,
            "capture": self.appearance.capture,
            "method": settings.method,
            "bands": settings.bands,
            "rays": settings.rays,
            "effects": sorted(settings.effects),
            "suns": shading.sun_count,
            "bounces": [round(share, 6) for share in shading.bounces],
            "seed": options.seed,
            "plan": None if self.plan is None else self.plan.as_dict(),
            "rays_traced": self.relighter.rays_traced,
            "exposure": exposure,
            "files": [],
        }

    def _exposure(self, first):
        """Display value per unit of radiance: 2^EV; else that of the capture's camera under as bright a sky, but within
        a stop of what the brightest vertices in any of the lights call for, which it is where no capture is known."""
        if self.options.exposure is not None:
            return 2.0**self.options.exposure
        others = (self.relighter.shade(light, self.albedo) for light in self._lights[1:])
        exposure = min([auto_exposure(first.radiance), *map(auto_exposure, others)])
        capture, mean = self.appearance.capture, self.environment.mean_luminance
        if capture is None or not mean > 0.0:
            return exposure
        return float(min(max(capture["brightness"] / mean, exposure / 2.0), exposure * 2.0))
