"""Pictures of light in files, `.exr` and `.hdr`, as arrays."""

import contextlib
import difflib
import io
import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.base.console import quiet_libraries
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.inputs import GIB, file_size
from splat2mesh.scene.gltftextures import MOST_TEXELS

from . import radiance_hdr, skies
from .color_spaces import as_rec709

_EXR_MAGIC, _HDR_MAGIC = b"\x76\x2f\x31\x01", b"#?"

COMBINED = {"combined", "beauty", "rgba"}
"""Names of the layer or part that is the picture: Blender's; of most renderers; of Arnold and Nuke."""

LARGEST_FILE = 4 * GIB  # bytes; the largest published pictures of light have 2 GB

MOST_CHANNELS = 8
"""Factor on the values of all channels and parts of a file: light needs three channels, renderers write some more."""


def read_light(path: Path) -> Radiance:
    """(H, W, 3) float pixels of an OpenEXR or Radiance HDR file, distinguished by their first bytes."""
    try:
        exists = os.path.lexists(path)
    except (OSError, ValueError):
        exists = False
    if not exists:
        raise InputError(_unknown(path))
    if file_size(path, "light") > LARGEST_FILE:
        raise InputError(f"{path} takes over {LARGEST_FILE >> 30} GB: make it smaller")
    data = path.read_bytes()
    if not data:
        raise InputError(f"{path} is empty: expected an OpenEXR or Radiance HDR image")
    if data.startswith(_EXR_MAGIC):
        check_exr(path, [part.header for part in _exr_parts(path, header_only=True)], len(data))
        return _read_exr(path)
    if data.startswith(_HDR_MAGIC):
        return radiance_hdr.decode(data, path)
    raise InputError(
        f"{path} is neither OpenEXR nor Radiance HDR: give a file that holds linear radiance, "
        "which PNG, JPEG and other display pictures do not"
    )


def check_exr(name: object, headers: list[dict[str, Any]], size: int) -> None:
    """Check the sizes in the headers of the parts of an OpenEXR file of so many bytes, before its pixels are read.

    Raises InputError for sizes that make no sense, deep pixels, or more pixels or channels than may be read.
    """
    values = 0
    for header in headers:
        if header["type"].name.startswith("deep"):
            raise InputError(f"{name} holds deep pixels, which are not supported: export it flat")
        for window in ("dataWindow", "displayWindow"):
            corners = [int(each) for each in (*header[window][0], *header[window][1])]
            width, height = corners[2] - corners[0] + 1, corners[3] - corners[1] + 1
            if width < 1 or height < 1 or max(map(abs, corners)) > 1 << 24:
                raise InputError(f"{name} is a damaged OpenEXR file: its {window} is {width} x {height}")
            radiance_hdr.check_pixels(name, width, height, size)
            if window == "dataWindow":
                values += width * height * len(header["channels"])
    most = MOST_CHANNELS * max(MOST_TEXELS, size)
    if values > most:
        raise InputError(f"{name} announces {values:,} values in all its channels, expected at most {most:,}")


def _unknown(path: Path) -> str:
    """The message on a missing file: it may be meant as a name, or as a file beside it."""
    beside = [each.name for each in path.parent.iterdir()] if path.parent.is_dir() else []
    lights = [name for name in beside if name.lower().endswith((".exr", ".hdr"))]
    known = {name.lower(): str(path.parent / name) for name in lights}
    if path.parent == Path("."):
        known |= {name: name for name in skies.BUILTIN}
    near = difflib.get_close_matches(path.name.lower(), known, 1)
    meant = f"did you mean {known[near[0]]}? " if near else ""
    names = ", ".join(skies.BUILTIN)
    return f"{path} does not exist: {meant}Give an .exr or .hdr file, or one of {names}"


def _exr_parts(path: Path, header_only: bool = False) -> list[Any]:
    """The parts of an OpenEXR file, or their headers alone."""
    import OpenEXR

    try:
        with quiet_libraries(), contextlib.redirect_stdout(io.StringIO()):
            parts = OpenEXR.File(str(path), separate_channels=True, header_only=header_only).parts
    except Exception as error:  # the binding raises several types, each with a text of its own
        raise InputError(f"{path} is a damaged OpenEXR file ({error}): copy or export it again") from None
    if not parts:  # how the binding reports missing scan lines
        raise InputError(f"{path} is a truncated or damaged OpenEXR file: copy or export it again")
    return list(parts)


def _read_exr(path: Path) -> NDArray[np.float32]:
    """The light of an OpenEXR file in linear sRGB, pasted into its display window: that of `_best` of its layers."""
    parts = _exr_parts(path)
    layers = []
    for part in parts:
        channels = {name: each.pixels for name, each in part.channels.items() if each.pixels.dtype.kind == "f"}
        named = str(part.header.get("name", "")) if len(parts) > 1 else ""
        layers += [(named, layer, channels, part.header) for layer in _layers(channels)]
    if not layers:
        found = ", ".join(name for part in parts for name in part.channels)
        raise InputError(f"{path} has no colour: expected channels R, G and B, or Y alone, found {found}")
    titles = [".".join(filter(None, (named, layer))) for named, layer, _, _ in layers]
    _, layer, channels, header = layers[_best(titles)]
    if len(layers) > 1:
        title = titles[_best(titles)] or "its unnamed layer"
        others = ", ".join(each for each in dict.fromkeys(titles) if each != title)
        message = f"{path}: of {len(layers)} layers {title} is the light; {others} left out"
        warnings.warn(message, DataWarning, stacklevel=4)
    pixels = _layer_pixels(channels, layer)
    if "chromaticities" in header:
        pixels = as_rec709(pixels, _numbers(header["chromaticities"]), path)
    return _in_display_window(pixels, header)


def _layers(channels: Mapping[str, Floats]) -> list[str]:
    """The layers that hold R, G and B, the unnamed one ("", also luminance alone) first."""
    ends = sorted(name[:-1] for name in channels if name == "R" or name.endswith(".R"))
    found = [each.removesuffix(".") for each in ends if {each + "G", each + "B"} <= channels.keys()]
    return ["", *found] if "" not in found and "Y" in channels and "RY" not in channels else found


def _best(titles: Sequence[str]) -> int:
    """The first layer without a name, else the first with a word of COMBINED, else the first."""
    words = [set(title.lower().split(".")) for title in titles]
    return min(range(len(titles)), key=lambda k: (titles[k] != "", not words[k] & COMBINED))


def _layer_pixels(channels: Mapping[str, Floats], layer: str) -> NDArray[np.float32]:
    prefix = layer and layer + "."
    if prefix + "R" not in channels:
        return np.repeat(channels["Y"][..., None].astype(np.float32), 3, axis=2)
    return np.stack([channels[prefix + color].astype(np.float32) for color in "RGB"], axis=-1)


def _numbers(values: Any) -> list[float]:
    """An attribute as numbers; none where it is of another kind, which any writer can give it."""
    try:
        return [float(each) for each in values]
    except (TypeError, ValueError):
        return []


def _in_display_window(pixels: NDArray[np.float32], header: Mapping[str, Any]) -> NDArray[np.float32]:
    """The pixels of the display window: black where there is no data; data outside it is dropped."""
    data, display = (np.asarray(header[window], int) for window in ("dataWindow", "displayWindow"))
    (left, top), (right, bottom) = data - display[0]
    width, height = display[1] - display[0] + 1
    if (left, top, right, bottom) == (0, 0, width - 1, height - 1):
        return pixels
    image = np.zeros((height, width, 3), pixels.dtype)
    rows, columns = slice(max(top, 0), max(bottom + 1, 0)), slice(max(left, 0), max(right + 1, 0))
    inside = image[rows, columns]
    inside[...] = pixels[max(-top, 0) :, max(-left, 0) :][: inside.shape[0], : inside.shape[1]]
    return image
