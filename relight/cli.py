"""The relight command: scene and light in, relit files out. Holds no mathematics, imports nothing heavy."""

import argparse
import contextlib
import math
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splat2mesh.base.commandline import chosen, several, share
from splat2mesh.cli import wants_tiles

from .arguments import parser
from .output.kinds import BAKED, FILES, HARMONICS, SHEET
from .transfer import METHODS

if TYPE_CHECKING:
    from .job import Job

MAX_ANGLES = 3600
LIGHT_STAGES = frozenset(
    {"occluder", "rays", "keep", "transfer", "transfer kept", "bounce rays kept"}
    | {"plan", "check", "light", "sunlight", "shade", "bounces"}
)
"""What `--budget` is spent on; "bounce rays" are traced for the albedo too, which no budget covers."""

MAX_EXPOSURE_EV = 64.0  # far beyond any light, and 2^64 still fits in the files' float32


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    from splat2mesh.base.console import run

    return run(_command, parser().parse_args(arguments), {"budget_s": "--budget", "opened": "--open"})


def angles_from(text: str) -> list[float]:
    """The angles of `--rotate`, in [0, 360), each once: "405" -> [45.0], "0:90:45" -> [0.0, 45.0, 90.0].

    Raises InputError for anything else than DEG or START:STOP:STEP.
    """
    from splat2mesh.base.errors import InputError

    try:
        values = [float(part) for part in text.split(":")]
    except ValueError:
        values = []
    if len(values) not in (1, 3) or not all(map(math.isfinite, values)):
        raise InputError(f"--rotate {text}: expected degrees, such as 45, or START:STOP:STEP, such as 0:350:10")
    start, stop, step = values if len(values) == 3 else (values[0], values[0], 1.0)
    if step == 0.0 or (stop - start) / step < 0.0:
        raise InputError(f"--rotate {text}: a step of {step:g} does not lead from {start:g} to {stop:g}")
    count = math.floor((stop - start) / step + 1e-6) + 1
    if count > MAX_ANGLES:
        raise InputError(f"--rotate {text}: {count} angles; expected at most {MAX_ANGLES}, take a larger step")
    return list(dict.fromkeys(round((start + i * step) % 360.0, 6) % 360.0 for i in range(count)))


def _command(options: argparse.Namespace) -> tuple[list[str], Any]:
    from splat2mesh.base.console import recorded_warnings, wants_progress
    from splat2mesh.base.progress import Stages

    from .meshing import is_splat

    if "://" in options.scene or wants_tiles(options) or (Path(options.scene) / "city.json").is_file():
        from .tiles.command import light_city

        return light_city(options, parser().parse_args([options.scene]), angles_from(options.rotate))
    source = Path(options.scene)
    _understand(options, source)
    if options.serve is not None and _is_page(source):
        return _page_served(source, options)
    angles = angles_from(options.rotate)
    lights = _lights(options.env)
    _check(options, angles, lights)
    stages = Stages(show=wants_progress(options))
    with recorded_warnings() as messages:
        try:
            told: list[str] = []
            scene: Path | None = source
            if is_splat(source):
                scene, told = _meshed(source, options, stages)
            if scene is None:
                return told, {"plan": None}
            lines, result = _relit(scene, lights, angles, options, stages, messages)
        finally:
            stages.close()
    return told + lines, result


def _understand(options: argparse.Namespace, source: Path) -> None:
    """Put the words of options into the form that the library knows. Raises InputError for what makes no sense."""
    if not os.path.exists(source):
        raise _error(f"{source}: no such scene folder, splat or mesh file")
    options.method = chosen("--method", options.method, METHODS)
    options.sky = chosen("--sky", options.sky, ("new", "keep", "drop"))
    options.format = several("--format", options.format, FILES) if options.format else None
    options.harmonics = chosen("--harmonics", options.harmonics, HARMONICS)
    options.bake = several("--bake", options.bake, BAKED)
    options.tolerance = share("--tolerance", options.tolerance)
    if options.albedo and not Path(options.albedo).exists() and "." not in options.albedo:
        options.albedo = chosen("--albedo", options.albedo, ("estimated", "captured", "white"))
    if options.exposure is not None and not abs(options.exposure) <= MAX_EXPOSURE_EV:
        limit = f"{MAX_EXPOSURE_EV:g}"
        raise _error(f"--exposure {options.exposure}: expected stops from -{limit} to {limit}")
    if options.live and "glb" not in (options.format or FILES):
        raise _error("--live: it is of --format glb; give that too")
    if options.lights and not {"live", "web"} & set(options.format or ()):
        raise _error(f"--lights {options.lights[0]}: only --format live and web hold several lights")
    if options.clear_cache and (options.plan or options.no_cache):
        raise _error("--clear-cache: with --plan and --no-cache nothing is written and nothing removed")
    if options.screenshot:
        from .output.mesh_files import check_image

        check_image(options.screenshot)
        options.view = True


def _check(options: argparse.Namespace, angles: list[float], lights: list[str]) -> None:
    """Raise InputError, before any work, for options that do not go together."""
    one = "a session" if options.view or options.serve is not None else "an animation" if options.animate else ""
    if one and len(angles) > 1:
        raise _error(f"--rotate {options.rotate}: {one} has one angle")
    if one and len(lights) > 1 and options.animate:
        raise _error(f"--env {options.env}: an animation has one light")
    if options.serve is not None and (options.view or not 0 <= options.serve < 65536):
        raise _error(f"--serve {options.serve or ''}: expected a port up to 65535, and no --view beside it")


def _lights(env: str) -> list[str]:
    """The lights of `--env`: itself, or all that its folder holds, by name."""
    folder = Path(env)
    if not folder.is_dir():
        return [env]
    found = sorted(str(path) for path in folder.iterdir() if path.suffix.lower() in (".exr", ".hdr"))
    if not found:
        raise _error(f"--env {env}: the folder holds no .exr and no .hdr file")
    return found


def _meshed(splat: Path, options: argparse.Namespace, stages: Any) -> tuple[Path | None, list[str]]:
    """The scene folder of a splat, made where it is not there yet, and what to tell; with --plan nothing is made."""
    from .meshing import planned, scene_folder

    if not options.plan:
        return scene_folder(splat, stages)
    folder = planned(splat)
    if folder is not None:
        return folder, []
    return None, [f"{splat} is meshed first: splat2mesh {splat} --plan shows how. Light is planned once that is done."]


def _relit(
    source: Path, lights: list[str], angles: list[float], options: argparse.Namespace, stages: Any, messages: list[str]
) -> tuple[list[str], Any]:
    """Do what is asked of a scene or mesh: lines of the summary, and the result."""
    from .job import Job
    from .options import LightingOptions
    from .writing import Writer

    names = ("method", "bands", "rays", "effects", "tolerance", "budget_s", "seed", "lamps", "opened")
    lighting = LightingOptions(**{name: getattr(options, name) for name in names})
    writes = not (options.plan or options.view or options.serve is not None)
    folders = _output_folders(options, source, lights, angles) if writes else []
    job = Job(
        source,
        lights[0],
        lighting,
        angles_deg=angles,
        albedo=options.albedo,
        capture_env=options.capture_env,
        exposure_ev=options.exposure,
        formats=options.format,
        baked=options.bake,
        splat=options.splat,
        animated=options.animate,
        caching="none" if options.no_cache else "read" if options.plan else "keep",
        stages=stages,
    )
    if options.clear_cache:
        job.relighter.cache.clear()
    if options.plan:
        return _planned(job)
    if options.serve is not None:
        return _served(job, options.serve)
    if options.view:
        return _viewed(job, options.screenshot)
    writer = Writer(
        job,
        texture_size=options.texture_size,
        sky=options.sky,
        sheet=options.sheet,
        lights=options.lights,
        live_mesh=options.live,
        harmonics=options.harmonics,
        messages=messages,
    )
    if options.animate:
        note, report = writer.film(folders[0], options.fps, options.overwrite)
        lines = [str(folders[0] / name) for name in report["files"]] + [note] * bool(note)
        return lines, {"outputs": [str(folders[0])], "reports": [report]}
    reports, left = [], iter(folders)
    for light in lights:
        writer = writer if light == lights[0] else writer.under(light)
        reports += [writer.write(shaded, next(left), options.overwrite) for shaded in writer.job.shaded()]
    lines = [str(folder / name) for folder, report in zip(folders, reports, strict=True) for name in report["files"]]
    if options.sheet and len(folders) > 1:
        lines.append(str(writer.write_sheet(folders[0].parent)))
    job = writer.job
    lines += _costs(job, options)
    if options.verbose:
        lines += job.plan.table() if job.plan else []
        lines += [f"  {label:<12}{seconds:7.2f} s" for label, seconds in stages.seconds.items()]
    return lines, {"outputs": [str(folder) for folder in folders], "reports": reports}


def _served(job: "Job", port: int) -> tuple[list[str], Any]:
    from splat2mesh.base.console import tell

    from .viewer import serve

    session = job.session()
    job.stages.close()
    serve(**session, port=port, announce=lambda url: tell(f"open {url} (Ctrl-C stops)"))
    return [], {"served": True}


def _is_page(source: Path) -> bool:
    """Whether a folder is results of --format web, and no scene."""
    return source.is_dir() and not (source / "scene.json").exists()


def _page_served(folder: Path, options: argparse.Namespace) -> tuple[list[str], Any]:
    from .live.serve import server_of

    with server_of(folder, options.serve) as server:
        if not options.quiet:
            sys.stderr.write(f"open {server.url} (Ctrl-C stops)\n")
        with contextlib.suppress(KeyboardInterrupt):
            server.serve_forever()
        return [], {"served": server.url}


def _viewed(job: "Job", screenshot: str | None) -> tuple[list[str], Any]:
    from .viewer import view

    session = job.session()
    job.stages.close()
    view(**session, screenshot=screenshot)
    return [screenshot] if screenshot else [], {"screenshot": screenshot}


def _planned(job: "Job") -> tuple[list[str], Any]:
    plan, note = job.planned()
    if plan is None and job.steady:
        raise _error("--plan: no environment changes this room, so that there is nothing to plan")
    if plan is None:
        raise _error(f"--plan: the method {job.options.method} has nothing to plan; leave it at auto")
    return plan.table() + [f"  {note}"] * bool(note), {"plan": plan.as_dict(), "note": note}


def _costs(job: "Job", options: argparse.Namespace) -> list[str]:
    """What the summary says of seconds beyond a budget, and of what is kept on disk."""
    lines = []
    if options.budget_s is not None:
        beyond = sum(seconds for stage, seconds in job.stages.seconds.items() if stage not in LIGHT_STAGES)
        lines.append(f"  --budget {options.budget_s:g} is for the light; all else took {beyond:.1f} s")
    megabytes = round(job.relighter.cache.size_bytes / 2**20)
    if megabytes:
        lines.append(f"  {job.relighter.cache.folder} keeps {megabytes} MB for the next light (--clear-cache)")
    return lines


def _error(message: str) -> Exception:
    from splat2mesh.base.errors import InputError

    return InputError(message)


def _output_folders(options: argparse.Namespace, source: Path, lights: list[str], angles: list[float]) -> list[Path]:
    """The folder of every light and angle. Raises InputError, before any work, for one that may not be written."""
    from splat2mesh.base.outputs import check_output

    if options.output and len(angles) == len(lights) == 1:
        folders = [Path(options.output)]
    else:
        default = source / "relit" if source.is_dir() else Path(f"{source.stem}_relit")
        parent = Path(options.output or default)
        folders = [parent / f"{_name(light)}_{_plain(angle)}" for light in lights for angle in angles]
    for folder in folders:
        if folders.count(folder) > 1:
            raise _error(f"--env {options.env}: two of its lights would go into {folder}; rename one of their files")
        check_output(folder, options.overwrite, marker="report.json")
    if options.sheet and len(folders) > 1:
        check_output(folders[0].parent / SHEET, options.overwrite)
    return folders


def _name(light: str) -> str:
    """What a light is called in the name of a folder: that of its file, or of the sky that it is, whatever its case."""
    return Path(light).stem if Path(light).exists() else Path(light).stem.lower()


def _plain(number: float) -> str:
    """A number without trailing zeros: 45.0 -> "45"."""
    return f"{number:.6f}".rstrip("0").rstrip(".")


if __name__ == "__main__":
    sys.exit(main())
