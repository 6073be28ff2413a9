"""The relight command: words in, a typed request to the library, a summary out. Holds no mathematics."""

import argparse
import contextlib
import math
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splat2mesh.base.choices import MOST_STEPS, check_choice
from splat2mesh.base.commandline import share
from splat2mesh.base.console import Display, notify, open_streams, run
from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import check_output
from splat2mesh.base.progress import Stages
from splat2mesh.base.requests import given, option_names
from splat2mesh.base.specs import vector
from splat2mesh.cli import convert_options, display_options, tiling_options

from .arguments import parser
from .light import CAPTURED_SKIES
from .options import LightingOptions
from .request import ALBEDOS, RelightRequest

if TYPE_CHECKING:
    from .jobs.job import Job

LIGHT_STAGES = frozenset(
    {"occluder", "rays", "keep", "transfer", "transfer kept", "bounce rays kept"}
    | {"plan", "check", "light", "sunlight", "shade", "bounces"}
)
"""The stages that `--budget` covers; "bounce rays" are also traced for the albedo, which no budget covers."""

MOST_PORT = 65535

LAMPS_PICTURE = "lamps.png"
"""Pictures that `--plan` writes into the folder of the scene: for a room with lamps their numbers for `--lamps`; for
the sun of a date an arrow to the north, for `--north`."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    open_streams()
    words = parser().parse_args(arguments)
    display = display_options(words)
    return run(lambda: _command(words, display), display, option_names(parser()))


def angles_from(text: str) -> list[float]:
    """Return the angles of `--rotate`, in [0, 360), each once: "405" -> [45.0], "0:90:45" -> [0.0, 45.0, 90.0].

    An axis behind them is that of `axis_from`. Raises InputError for anything else than DEG or START:STOP:STEP.
    """
    if axis_from(text) is not None:
        if ":" in text.rpartition(":")[0]:
            raise InputError(f"--rotate {text}: about an axis it takes one angle, such as 45:1,0,0")
        return angles_from(text.rpartition(":")[0])
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
    if count > MOST_STEPS:
        raise InputError(f"--rotate {text}: {count} angles; expected at most {MOST_STEPS}, take a larger step")
    return list(dict.fromkeys(round((start + i * step) % 360.0, 6) % 360.0 for i in range(count)))


def axis_from(text: str) -> tuple[float, float, float] | None:
    """Return the axis of `--rotate` DEG:X,Y,Z, or None. Raises InputError for one of length 0 and for other words."""
    axis = text.rpartition(":")[2]
    if "," not in axis:
        return None
    with contextlib.suppress(InputError):
        if any(found := vector("rotate", axis)):
            return found
    raise InputError(f"--rotate {text}: expected an axis of three numbers, not all 0, as in 45:1,0,0")


def _phrases(words: list[list[str]]) -> list[str]:
    return [" ".join(each).strip() for each in words]


def _word_or_file(name: str, value: str, words: Iterable[str]) -> str:
    """A file, or one of the words. Raises InputError for anything else."""
    return value if Path(value).exists() or "." in value else check_choice(name, value, words)


READ: dict[str, Callable[[Any], Any]] = {
    "placed": _phrases,
    "inserted": _phrases,
    "parts": _phrases,
    "tolerance": lambda value: share("--tolerance", value),
    "captured_sky": lambda value: _word_or_file("captured_sky", value, CAPTURED_SKIES),
    "angles_deg": angles_from,
    "albedo": lambda value: _word_or_file("albedo", value, ALBEDOS),
}
"""Field of a request -> what turns its words into the value, or raises InputError."""


def request_of(words: argparse.Namespace) -> RelightRequest:
    """Return what the words of a command line ask for. Raises InputError for words that mean nothing."""
    light, asked = given(LightingOptions, words), given(RelightRequest, words)
    tiling = tiling_options(words)
    _describe_captured_sun(words, light, asked)
    for fields in (light, asked):
        fields.update({name: READ[name](value) for name, value in fields.items() if name in READ})
    elsewhere = {"seed"}  # that is of the rays
    if "passes" in asked.get("formats", ()):
        elsewhere.add("cameras")  # those are of the passes
    else:
        asked.pop("cameras", None)
    meshing = {name: value for name, value in vars(words).items() if name not in elsewhere}
    asked["meshing"] = convert_options(argparse.Namespace(**meshing))
    return RelightRequest(lighting=LightingOptions(**light), tiling=tiling, **asked)


def _describe_captured_sun(words: argparse.Namespace, light: dict[str, Any], asked: dict[str, Any]) -> None:
    """Add place and north to the captured sun. Of two suns, one without its own has those of the other: the place is
    one."""
    sun = light.get("captured_sun")
    if sun is None:
        return
    given = {name: getattr(words, f"captured_{name}") for name in ("at", "north_deg") if f"captured_{name}" in words}
    for name in ("at", "north_deg"):
        if name in asked and name not in given and (name != "at" or "," not in sun):  # angles need no place
            given[name] = asked[name] if asked.get("sun") else asked.pop(name)
    if asked.get("sun"):
        asked.update({name: value for name, value in given.items() if name not in asked})
    said = {"at": "at", "north_deg": "north"}
    light["captured_sun"] = " ".join([sun, *(f"{said[name]}={value}" for name, value in given.items())])


def _command(words: argparse.Namespace, display: Display) -> tuple[list[str], Any]:
    if "://" not in words.scene and not os.path.exists(words.scene):
        raise InputError(f"{words.scene}: no such scene folder, splat or mesh file")
    request = request_of(words)
    port = getattr(words, "serve", None)
    _check_session(words, port)
    return _done(words, request, port, display)


def _done(
    words: argparse.Namespace, request: RelightRequest, port: int | None, display: Display
) -> tuple[list[str], Any]:
    from .jobs import folders

    request = folders.turned_about(request, axis_from(getattr(words, "angles_deg", "")))

    if folders.is_city(request) or request.sequence:
        _refuse_sessions(words, "a sequence" if request.sequence else "a city in tiles")
    elif port is not None and _is_page(Path(words.scene)):
        return _page_served(Path(words.scene), port, display)
    stages = Stages(display.progress, display.tell)
    try:
        if hasattr(words, "plan"):
            return _planned(request, stages, getattr(words, "plot", None))
        if port is not None:
            from .api import serve_request

            serve_request(request, port, lambda url: notify(f"open {url} (Ctrl-C stops)"), stages)
            return [], {"served": True}
        if hasattr(words, "view") or hasattr(words, "screenshot"):
            from .api import view_request

            screenshot = getattr(words, "screenshot", None)
            view_request(request, screenshot=screenshot, stages=stages)
            return [screenshot] if screenshot else [], {"screenshot": screenshot}
        done = folders.relight_files(request, stages)
    finally:
        stages.close()
    if done.job is None:
        return done.notes, done.reports[0]
    lines = [
        *done.notes,
        *map(str, done.files),
        *_doubt(done.reports[0]),
        *_part(done.reports[0]),
        *_cleaned(done.reports[0]),
        *_assumed(done.job),
        *_lamps(done.job),
        *_costs(done.job),
    ]
    if display.verbose:
        lines += done.job.plan.table() if done.job.plan else []
        lines += [f"  {label:<12}{seconds:7.2f} s" for label, seconds in stages.seconds.items()]
    return lines, {"outputs": [str(folder) for folder in done.folders], "reports": done.reports}


def _refuse_sessions(words: argparse.Namespace, scene: str) -> None:
    """Raise InputError for a plan or a session of a kind of scene that has none."""
    for name in ("plan", "view", "screenshot", "serve"):
        if hasattr(words, name):
            raise InputError(f"--{name}: not supported for {scene}; leave it out")


def _check_session(words: argparse.Namespace, port: int | None) -> None:
    """Raise InputError for ways to show a session that do not go together."""
    if hasattr(words, "quick") and (port is not None or any(hasattr(words, n) for n in ("plan", "view", "screenshot"))):
        raise InputError("--quick: it writes files, and shows neither a plan nor a session")
    if port is not None and (hasattr(words, "view") or not 0 <= port <= MOST_PORT):
        raise InputError(f"--serve {port or ''}: expected a port up to {MOST_PORT}, and no --view beside it")
    plot = getattr(words, "plot", None)
    if plot is not None and (not hasattr(words, "plan") or Path(plot).suffix.lower() != ".png"):
        raise InputError(f"--plot {plot}: expected a name that ends with .png, beside --plan")
    if plot is not None:
        check_output(plot, overwrite=True)
    if getattr(words, "screenshot", None):
        from .output.images import check_image

        check_image(words.screenshot)


def _plotted(report: Any, path: Path) -> str:
    """Draw the curve of a plan: a line of the summary. Raises InputError where nothing was planned."""
    from .planning.plan import plot_plan

    if report.plan is None or not report.plan.rays:
        raise InputError(f"--plot {path}: there is no curve to draw: {report.note or 'nothing was measured'}")
    plot_plan(path, report.plan, f"{report.plan.vertices:,} sampled vertices, {report.plan.rays:,} rays")
    return f"{path}: what accuracy costs here"


def _planned(request: RelightRequest, stages: Stages, plot: str | None) -> tuple[list[str], Any]:
    from .api import plan_relight

    try:
        report = plan_relight(request, stages)
    except InputError as error:
        raise InputError(f"--plan: {error}") from error
    lines = report.table()
    if plot is not None:
        lines.append(_plotted(report, Path(plot)))
    if report.lamps_picture is not None:
        from .output.images import write_png

        path = Path(request.output or _picture_folder(str(request.scene))) / LAMPS_PICTURE
        path.parent.mkdir(parents=True, exist_ok=True)
        write_png(path, report.lamps_picture)
        lines.append(f"{path}: its lamps by number, for --lamps 1=off,2=0.5")
    plan, lamps = report.plan and report.plan.as_dict(), report.lamps and report.lamps.as_dict()
    more = {"gloss": report.gloss and report.gloss.as_dict(), "mirrored_floor": report.mirrored_floor}
    return lines, {"plan": plan, "note": report.note, "lamps": lamps, **more}


def _picture_folder(scene: str) -> str:
    """The folder of a plan's pictures: that of the scene, or for a file NAME_relit, which also takes its results."""
    return scene if os.path.isdir(scene) else f"{Path(scene).stem}_relit"


def _is_page(source: Path) -> bool:
    """Whether a folder is results of --format web, and no scene."""
    return source.is_dir() and not (source / "scene.json").exists()


def _page_served(folder: Path, port: int, display: Display) -> tuple[list[str], Any]:
    from .live.serve import server_of

    with server_of(folder, port) as server:
        if not display.quiet:
            sys.stderr.write(f"open {server.url} (Ctrl-C stops)\n")
        with contextlib.suppress(KeyboardInterrupt):
            server.serve_forever()
        return [], {"served": server.url}


def _doubt(report: dict[str, Any]) -> list[str]:
    """The line of the summary on how far the estimate of the captured light can be trusted."""
    doubt = (report.get("capture") or {}).get("light_doubt_db")
    return [f"  captured light estimated: results ± {doubt:.1f} dB (--captured-light, --sheet)"] if doubt else []


def _part(report: dict[str, Any]) -> list[str]:
    """The lines of the summary on a part that alone takes the new light, or alone does not, and on others in lights of
    their own."""
    part = report.get("part") or {}
    named = [("--only" if "only" in part else "--keep", part)]
    named += [(f"--part {each['part']}", each) for each in report.get("parts") or []]
    counted = [(name, each["splats"]) for name, each in named if "splats" in each]
    return [
        f"  {name}: {counts['part']:,} of {counts['all']:,} splats, and {counts['rim']:,} at the rim"
        for name, counts in counted
    ]


def _cleaned(report: dict[str, Any]) -> list[str]:
    """The line of the summary on floaters."""
    counts = report.get("clean_splat")
    return [f"  {counts['floaters']:,} of {counts['splats']:,} splats were floaters"] if counts else []


def _assumed(job: "Job") -> list[str]:
    """The lines of the summary on a light whose way into the room is unknown."""
    if job.assumed is None:
        return []
    share, change = job.assumed["outside"], ", ".join(f"{each:.2f}" for each in job.assumed["change"])
    whole = "all" if share == 1.0 else f"{share:.0%}"
    return [
        f"  assumed: {whole} of the captured light came from outside, and is now {change} times as bright (R, G, B)"
    ]


def _lamps(job: "Job") -> list[str]:
    """The lines of the summary on added lamps and on the scale of their brightness."""
    if not job.light_kind.adds:
        return []
    lines = [f"  lamp {number}: {text}" for number, text in enumerate(job.mix.in_words, 1)]
    if lines:
        how = "from the height of the cameras" if job.mix.scale_known else "for an object 1 m across"
        lines.append(f"  assumed scale: 1 m is {job.mix.scale.metre:.2g} units of the splat, {how}")
        lux = job.mix.scale.irradiance / (job.mix.scale.candela or 1.0)
        lines.append(f"  assumed captured light: {lux:,.0f} lx, the basis of lumens")
    if job.mix.captured_factor != 1.0:
        lines.append(f"  {job.mix.captured_factor:.0%} of the captured light stays; exposed as the capture was")
    return lines


def _costs(job: "Job") -> list[str]:
    """The lines of the summary on seconds beyond a budget, and on the cache on disk."""
    lines, budget_s = [], job.request.lighting.budget_s
    if budget_s is not None:
        beyond = sum(seconds for stage, seconds in job.stages.seconds.items() if stage not in LIGHT_STAGES)
        lines.append(f"  --budget {budget_s:g} covers the light; everything else took {beyond:.1f} s")
    megabytes = round(job.known.relighter.cache.size_bytes / 2**20)
    if megabytes:
        lines.append(f"  {job.known.relighter.cache.folder} keeps {megabytes} MB for the next light (--clear-cache)")
    return lines


if __name__ == "__main__":
    sys.exit(main())
