"""The likeliest captured lights of a scene, offered in its folder for a person to choose from."""

import os

import numpy as np

from ..light import projections
from ..light.captured_light import LikelyLight, LikelySun, offer
from ..light.environment import Environment
from .captured import Estimate
from .posterior import PosteriorLight, SunLobe

OFFERED = 3
"""Lights, the likeliest first."""

HEIGHT, WIDTH = 64, 128
"""Of their images: texels of 2.8 degrees, half of a sun's spread."""


def offer_lights(folder: str | os.PathLike[str] | None, found: Estimate) -> None:
    """Write `captured_light.json` and its environments into a scene folder; nothing without a folder to write to."""
    if folder is None or not found.lights or not os.path.isdir(folder) or not os.access(folder, os.W_OK):
        return
    directions = projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3)
    entries = []
    for light in found.lights[:OFFERED]:
        image = light.radiance(directions).reshape(HEIGHT, WIDTH, 3).astype(np.float32)
        entries.append((_entry(light), Environment(image, "captured")))
    offer(folder, entries)


def _entry(light: PosteriorLight) -> LikelyLight:
    if light.sun is None:
        return LikelyLight("without a sun", round(light.share, 4), None, "")
    sun = _sun(light, light.sun)
    name = f"sun {sun.height_deg:.0f} degrees high at {sun.azimuth_deg:.0f}"
    return LikelyLight(name, round(light.share, 4), sun, "")


def _sun(light: PosteriorLight, lobe: SunLobe) -> LikelySun:
    """The LikelySun of a light: its irradiance is that of the light over what it would be without the lobe."""
    directions = projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3)
    areas = np.repeat(projections.row_solid_angles(HEIGHT, WIDTH).ravel(), WIDTH)
    added = light.radiance(directions) - light._replace(sun=None).radiance(directions)
    irradiance = np.maximum((areas * np.maximum(directions @ lobe.direction, 0.0)) @ added, 0.0)
    x, y, z = lobe.direction
    azimuth = float(np.degrees(np.arctan2(x, -z)) % 360.0)
    height = float(np.degrees(np.arcsin(np.clip(y, -1.0, 1.0))))
    red, green, blue = (round(float(value), 4) for value in irradiance)
    return LikelySun(round(azimuth, 1), round(height, 1), (red, green, blue))
