"""probe.exr: the light that arrives at a place, and a picture of two balls in it; probes/probes.json: the light at
several places, nine harmonics each, for engines."""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Points, Vector
from splat2mesh.base.errors import DataWarning
from splat2mesh.base.outputs import staged_file
from splat2mesh.base.strictjson import text_of
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.measured import SKY_HEIGHT
from splat2mesh.scene.scene import Scene

from ..insert.probe import ProbedScene, ProbeGrid, free, usual_box, usual_place
from ..light.environment import Environment
from ..light.tonemap import compress_highlights
from ..sh import harmonics
from ..transfer import FEW_BANDS
from ..transfer.occluder import Occluder
from .images import write_exr, write_png
from .kinds import PICTURE_SIZE

BALL = PICTURE_SIZE[1] // 2
"""Side of the picture of a ball, in pixels."""

GREY = 0.5
"""Albedo of the grey ball."""

FORMAT, VERSION = "relight-probes", 1

NAME = "probes/probes.json"

DIGITS = np.finfo(np.float32).precision
"""Significant digits of numbers in the file: nearly those of float32."""


def write_probes(
    folder: Path, probed: ProbedScene, places: Sequence[Vector], grid: ProbeGrid | None = None
) -> list[str]:
    """Write a probe for each place: probe.exr, probe_2.exr ..., and pictures of their balls; of several places, and
    of a grid, the light for engines. Returns the names.

    places: frame of the splats; the usual one without any. grid: in the box about the places."""
    names, images = [], []
    own = [] if grid is not None else places
    for number, place in enumerate(own or [usual_place(probed.scene, probed.occluder)], 1):
        image = probed.picture(place)
        images.append(image)
        stem = "probe" if number == 1 else f"probe_{number}"
        write_exr(folder / f"{stem}.exr", {"RGB": image})
        write_png(folder / f"{stem}.png", balls(image))
        names += [f"{stem}.exr", f"{stem}.png"]

    def light_at(number: int, place: Vector) -> NDArray[np.float32]:
        return images[number] if grid is None else probed.picture(place, SKY_HEIGHT)

    at = places_of(grid, places, probed.scene)
    return names + write_probe_set(folder, probed.scene, probed.occluder, at, light_at)


def balls(image: NDArray[np.float32]) -> NDArray[np.uint8]:
    """A chrome and a grey ball in the light of a lat-long picture, from the +z side: (BALL, 2 BALL, 3) uint8 sRGB."""
    environment = Environment(image, "probe")
    across = (np.arange(BALL) + 0.5) / BALL * 2.2 - 1.1
    x, y = np.meshgrid(across, -across)
    inside = x**2 + y**2 < 1.0
    normal = np.stack([x, y, np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))], axis=-1)
    mirrored = 2.0 * normal[..., 2:] * normal - np.array([0.0, 0.0, 1.0])
    plain = np.full((BALL, BALL, 3), 0.02, np.float32)
    chrome, grey = plain.copy(), plain.copy()
    chrome[inside] = environment.lookup(mirrored[inside])
    received = harmonics.evaluate(normal[inside], FEW_BANDS) @ irradiance_of(image)
    grey[inside] = GREY * np.maximum(received, 0.0).astype(np.float32)
    return bytes_from_unit(srgb_from_linear(compress_highlights(np.concatenate([chrome, grey], axis=1))))


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
