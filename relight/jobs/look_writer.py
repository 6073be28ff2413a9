"""Writes first looks at a splat in new lights, before it is meshed: results that the final ones replace."""

import os
import time
from pathlib import Path
from typing import Any

from splat2mesh.base.outputs import staged_folder
from splat2mesh.base.progress import Stages
from splat2mesh.base.strictjson import text_of
from splat2mesh.base.version import VERSION
from splat2mesh.capture import Capture

from ..albedo.said import Said
from ..light.loading import light_of
from ..output.kinds import FILES
from ..output.mesh_files import write_png
from ..quick.look import CapturedDay, FirstLook
from ..request import RelightRequest
from ..splats import write_relit_ply
from .earlier_results import FIRST_LOOK, REPORT, check_results


def write_first_looks(
    request: RelightRequest, capture: Capture, folders: list[tuple[Path, Any, float]], stages: Stages, splat: bool
) -> list[dict[str, Any]]:
    """Write the picture of a Capture in every light, and its relit splat where wanted.

    folders: of each light and angle. Returns the reports. Raises InputError for a capture that has no first look.
    """
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


def _report(request: RelightRequest, light: str, angle: float, look: FirstLook, seconds: float) -> dict[str, Any]:
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


def _write(folder: Path, report: dict[str, Any], look: FirstLook, request: RelightRequest, splat: bool) -> None:
    check_results(folder, request.overwrite)
    with staged_folder(folder, True, REPORT, keep=True) as staging:
        write_png(staging / FILES["png"], look.picture)
        report["files"].append(FILES["png"])
        if splat:
            source = Path(os.fspath(request.scene))  # type: ignore[arg-type]
            write_relit_ply(staging / FILES["splat"], look.splats, source if source.suffix.lower() == ".ply" else None)
            report["files"].append(FILES["splat"])
        (staging / REPORT).write_text(text_of(report), encoding="utf-8")
