"""Writes the results of a job: a folder of files per light, a sheet of all lights, a film of an animation.

writer = Writer(job)
for shaded in job.shaded():
    writer.write(shaded, folder)
"""

import os
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cached_property
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
from splat2mesh.splats.splats import Splats

from ..animation.film import FILM, Acting, FilmRequest, Frames, Shot, animate, film_objects, frame_times
from ..engine.relighter import Shaded
from ..insert.asked import described
from ..light.loading import light_of
from ..light.skies import BUILTIN
from ..options import LightingOptions, lamp_name
from ..output.kinds import PICTURE_SIZE
from ..output.relit_splats import RelitSource
from ..output.results import Results
from ..output.subject import AskedFiles, WrittenScene
from ..request import AnyLight
from .earlier_results import REPORT, Earlier, check_results, is_results, settings_of
from .job import Job
from .part_lights import described as described_parts
from .part_lights import kept_live_parts, part_lights
from .part_shadow import PartShadow


class Writer:
    """Writes the results of a job into folders. messages: the warnings so far, for the report. lights: those that a
    page holds beside the built-in ones."""

    def __init__(self, job: Job, messages: list[str] | None = None, lights: Sequence[AnyLight] = ()) -> None:
        self.job, self._lights = job, lights
        self._messages = [] if messages is None else messages

    def under(self, env: AnyLight) -> "Writer":
        """A Writer of the same job under another light, with the same sheet and all shared stages."""
        other = Writer(self.job.under(env), self._messages, self._lights)
        other._results = self._results  # with the sheet so far
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
            report["files"], facts = self._results.write(staging, shaded)
            if asked.sheet:
                self._results.add_to_sheet(shaded)
                report["files"] += [self._results.write_sheet(staging, 1)] * alone
            report.update(facts)
            report = earlier.joined(report)
            self._write_report(staging, report)
        return report

    def write_sheet(self, folder: str | os.PathLike[str]) -> Path:
        """Write all lights so far side by side, with what was captured; returns the path of the picture."""
        return Path(folder) / self._results.write_sheet(Path(folder))

    @property
    def source(self) -> RelitSource:
        """The splats that the scene was made from, to be relit."""
        return self._results.source

    def relit_splats(self, shaded: Shaded) -> Splats:
        """The splats that the scene was made from, in its light."""
        return self._results.relit_splats(shaded)

    def picture(self, relit: Splats, shaded: Shaded) -> NDArray[np.uint8]:
        """The picture, (H, W, 3) sRGB, of splats in a light, by the camera of the scene."""
        with self.job.stages.stage("preview"):
            return self._results.painted(relit, shaded)

    def shown(self, shaded: Shaded) -> Shaded:
        """The light as the mesh shows it: captured outside a part that alone takes the new one."""
        return self._results.shown(shaded)

    def film(
        self, folder: str | os.PathLike[str], fps: float = DEFAULT_FPS, overwrite: bool = False
    ) -> tuple[str, dict[str, Any]]:
        """Light every frame of an animated scene into a folder: a note on what is missing, or "", and the report."""
        job = self.job
        if job.inputs.asked_inserts:
            return self._film_of_objects(folder, fps, overwrite)
        _ = job.plan  # its rays are traced before the first frame
        albedo, animation, (light,) = job.known.appearance.albedo, job.inputs.animation, job.lights
        count = len(frame_times(animation.duration_s, fps))
        shading: Any = None

        def radiance_of(_: Scene, time_s: float) -> NDArray[np.float32]:
            nonlocal shading
            poses = animation.at(time_s)
            if time_s > 0.0:
                job.known.relighter.update_all({chunk: poses[chunk] for chunk in animation.moving})
            shading = job.known.relighter.shading(light, albedo)
            return shading.radiance

        def finish(staging: Path, written: Frames) -> None:
            frames.close()  # the report includes their seconds
            shaded = Shaded(light, shading, written.exposure)
            report.update(self._report_film(staging, shaded, written, {"animation": animation.name, "fps": fps}))

        report: dict[str, Any] = {}
        exposure = None if job.request.exposure_ev is None else 2.0**job.request.exposure_ev
        shot = Shot(width=PICTURE_SIZE[0], height=PICTURE_SIZE[1], exposure=exposure)
        with ExitStack() as frames:
            advance = frames.enter_context(job.stages.stage("frames", count))
            asked = FilmRequest(folder, fps, overwrite)
            written = animate(animation, radiance_of, light, asked, shot, advance, finish)
        return written.note, report

    def _film_of_objects(
        self, folder: str | os.PathLike[str], fps: float, overwrite: bool
    ) -> tuple[str, dict[str, Any]]:
        """Light the inserted objects frame by frame, in a static place."""
        job, results = self.job, self._results
        assert job.known.inserts is not None
        acting = Acting(job.known.inserts)
        count = len(frame_times(acting.duration_s, fps))
        shaded = next(job.shaded())
        around, received = shaded.inserted.around, shaded.inserted.received
        report: dict[str, Any] = {}

        def finish(staging: Path, written: Frames) -> None:
            frames.close()
            report.update(self._report_film(staging, shaded, written, {"animation": acting.name, "fps": fps}))

        with ExitStack() as frames:
            written = film_objects(
                acting,
                lambda inserts: inserts.under(around, received),
                lambda poses: results.object_painter(shaded, poses),
                FilmRequest(folder, fps, overwrite),
                shaded.exposure,
                frames.enter_context(job.stages.stage("frames", count)),
                finish,
            )
        return written.note, report

    def _report_film(self, staging: Path, shaded: Shaded, written: Frames, more: dict[str, Any]) -> dict[str, Any]:
        """Write the report of a film, and return it."""
        report = report_of(self.job, shaded) | more | {"frames": written.frames}
        report["files"] = [f"{number:04d}.png" for number in range(written.frames)] + [FILM] * written.film
        self._write_report(staging, report)
        return report

    @cached_property
    def _results(self) -> Results:
        job, known, asked = self.job, self.job.known, self.job.request
        formats = job.inputs.formats
        files = AskedFiles(
            kinds=formats,
            baked=asked.baked,
            texture_size=asked.texture_size,
            live_mesh=asked.live_mesh,
            harmonics=asked.harmonics,
            lights=[light_of(each) for each in (*self._lights, *BUILTIN)] if {"live", "web"} & {*formats} else [],
            probe_at=asked.probe_at,
            probe_grid=asked.probe_grid,
            color_space=asked.color_space,
            tolerance=asked.lighting.tolerance,
            sky=asked.sky,
            seed=asked.lighting.seed,
        )
        written = WrittenScene(
            relighter=known.relighter,
            appearance=known.appearance,
            asked=files,
            splats=job.inputs.splats if job.inputs.shows_splats else None,
            binding=lambda: known.binding,
            lamps=job.lamps_shown,
            gloss=known.gloss,
            mix=job.mix,
            lamp_light=lambda: job.mix.lamp_light if job.light_kind.adds else None,
            mirror=lambda: known.mirror,
            texture=known.texture,
            light_around=job.light_around,
            light_parts=job.light_parts,
            pass_views=lambda: known.pass_views,
            part=known.part if asked.only or asked.keep else None,
            part_shadow=PartShadow(job).ratio if asked.shadow_of_parts else None,
            lit_parts=part_lights(job),
            kept_parts=lambda: kept_live_parts(job),
        )
        return Results(written)

    def _write_report(self, folder: Path, report: dict[str, Any]) -> None:
        report.update(warnings=list(self._messages), seconds=dict(self.job.stages.seconds), peak_mb=peak_mb())
        (folder / REPORT).write_text(text_of(report, indent=1) + "\n", encoding="utf-8")


def _lamps_of(options: LightingOptions) -> float | list[tuple[int | str, float]]:
    """The factor of all captured lamps, or that of each by number or place."""
    if not isinstance(options.lamps, tuple):
        return options.lamp_factor
    return [(key if isinstance(key, int) else lamp_name(key), factor) for key, factor in options.lamps]


def report_of(job: Job, shaded: Shaded) -> dict[str, Any]:
    """The settings and results of the work, JSON-clean, without files and times."""
    light, shading, exposure = shaded[:3]
    settings = shading.settings
    return {
        "version": VERSION,
        "scene": job.inputs.name,
        "vertices": len(shading.radiance),
        "faces": len(job.known.scene.faces),
        "chunks": len(job.known.scene.chunks),
        "environment": {"name": light.name, "source": job.light_name, "repaired_pixels": light.repaired},
        "angle_deg": light.rotation_deg,
        "turned": light.turned,
        "lamps": _lamps_of(job.inputs.options),
        "placed": job.mix.in_words,
        "inserted": [described(each) for each in job.inputs.asked_inserts],
        "captured": job.mix.captured_factor if job.light_kind.adds else None,
        "env_scale": job.inputs.options.env_scale,
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
