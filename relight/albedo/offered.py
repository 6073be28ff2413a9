"""The likeliest captured lights of a scene, offered in its folder for a person to choose from, with drawn suns."""

import os
from functools import cache

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Vector

from ..light import projections
from ..light.captured_light import LikelyLight, LikelySun, offer
from ..light.environment import Environment
from .captured import HEIGHT, WIDTH, Estimate
from .posterior import PosteriorLight

OFFERED = 3
"""Lights, the likeliest first."""

SUN_WIDTH_DEG = 1.5
"""Spread of a drawn sun: about a texel, so that its energy does not depend on where it stands between texels."""


def offer_lights(folder: str | os.PathLike[str] | None, found: Estimate) -> None:
    """Write `captured_light.json` and its environments into a scene folder; nothing without a folder to write to."""
    if folder is None or not found.lights or not os.path.isdir(folder) or not os.access(folder, os.W_OK):
        return
    offer(folder, [_offered(light) for light in found.lights[:OFFERED]])


def _offered(light: PosteriorLight) -> tuple[LikelyLight, Environment]:
    """The entry of a light, and its image, in which its sun is drawn."""
    directions, _ = texels()
    sky, share = light._replace(sun=None).radiance(directions), round(light.share, 4)
    if light.sun is None:
        return LikelyLight("without a sun", share, None, ""), environment_of(sky, "captured")
    irradiance = np.maximum(facing(light.radiance(directions) - sky, light.sun.direction), 0.0)
    x, y, z = light.sun.direction
    azimuth, height = np.degrees(np.arctan2(x, -z)) % 360.0, np.degrees(np.arcsin(np.clip(y, -1.0, 1.0)))
    red, green, blue = (float(value) for value in irradiance)
    sun = LikelySun(float(azimuth), float(height), (red, green, blue))
    name = f"sun {sun.height_deg:.0f} degrees high at {sun.azimuth_deg:.0f}"
    image = sky + drawn_sun(light.sun.direction, irradiance)
    return LikelyLight(name, share, sun, ""), environment_of(image, "captured")


def environment_of(image: Floats, name: str) -> Environment:
    """The Environment of radiance (D, 3) by texel."""
    return Environment(image.reshape(HEIGHT, WIDTH, 3).astype(np.float32), name)


def drawn_sun(direction: Vector, irradiance: Floats) -> NDArray[np.float64]:
    """Radiance (D, 3) by texel of a sun that gives a surface facing it this irradiance (3,)."""
    directions, _ = texels()
    away = np.degrees(np.arccos(np.clip(directions @ direction, -1.0, 1.0)))
    lobe = np.exp(-0.5 * (away / SUN_WIDTH_DEG) ** 2)
    return np.asarray(lobe[:, None] / facing(lobe, direction) * irradiance)


def facing(image: Floats, direction: Vector) -> NDArray[np.float64]:
    """Irradiance of a surface that faces a direction, of radiance (D,) or (D, 3) by texel."""
    directions, areas = texels()
    return np.asarray((areas * np.maximum(directions @ direction, 0.0)) @ image)


@cache
def texels() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions (D, 3) and solid angles (D,) of the images of captured lights."""
    directions = projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3)
    return directions, np.repeat(projections.row_solid_angles(HEIGHT, WIDTH).ravel(), WIDTH)
