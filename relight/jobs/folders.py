"""Results of a request in folders: every light at every angle, a sheet of all, a film; a splat is meshed first.

One call of `relight_files` does what one relight command does.
"""

import contextlib
import math
import os
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from splat2mesh.api import default_folder
from splat2mesh.base.console import recorded_warnings
from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import check_output
from splat2mesh.base.progress import Stages
from splat2mesh.capture import Capture, capture_of
from splat2mesh.layout import is_layout

from ..animation.film import joined
from ..light.daylight import DaylightRequest
from ..light.environment import Environment
from ..light.loading import light_of
from ..output.kinds import FILES, SHEET
from ..request import AnyLight, RelightRequest
from ..splats.kept_parts import with_files
from ..splats.lit_part import LitPart, with_kept_lights
from ..splats.part_spec import SplatFile
from ..splats.parts import AskedPart
from .earlier_results import check_results, is_first_look, is_results, settings_of
from .first_look import RELIT, discard, has_first_look, refuse, write_first_looks
from .job import Job
from .meshing import SceneAtHand, existing_scene, is_splat, refuse_meshing, scene_at_hand
from .sequence import SplatSequence
from .writer import Writer

CITY = "city.json"
"""Marks the folder of a city that splat2mesh made in tiles."""

DAY_FILM = "day.mp4"

LIGHTS = (".exr", ".hdr")
"""Endings of the lights that a folder of them holds."""


@dataclass(frozen=True, eq=False)
class RelitFiles:
    """The results of `relight_files`.

    folders : one for each light and angle. reports : of each, JSON-clean. sheet : path of the sheet of several lights.
    notes : lines on earlier results and on what is missing. job : the last Job; None for a city. film : of a day.
    """

    folders: list[Path]
    reports: list[dict[str, Any]]
    sheet: Path | None = None
    notes: list[str] = field(default_factory=list)
    job: Job | None = None
    film: Path | None = None

    @property
    def files(self) -> list[Path]:
        """Paths of all files, those of the first light first."""
        pairs = zip(self.folders, self.reports, strict=True)
        found = [folder / name for folder, report in pairs for name in report.get("files", ())]
        return found + [path for path in (self.sheet, self.film) if path is not None]


def relight_files(request: RelightRequest, stages: Stages | None = None) -> RelitFiles:
    """Carry out a RelightRequest and write its results.

    Raises InputError for what cannot be read, used or written, before any work where possible; UnfinishedError where
    tiles of a city failed and the others are done.
    """
    stages, request = stages or Stages(), _with_parts_by_hand(request)
    if request.quick:
        refuse(request)
    if is_city(request):
        from ..tiles.city import relight_city

        report = relight_city(request, stages=stages)
        lines = [f"{report['output']}: {report['vertices']:,} vertices in {report['tiles']} tiles"]
        return RelitFiles([Path(report["output"])], [report], notes=lines)
    with recorded_warnings() as messages:
        if request.quick:
            return _first_looks(request, stages)
        if request.sequence:
            return _relit_sequence(request, stages, messages)
        capture, shown = _look_ahead(request, stages)
        try:
            request, at_hand, notes = meshed_request(request, stages, capture)
        except BaseException:
            if shown is not None:
                discard(shown, Path(default_folder(os.fspath(request.scene))))  # type: ignore[arg-type]
            raise
        del capture
        return _relit(request, at_hand, stages, messages, notes)


def _with_parts_by_hand(request: RelightRequest) -> RelightRequest:
    """The request with masks for the names of parts in the folder of its scene."""
    parted = request.only or request.keep or request.parts
    if not parted or not isinstance(request.scene, (str, os.PathLike)) or "://" in os.fspath(request.scene):
        return request
    whole = Path(request.scene).is_file() or request.sequence
    folder = default_folder(request.scene) if whole else request.scene
    only, keep = (with_files(each, folder) for each in (request.only, request.keep))
    return replace(request, only=only, keep=keep, parts=with_kept_lights(request.parts, folder))


def is_city(request: RelightRequest) -> bool:
    """Whether the scene of a request is a city in tiles."""
    scene = request.scene
    if not isinstance(scene, (str, os.PathLike)):
        return False
    return request.tiling is not None or "://" in os.fspath(scene) or (Path(scene) / CITY).is_file()


def _first_looks(request: RelightRequest, stages: Stages) -> RelitFiles:
    """The first looks at a splat in all lights, with relit splats, and nothing else."""
    if not isinstance(request.scene, (str, os.PathLike)) or not _is_one_splat(request.scene):
        raise InputError(f"`quick`: {request.scene} is no splat file, and meshes need no first look")
    lights = lights_of(request)
    folders = output_folders(request, lights)
    capture = capture_of(request.scene, request.meshing, stages)
    splat = request.formats is None or "splat" in request.formats
    try:
        reports = write_first_looks(request, capture, _work(folders, lights, request), stages, splat)
    except InputError as error:
        raise InputError(f"`quick`: {request.scene}: {error}") from error
    found = RelitFiles(folders, reports)
    found.notes.extend(map(str, found.files))
    return found


def _look_ahead(request: RelightRequest, stages: Stages) -> tuple[Capture | None, Path | None]:
    """Show a splat that has no scene yet in the first of its lights, where that is possible, or find a requested part:
    what was read of it, and the folder of the picture."""
    part = AskedPart.parse(request.only, request.keep)
    parts = ([] if part is None else [part]) + [LitPart.parse(each).part for each in request.parts]
    scene = splat_to_mesh(request) if has_first_look(request) or parts else None
    if scene is None:
        return None, None
    if parts:
        capture = capture_of(scene, request.meshing, stages)
        for each in parts:
            each.of_splats(SplatFile(capture.loaded, Path(scene)))  # or an InputError, before it is meshed
        return capture, None
    lights = lights_of(request)
    folder = output_folders(replace(request, scene=default_folder(scene)), lights)[0]
    capture = capture_of(scene, request.meshing, stages)
    if is_results(folder) and not is_first_look(folder):
        return capture, None  # final results are replaced by final ones
    with contextlib.suppress(InputError):  # a closed room is shown when it is meshed
        write_first_looks(request, capture, _work([folder], lights, request), stages, False)
        stages.notify(f"{folder / FILES['png']}: a first look; meshing goes on, and the final picture replaces it")
    return capture, folder


def splat_to_mesh(request: RelightRequest) -> str | os.PathLike[str] | None:
    """The file of splats, of which there is no scene yet, that a request is for; None for another request."""
    scene = request.scene
    if not isinstance(scene, (str, os.PathLike)) or not os.path.exists(scene) or not _is_one_splat(scene):
        return None
    return scene if existing_scene(scene, request.meshing) is None else None


def _work(folders: list[Path], lights: list[AnyLight], request: RelightRequest) -> list[tuple[Path, Any, float]]:
    """Each folder with its light and angle."""
    return [(folder, *each) for folder, each in zip(folders, product(lights, request.angles_deg), strict=False)]


def _is_one_splat(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a file of splats, and neither a folder nor a layout of several."""
    return Path(path).is_file() and is_splat(path) and not is_layout(path)


def meshed_request(
    request: RelightRequest, stages: Stages, capture: Capture | None = None
) -> tuple[RelightRequest, SceneAtHand | None, list[str]]:
    """Turn a request for a splat into one for its scene folder, made if missing, with that scene and summary lines.

    capture: of the splat, where it was read before."""
    if _names_splat(request):
        at_hand, notes = scene_at_hand(request.scene, request.meshing, stages, capture)  # type: ignore[arg-type]
        return replace(request, scene=at_hand.folder), at_hand, notes
    refuse_meshing(request.scene, request.meshing)
    return request, None, []


def planned_request(request: RelightRequest) -> tuple[RelightRequest, SceneAtHand | None] | None:
    """Return the request to plan, without writing, and its scene; None for a splat that is not meshed yet."""
    request = replace(_with_parts_by_hand(request), caching="read")
    if _names_splat(request):
        at_hand = existing_scene(request.scene, request.meshing)  # type: ignore[arg-type]
        return None if at_hand is None else (replace(request, scene=at_hand.folder), at_hand)
    refuse_meshing(request.scene, request.meshing)
    return request, None


def _names_splat(request: RelightRequest) -> bool:
    """Whether the scene of a request is the path of a splat. Raises InputError for a path that does not exist."""
    scene = request.scene
    if not isinstance(scene, (str, os.PathLike)):
        return False
    if not os.path.exists(scene):
        raise InputError(f"{scene}: no such scene folder, splat or mesh file")
    return is_splat(scene)


def lights_of(request: RelightRequest) -> list[AnyLight]:
    """Return the lights of a request, in order; a folder gives all its lights, by name."""
    if request.day:
        return list(request.times)
    found = [light for env in request.envs for light in _in_folder(env)]
    if request.animated and len(found) > 1:
        raise InputError(f"`env` {request.envs[-1]}: an animation has one light")
    return found


def turned_about(request: RelightRequest, axis: tuple[float, float, float] | None) -> RelightRequest:
    """Return the request with its one angle about an axis (3,) of the scene frame, right-handed.

    About the vertical only the angle can change; about another axis the lights do. None is the vertical. Raises
    InputError for the sky of a date, and for lights that cannot be read.
    """
    angle = request.angles_deg[0]
    if axis is None or angle % 360.0 == 0.0:
        return request
    if axis[0] == axis[2] == 0.0:
        return request if axis[1] > 0.0 else replace(request, angles_deg=(-angle % 360.0,))
    lights = lights_of(request)
    if any(isinstance(each, DaylightRequest) for each in lights):
        raise InputError("--rotate: the sky of a date turns about the vertical alone; leave the axis out")
    return replace(request, env=[light_of(each).turned_about(axis, angle) for each in lights], angles_deg=(0.0,))


def first_light(request: RelightRequest) -> AnyLight:
    """Return the light of a request, the first of a folder or of a day. Raises InputError for several."""
    _ = request.light
    return lights_of(request)[0]


def _in_folder(env: AnyLight) -> list[AnyLight]:
    """The light files in a folder, by name; anything else as it is."""
    if isinstance(env, (Environment, DaylightRequest)) or not Path(env).is_dir():
        return [env]
    found: list[AnyLight] = [str(path) for path in sorted(Path(env).iterdir()) if path.suffix.lower() in LIGHTS]
    if not found:
        raise InputError(f"`env` {env}: the folder holds no .exr and no .hdr file")
    return found


def output_folders(request: RelightRequest, lights: list[AnyLight]) -> list[Path]:
    """Return the folder of every light and angle. Raises InputError for one that must not be written."""
    angles, output = request.angles_deg, request.output
    if output is not None and len(angles) == len(lights) == 1:
        folders = [Path(output)]
    else:
        parent = _default_parent(request.scene) if output is None else Path(output)
        folders = [parent / _name(light, angle) for light in lights for angle in angles]
    beside = [] if request.day else lights
    for folder, (light, angle) in zip(folders, product(lights, angles), strict=True):
        if folders.count(folder) > 1:
            message = f"two of its lights would go into {folder}; rename one of their files"
            raise InputError(f"`env` {request.envs[-1]}: {message}")
        turned = angle + (light.rotation_deg if isinstance(light, Environment) else 0.0)
        settings = None if request.animated else partial(settings_of, request, light, turned, beside)
        check_results(folder, request.overwrite, settings)
    if request.sheet and len(folders) > 1:  # of the same lights it would be the same
        check_output(folders[0].parent / SHEET, request.overwrite or all(map(is_results, folders)))
    return folders


def _relit_sequence(request: RelightRequest, stages: Stages, messages: list[str]) -> RelitFiles:
    sequence = SplatSequence(request, stages)
    lights = lights_of(sequence.request)
    folders, each = output_folders(sequence.request, lights), len(request.angles_deg)
    work = [(light, folders[number * each : (number + 1) * each]) for number, light in enumerate(lights)]
    reports, job = sequence.write(work, messages)
    return RelitFiles(folders, reports, notes=[*sequence.notes, sequence.counted], job=job)


def _relit(
    request: RelightRequest, at_hand: SceneAtHand | None, stages: Stages, messages: list[str], notes: list[str]
) -> RelitFiles:
    lights = lights_of(request)
    folders = output_folders(request, lights)
    job = Job(request.under(lights[0]), stages, at_hand)
    if request.clear_cache:
        job.known.relighter.cache.clear()
    if request.day and request.exposure_ev is None:
        brightest = max(request.times, key=lambda each: each.environment().mean_luminance)
        request = replace(request, exposure_ev=math.log2(next(job.under(brightest).shaded()).exposure))
        job = Job(request.under(lights[0]), known=job.known)
    writer = Writer(job, messages, [] if request.day else lights)
    if request.animated:
        note, report = writer.film(folders[0], request.fps, request.overwrite)
        return RelitFiles(folders, [report], notes=notes + [note] * bool(note), job=job)
    try:
        job.begin()
        writer, reports = _written(writer, lights, folders, request.overwrite)
    except BaseException:
        job.known.leave()
        raise
    sheet = writer.write_sheet(folders[0].parent) if request.sheet and len(folders) > 1 else None
    film = None
    if request.day and "png" in writer.job.inputs.formats:
        note = joined([folder / FILES["png"] for folder in folders], folders[0].parent / DAY_FILM, request.fps)
        film, notes = None if note else folders[0].parent / DAY_FILM, notes + [note] * bool(note)
    return RelitFiles(folders, reports, sheet, notes, writer.job, film)


def _written(
    writer: Writer, lights: list[AnyLight], folders: list[Path], overwrite: bool
) -> tuple[Writer, list[dict[str, Any]]]:
    """Write light after light, the first with this Writer: (that of the last one, the report of each folder)."""
    reports: list[dict[str, Any]] = []
    left = iter(folders)
    for light in lights:
        writer = writer if light is lights[0] else writer.under(light)
        for shaded in writer.job.shaded():
            if len(reports) + 1 == len(folders):
                writer.job.let_go(shaded)
            reports.append(writer.write(shaded, next(left), overwrite))
    return writer, reports


def _default_parent(scene: object) -> Path:
    """The folder for the folders of lights: in a scene folder, or beside a mesh in the current folder."""
    if not isinstance(scene, (str, os.PathLike)):
        raise InputError("`output`: a scene in memory has no folder of its own; name one")
    source = Path(scene)
    return Path(f"{source.stem}_relit") if source.is_file() else source / RELIT


def _name(light: AnyLight, angle_deg: float) -> str:
    """The name of a folder: that of a light's file or of its sky, in any case, and the angle: sunset_45."""
    if isinstance(light, (Environment, DaylightRequest)):
        name = light.name
    else:
        name = Path(light).stem if Path(light).exists() else Path(light).stem.lower()
    return f"{name}_" + f"{angle_deg:.6f}".rstrip("0").rstrip(".")
