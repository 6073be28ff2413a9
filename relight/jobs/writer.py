"""Writes the results of a job: a folder of files per light, a sheet of all lights, a film of an animation.

writer = Writer(job)
for shaded in job.shaded():
    writer.write(shaded, folder)
"""

import os
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.choices import DEFAULT_FPS
from splat2mesh.base.console import peak_mb
from splat2mesh.base.outputs import staged_folder
from splat2mesh.base.strictjson import text_of
from splat2mesh.base.version import VERSION
from splat2mesh.scene.scene import Scene

from ..animation.film import FILM, Acting, FilmRequest, Frames, Shot, animate, film_objects, frame_times
from ..engine.relighter import Shaded
from ..insert.asked import described
from ..insert.inserts import InsertedLight, Inserts
from ..options import lamp_name
from ..output.kinds import PICTURE_SIZE
from ..request import AnyLight
from .earlier_results import REPORT, Earlier, check_results, is_results, settings_of
from .job import Job
from .part_lights import described as described_parts
from .results import Results


class Writer:
    """Writes the results of a job into folders. messages: the warnings so far, for the report. lights: those that a
    page holds beside the built-in ones."""

    def __init__(self, job: Job, messages: list[str] | None = None, lights: Sequence[AnyLight] = ()) -> None:
        self.job, self._lights = job, lights
        self._messages = [] if messages is None else messages

    def under(self, env: AnyLight) -> "Writer":
        """A Writer of the same job under another light, with the same sheet and all shared stages."""
        other = Writer(self.job.under(env), self._messages, self._lights)
        other.results = self.results  # with the sheet so far
        return other

    def write(self, shaded: Shaded, folder: str | os.PathLike[str], overwrite: bool = False) -> dict[str, Any]:
        """Write the results of one light into a folder; returns the report of all that it holds, JSON-clean.

        Results of the same settings are added to; other files stay. Raises InputError where the folder holds no
        results, or those of other settings, unless these may be overwritten.
        """
        light = shaded.light
        report = report_of(self.job, shaded)
        settings = settings_of(self.job.request, self.job.request.light, light.rotation_deg, self._lights)
        check_results(folder, overwrite, lambda: settings)
        there = is_results(folder)
        folder = os.path.realpath(folder) if there else folder
        asked = self.job.request
        alone = asked.sheet and len(asked.angles_deg) == 1
        with staged_folder(folder, overwrite or there, REPORT, keep=True) as staging:
            earlier = Earlier(folder, settings, overwrite)  # again: another run may have been here since
            report["files"], facts = self.results.write(staging, shaded)
            if asked.sheet:
                self.results.add_to_sheet(shaded)
                report["files"] += [self.results.write_sheet(staging, 1)] * alone
            report.update(facts)
            report = earlier.joined(report)
            self._write_report(staging, report)
        return report

    def write_sheet(self, folder: str | os.PathLike[str]) -> Path:
        """Write all lights so far side by side, with what was captured; returns the path of the picture."""
        return Path(folder) / self.results.write_sheet(Path(folder))

    def film(
        self, folder: str | os.PathLike[str], fps: float = DEFAULT_FPS, overwrite: bool = False
    ) -> tuple[str, dict[str, Any]]:
        """Light every frame of an animated scene, or of inserted objects in a static place, into a folder: a note on
        what is missing, or "", and the report."""
        job, asked, objects = self.job, FilmRequest(folder, fps, overwrite), self.job.known.inserts
        moving: Any = job.inputs.animation if objects is None else Acting(objects)
        count, light = len(frame_times(moving.duration_s, fps)), job.lights[0]
        report: dict[str, Any] = {}
        _ = job.plan  # whose rays are traced before the first frame
        latest = [] if objects is None else [next(job.shaded())]  # what is reported

        def radiance_of(_: Scene, time_s: float) -> NDArray[np.float32]:
            poses, relighter = moving.at(time_s), job.known.relighter
            if time_s > 0.0:
                relighter.update_all({chunk: poses[chunk] for chunk in moving.moving})
            latest[:] = [Shaded(light, relighter.shading(light, job.known.appearance.albedo), 1.0)]
            return latest[0].shading.radiance

        def finish(staging: Path, written: Frames) -> None:
            frames.close()  # the report includes their seconds
            shaded = latest[0]._replace(exposure=written.exposure) if objects is None else latest[0]
            report.update(report_of(job, shaded), animation=moving.name, fps=fps, frames=written.frames)
            report["files"] = [f"{number:04d}.png" for number in range(written.frames)] + [FILM] * written.film
            self._write_report(staging, report)

        with ExitStack() as frames:
            advance = frames.enter_context(job.stages.stage("frames", count))
            if objects is None:
                exposure = None if job.request.exposure_ev is None else 2.0**job.request.exposure_ev
                shot = Shot(width=PICTURE_SIZE[0], height=PICTURE_SIZE[1], exposure=exposure)
                written = animate(moving, radiance_of, light, asked, shot, advance, finish)
            else:
                shaded, given = latest[0], latest[0].inserted
                painter = partial(self.results.object_painter, shaded)

                def lit(pose: Inserts) -> InsertedLight:
                    return pose.under(given.around, given.received)

                written = film_objects(moving, lit, painter, asked, shaded.exposure, advance, finish)
        return written.note, report

    @cached_property
    def results(self) -> Results:
        """The files of every light."""
        return Results(self.job, self._lights)

    def _write_report(self, folder: Path, report: dict[str, Any]) -> None:
        report.update(warnings=list(self._messages), seconds=dict(self.job.stages.seconds), peak_mb=peak_mb())
        (folder / REPORT).write_text(text_of(report, indent=1) + "\n", encoding="utf-8")


def report_of(job: Job, shaded: Shaded) -> dict[str, Any]:
    """The settings and results of the work, JSON-clean, without files and times."""
    light, shading, exposure = shaded[:3]
    settings, options = shading.settings, job.inputs.options
    return {
        "version": VERSION,
        "scene": job.inputs.name,
        "vertices": len(shading.radiance),
        "faces": len(job.known.scene.faces),
        "chunks": len(job.known.scene.chunks),
        "environment": {"name": light.name, "source": job.light_name, "repaired_pixels": light.repaired},
        "angle_deg": light.rotation_deg,
        "turned": light.turned,
        "lamps": [(key if isinstance(key, int) else lamp_name(key), factor) for key, factor in options.lamps]
        if isinstance(options.lamps, tuple)
        else options.lamp_factor,
        "placed": job.mix.in_words,
        "inserted": [described(each) for each in job.inputs.asked_inserts],
        "captured": job.mix.captured_factor if job.light_kind.adds else None,
        "env_scale": options.env_scale,
        "assumed": job.assumed,
        "part": None if job.known.part is None else job.known.part.report,
        "parts": described_parts(job),
        "albedo": job.inputs.choice_name,
        "capture": job.known.appearance.capture,
        "gloss": None if job.known.gloss is None else job.known.gloss.as_dict(job.known.appearance),
        "mirrored_floor": job.known.mirrored_floor,
        "method": settings.method,
        "bands": settings.bands,
        "rays": settings.rays,
        "effects": sorted(settings.effects),
        "suns": shading.sun_count,
        "bounces": [round(share, 6) for share in shading.bounces],
        "seed": job.request.lighting.seed,
        "plan": None if job.plan is None else job.plan.as_dict(),
        "lamp_plan": None if job.mix.lamp_light is None else job.mix.lamp_light.plan_dict(),
        "rays_traced": job.known.relighter.rays_traced,
        "exposure": exposure,
        "files": [],
    }
