"""First looks at a splat in new lights, before it is meshed: which requests have one, their folders, their files."""

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import staged_folder
from splat2mesh.base.progress import Stages
from splat2mesh.base.strictjson import text_of
from splat2mesh.base.version import VERSION
from splat2mesh.capture import Capture
from splat2mesh.scene.folder import META

from ..albedo.said import Said
from ..light import CAPTURED
from ..light.environment import Environment
from ..light.loading import light_of
from ..output.images import write_png
from ..output.kinds import FILES
from ..quick.look import CapturedDay, FirstLook
from ..request import RelightRequest
from ..splats import write_relit_ply
from .earlier_results import FIRST_LOOK, REPORT, check_heeded, check_results, is_first_look

RELIT = "relit"
"""Folder of results in that of a scene."""


def has_first_look(request: RelightRequest) -> bool:
    """Whether a picture is wanted that can be shown in advance."""
    parted = request.only or request.keep or request.parts
    return _plain(request) and not parted and (request.formats is None or "png" in request.formats)


def _plain(request: RelightRequest) -> bool:
    """Whether a request shows a capture under environments alone."""
    changes = request.lighting.changes_captured_light or request.inserted or request.animated or request.day
    return not changes and request.albedo in (None, "estimated") and CAPTURED not in request.envs


def first_looks_alone(folder: Path) -> bool:
    """Whether an existing folder has nothing but first looks: its scene was not meshed yet."""
    if (folder / META).exists() or {entry.name for entry in folder.iterdir()} != {RELIT}:
        return False
    return all(is_first_look(results) for results in (folder / RELIT).iterdir())


@contextmanager
def looks_aside(folder: Path) -> Iterator[None]:
    """Move first looks out of the folder of a scene while that is written, then into it."""
    if not (folder.is_dir() and first_looks_alone(folder)):
        yield
        return
    aside = folder.with_name(f".{folder.name}.looks")
    shutil.rmtree(aside, ignore_errors=True)  # of a run that was killed
    folder.rename(aside)
    try:
        yield
    finally:
        if folder.is_dir():
            (aside / RELIT).rename(folder / RELIT)
            aside.rmdir()
        else:
            aside.rename(folder)


HEEDED = "scene env lighting angles_deg sun at north_deg albedo capture_env exposure_ev formats caching meshing output"
HEEDED += " overwrite quick"
"""Fields of a request that a first look obeys, or that change nothing in it."""


def refuse(request: RelightRequest) -> None:
    """Raise InputError for a request whose quick result there is not."""
    if not _plain(request):
        raise InputError("`quick`: it shows a splat under an environment, without lamps, objects or moving things")
    check_heeded(request, HEEDED, "a first look does not heed it; leave out `quick`")
    if "captured_light" in request.lighting.said:
        raise InputError("`captured_light`: a first look has no folder of a scene; leave out `quick`")
    if not {*(request.formats or ())} <= {"png", "splat"}:
        raise InputError("`formats`: a first look has png and splat alone; leave out `quick`")


def discard(results: Path, scene: Path) -> None:
    """Remove the first look in a folder of results, where its scene could not be meshed, and what is empty then."""
    if is_first_look(results):
        shutil.rmtree(results)
    for folder in (scene / RELIT, scene):
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def write_first_looks(
    request: RelightRequest, capture: Capture, folders: list[tuple[Path, Any, float]], stages: Stages, splat: bool
) -> list[dict[str, Any]]:
    """Write the picture of a Capture in every light, and its relit splat where wanted.

    folders: of each light and angle. Returns the reports. Raises InputError for a capture that has no first look.
    """
    started, reports = time.monotonic(), []
    source, files = Path(os.fspath(request.scene)), [FILES["png"], *[FILES["splat"]] * splat]  # type: ignore[arg-type]
    with stages.stage("first look"):
        day = _day_of(request, capture)
        for folder, light, angle in folders:
            environment, look = _under(day, request, light, angle)
            report: dict[str, Any] = {"version": VERSION, "state": FIRST_LOOK, "scene": str(request.scene)}
            report |= {"environment": {"name": environment.name}, "angle_deg": angle, "exposure": look.exposure}
            report |= {"seconds": {"first look": round(time.monotonic() - started, 2)}, "files": files}
            check_results(folder, request.overwrite)
            with staged_folder(folder, True, REPORT, keep=True) as staging:
                write_png(staging / FILES["png"], look.picture)
                if splat:
                    own = source if source.suffix.lower() == ".ply" else None
                    write_relit_ply(staging / FILES["splat"], look.splats, own)
                (staging / REPORT).write_text(text_of(report), encoding="utf-8")
            reports.append(report)
    return reports


def first_picture(request: RelightRequest, capture: Capture, stages: Stages) -> NDArray[np.uint8] | None:
    """The picture (H, W, 3) uint8 of a Capture in the light of a request, for a session to begin with; None for one
    that has no first look."""
    if not _plain(request):
        return None
    with stages.stage("first look"), suppress(InputError):
        day = _day_of(request, capture)
        return _under(day, request, request.light, request.angles_deg[0])[1].picture
    return None


def _day_of(request: RelightRequest, capture: Capture) -> CapturedDay:
    lighting = request.lighting
    said = Said.read(lighting.captured_sun, lighting.captured_sky, None)
    known = None if request.capture_env is None else light_of(request.capture_env)
    return CapturedDay.of(capture, said, known, lighting.seed)


def _under(day: CapturedDay, request: RelightRequest, light: Any, angle: float) -> tuple[Environment, FirstLook]:
    """A light, turned, and the first look in it."""
    environment = light_of(light).rotated(angle)
    return environment, day.under(environment, None if request.exposure_ev is None else 2.0**request.exposure_ev)
