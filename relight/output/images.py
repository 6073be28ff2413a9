"""Pictures as files: PNG, JPEG, WebP and OpenEXR. Every writer writes complete files or none."""

import os
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import staged_file
from splat2mesh.texture.glb import QUALITY

_LOSSY = {"quality": QUALITY}
IMAGES: dict[str, dict[str, Any]] = {".png": {}, ".jpg": _LOSSY, ".jpeg": _LOSSY, ".webp": _LOSSY}
"""Kinds of pictures, by the end of their names, and how they are written."""


def write_png(path: str | os.PathLike[str], image: NDArray) -> None:
    """Write a picture, (H, W, 3) uint8 sRGB, as PNG, whatever its name."""
    with staged_file(path) as staging:
        staging.write_bytes(png_bytes(image))


def write_image(path: str | os.PathLike[str], image: NDArray) -> None:
    """Write a picture, (H, W, 3) uint8 sRGB, as the kind that its name ends in. Raises InputError for other endings."""
    content = _packed(image, check_image(path))
    with staged_file(path) as staging:
        staging.write_bytes(content)


def check_image(path: str | os.PathLike[str]) -> str:
    """The end of a picture's name, a key of IMAGES. Raises InputError for others."""
    kind = os.path.splitext(path)[1].lower()
    if kind not in IMAGES:
        raise InputError(f"{path}: a picture is one of {' '.join(IMAGES)}, found {kind or 'no ending'}")
    return kind


def png_bytes(image: NDArray) -> bytes:
    """A picture (H, W, 3) uint8 as PNG."""
    return _packed(image, ".png")


def write_exr(path: Path, channels: dict[str, NDArray], more: dict[str, Any] | None = None) -> None:
    """Write an OpenEXR file of channels, (H, W, 3) or (H, W), as float32, or half where they are that.

    more: attributes of its header."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **(more or {})}
    kinds = {name: np.float16 if each.dtype == np.float16 else np.float32 for name, each in channels.items()}
    packed = {name: np.ascontiguousarray(each, kinds[name]) for name, each in channels.items()}
    with staged_file(path) as staging:
        OpenEXR.File(header, packed).write(str(staging))


def _packed(image: NDArray, kind: str) -> bytes:
    packed: bytes = iio.imwrite("<bytes>", image, extension=kind, **IMAGES[kind])  # a file would be its own to close
    return packed
