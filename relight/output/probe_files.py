"""probe.exr: the light that arrives at a place, and a picture of a chrome and a grey ball in it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Vector
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.measured import SKY_HEIGHT

from ..insert.probe import ProbedScene, ProbeGrid, usual_place
from ..light.environment import Environment
from ..light.tonemap import compress_highlights
from ..sh import harmonics
from ..transfer import FEW_BANDS
from .images import write_exr, write_png
from .kinds import PICTURE_SIZE
from .probe_set import irradiance_of, places_of, write_probe_set

BALL = PICTURE_SIZE[1] // 2
"""Side of the picture of a ball, in pixels."""

GREY = 0.5
"""Albedo of the grey ball."""


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
