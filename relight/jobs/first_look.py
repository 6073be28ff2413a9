"""A first look at a splat in new lights, before it is meshed: written as results that the final ones replace."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import staged_folder
from splat2mesh.base.progress import Stages
from splat2mesh.base.strictjson import text_of
from splat2mesh.base.version import VERSION
from splat2mesh.capture import Capture
from splat2mesh.scene.folder import META

from ..light import CAPTURED
from ..light.loading import light_of
from ..output.kinds import FILES
from ..request import RelightRequest
from .earlier_results import FIRST_LOOK, REPORT, check_results, is_first_look

if TYPE_CHECKING:
    from ..quick.look import FirstLook

RELIT = "relit"
"""Folder of results in that of a scene."""


def has_first_look(request: RelightRequest) -> bool:
    """Whether the picture of a request can be shown in advance: under an environment alone."""
    lighting = request.lighting
    plain = not (lighting.changes_captured_light or request.inserted or request.animated or request.day)
    shown = request.formats is None or "png" in request.formats
    return plain and shown and request.albedo in (None, "estimated") and CAPTURED not in request.envs


def write_first_looks(
    request: RelightRequest, capture: Capture, folders: list[tuple[Path, Any, float]], stages: Stages, splat: bool
) -> list[dict[str, Any]]:
    """Write the picture of a Capture in every light, and its relit splat where wanted.

    folders: of each light and angle. Returns the reports. Raises InputError for a capture that has no first look.
    """
    from ..albedo.said import Said
    from ..quick.look import CapturedDay

    started, lighting = time.monotonic(), request.lighting
    with stages.stage("first look"):
        said = Said.read(lighting.captured_sun, lighting.captured_sky, None)
        known = None if request.capture_env is None else light_of(request.capture_env)
        day = CapturedDay.of(capture, said, known, lighting.seed)
        exposure = None if request.exposure_ev is None else 2.0**request.exposure_ev
        reports = []
        for folder, light, angle in folders:
            environment = light_of(light).rotated(angle)
            look = day.under(environment, exposure)
            reports.append(_report(request, environment.name, angle, look, time.monotonic() - started))
            _write(folder, reports[-1], look, request, splat)
    return reports


def _report(request: RelightRequest, light: str, angle: float, look: "FirstLook", seconds: float) -> dict[str, Any]:
    return {
        "version": VERSION,
        "state": FIRST_LOOK,
        "scene": str(request.scene),
        "environment": {"name": light},
        "angle_deg": angle,
        "exposure": look.exposure,
        "seconds": {"first look": round(seconds, 2)},
        "files": [],
    }


def _write(folder: Path, report: dict[str, Any], look: "FirstLook", request: RelightRequest, splat: bool) -> None:
    from ..output.mesh_files import write_png
    from ..splats import write_relit_ply

    check_results(folder, request.overwrite)
    with staged_folder(folder, True, REPORT) as staging:
        write_png(staging / FILES["png"], look.picture)
        report["files"].append(FILES["png"])
        if splat:
            source = Path(os.fspath(request.scene))  # type: ignore[arg-type]
            write_relit_ply(staging / FILES["splat"], look.splats, source if source.suffix.lower() == ".ply" else None)
            report["files"].append(FILES["splat"])
        (staging / REPORT).write_text(text_of(report), encoding="utf-8")


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
    folder.rename(aside)
    try:
        yield
    finally:
        if folder.is_dir():
            (aside / RELIT).rename(folder / RELIT)
            aside.rmdir()
        else:
            aside.rename(folder)


def refuse(request: RelightRequest) -> None:
    """Raise InputError for a request whose quick result there is not."""
    if not has_first_look(request):
        raise InputError("`quick`: it shows a splat under an environment, without lamps, objects or moving things")
