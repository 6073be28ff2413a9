"""Render passes: an OpenEXR file for each camera with albedo, light by its path, normals and depth of the mesh.

The light that surfaces receive is stored per pixel as the factor from albedo to picture: pi times the light they send
out by that path, over the albedo. So all passes together give the picture in any colour space, on edges too.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance
from splat2mesh.scene.color import BLACK

from ..light.color_spaces import SPACES, converted
from .images import write_exr
from .kinds import FILES, SUN
from .preview import Preview

FOLDER = "passes"
"""Names of files with several cameras."""


def write_passes(
    folder: Path,
    pictures: Sequence[Preview],
    albedo: Radiance,  # (V, 3) linear
    normals: NDArray[np.float32],  # (V, 3)
    parts: Mapping[str, Radiance],  # name of a path of light -> what vertices send out by it, exposed
    color_space: str,
) -> list[str]:
    """Write a file for each camera; returns their names. All parts but SUN, which is in another, sum to the picture."""
    names, space = [], SPACES[color_space]
    if len(pictures) > 1:
        (folder / FOLDER).mkdir(exist_ok=True)
    for number, picture in enumerate(pictures, 1):
        names.append(FILES["passes"] if len(pictures) == 1 else f"{FOLDER}/{number:04d}.exr")
        seen = {name: converted(picture.values(part)[0], space) for name, part in parts.items()}
        shown, alpha = picture.values(albedo)
        found = _channels(seen, converted(shown, space), picture.values(normals)[0])
        write_exr(
            folder / names[-1], {**found, "A": alpha, "Z": picture.depth()}, {"chromaticities": space.chromaticities}
        )
    return names


def _channels(
    sent: Mapping[str, NDArray[np.float32]], albedo: NDArray[np.float32], normals: NDArray[np.float32]
) -> dict[str, NDArray[np.float32]]:
    """Channels of a file, (H, W) float32 by name, of pictures (H, W, 3)."""
    beauty = np.sum([each for name, each in sent.items() if name != SUN], axis=0)
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0)
    found = {"R": beauty[..., 0], "G": beauty[..., 1], "B": beauty[..., 2]}
    found |= _layer("albedo", albedo, "RGB") | _layer("normals", normals, "XYZ")
    for name, each in {"irradiance": beauty, **sent}.items():
        light = np.divide(np.pi * each, albedo, out=np.zeros_like(each), where=albedo > BLACK)
        found |= _layer(name, light, "RGB")
    return found


def _layer(name: str, image: NDArray[np.float32], letters: str) -> dict[str, NDArray[np.float32]]:
    return {f"{name}.{letter}": image[..., channel] for channel, letter in enumerate(letters)}
