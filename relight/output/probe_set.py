"""probes/probes.json: the light at several places, nine harmonics each, for engines."""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Points, Vector
from splat2mesh.base.errors import DataWarning
from splat2mesh.base.outputs import staged_file
from splat2mesh.base.strictjson import text_of
from splat2mesh.scene.scene import Scene

from ..insert.probe import ProbeGrid, free, usual_box
from ..light.environment import Environment
from ..sh import harmonics
from ..transfer import FEW_BANDS
from ..transfer.occluder import Occluder

FORMAT, VERSION = "relight-probes", 1

NAME = "probes/probes.json"

DIGITS = np.finfo(np.float32).precision
"""Significant digits of numbers in the file: nearly those of float32."""


def places_of(grid: ProbeGrid | None, given: Sequence[Vector], scene: Scene) -> NDArray[np.float64]:
    """The places (N, 3) of a grid, scene frame, in the box about the given ones or in the usual box; without a grid the
    given ones themselves, of which a set has several.

    given: (3,) each, frame of the splats."""
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    corners = np.asarray(given, np.float64).reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    if grid is None:
        return corners if len(corners) > 1 else corners[:0]
    low, high = (corners.min(axis=0), corners.max(axis=0)) if len(corners) else usual_box(scene)
    return grid.within(low, high)


def irradiance_of(image: NDArray[np.float32]) -> NDArray[np.float64]:
    """Coefficients (9, 3) of irradiance over pi by the normal, of a lat-long picture of radiance."""
    return np.asarray(harmonics.convolve(Environment(image, "probe").sh(FEW_BANDS)) / np.pi)


def write_probe_set(
    folder: Path,
    scene: Scene,
    occluder: Occluder,
    places: Points,  # (N, 3), scene frame
    light_at: Callable[[int, Vector], NDArray[np.float32]],
) -> list[str]:
    """Write the light at the places that are free, and warn of the others. Returns the names of the files.

    light_at: returns the picture of a place, of its number and its position in the frame of the splats."""
    if not len(places):
        return []
    kept = free(scene, occluder, places)
    if not kept.all():
        left = f"dropped {len(kept) - kept.sum():,} of {len(kept):,} probes, which stand in something or the ground"
        warnings.warn(left if kept.any() else f"{left}: no {NAME}", DataWarning, stacklevel=3)
    if not kept.any():
        return []
    back = np.linalg.inv(np.asarray(scene.scene_from_splat, np.float64))
    probes = []
    for number in np.flatnonzero(kept):
        at = places[number]
        sh = irradiance_of(light_at(int(number), back[:3, :3] @ at + back[:3, 3]))
        probes.append({"position": _rounded(at), "sh": [_rounded(row) for row in sh]})
    content = {"format": FORMAT, "version": VERSION, "probes": probes}
    with staged_file(folder / NAME) as staging:
        staging.write_text(text_of(content) + "\n", encoding="utf-8")
    return [NAME]


def _rounded(values: NDArray[np.float64]) -> list[float]:
    return [float(f"{each:.{DIGITS}g}") for each in values]
