"""Pictures of light in files as arrays: OpenEXR, and Radiance as writers have made it since 1991, row after row.

Source of Radiance (.hdr, RGBE): Ward, "Real Pixels", Graphics Gems II (1991), and its src/common/color.c, header.c and
resolu.c.
"""

import contextlib
import difflib
import io
import os
import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.base.console import quiet_libraries
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.inputs import FREE, GIB, file_size
from splat2mesh.base.kernels import kernel
from splat2mesh.scene.gltftextures import MOST_TEXELS

from . import skies
from .color_spaces import XYZ, as_rec709

_EXR_MAGIC, _HDR_MAGIC = b"\x76\x2f\x31\x01", b"#?"

COMBINED = {"combined", "beauty", "rgba"}
"""Names of the layer or part that is the picture: Blender's; of most renderers; of Arnold and Nuke."""

LARGEST_FILE = 4 * GIB  # bytes; the largest published pictures of light have 2 GB

MOST_CHANNELS = 8
"""Factor on the values of all channels and parts of a file: light needs three channels, renderers write some more."""

_RESOLUTION = re.compile(rb"([+-])Y +(\d{1,9}) +\+X +(\d{1,9})\s*")
_DAMAGED = "is a damaged or unusual Radiance HDR file"
_NEW_RUNS = 8, 32767  # widths that may be packed in the new way


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
        return decode(data, path)
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
            check_pixels(name, width, height, size)
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


def check_pixels(name: object, width: int, height: int, size: int) -> None:
    """Raise InputError for a picture that declares more pixels than its file has bytes, or than MOST_TEXELS where that
    is more. name: of the file."""
    most = max(MOST_TEXELS, size)
    if width * height > most:
        raise InputError(
            f"{name} announces {width} x {height} pixels in {size:,} bytes, expected at most {most:,}: make it smaller"
        )


def decode(data: bytes, name: object) -> NDArray[np.float32]:
    """Decode a Radiance picture, given whole, into linear sRGB radiance (H, W, 3) float32, the top row first.

    It is divided by the EXPOSURE and COLORCORR of the header, and converted from its PRIMARIES or CIE XYZ. Raises
    InputError for a damaged file, and for one that announces more pixels than its bytes can hold.

    imagecodecs decodes the usual order of rows alike, bit by bit, but ignores exposures and reads no rows from below
    (`docs/decisions.md`).
    """
    exposure, primaries, (upward, rows, columns), start = _header(data, name)
    check_pixels(name, rows, columns, len(data))
    pixels = np.zeros((rows, columns, 4), np.uint8)
    done = _unpack(np.frombuffer(data, np.uint8), start, pixels, _NEW_RUNS[0] <= columns <= _NEW_RUNS[1])
    if done < rows:
        raise InputError(f"{name} {_DAMAGED}: {done} of {rows} rows can be read: export it again")
    pixels = pixels[::-1] if upward else pixels
    scale = np.ldexp(np.float32(1.0), pixels[..., 3:].astype(np.int32) - 136)
    scale[pixels[..., 3:] == 0] = 0.0
    with np.errstate(over="ignore"):
        image = (pixels[..., :3] * scale / exposure).astype(np.float32)
    stated = primaries or ()  # Photoshop writes zeros
    return as_rec709(image, stated, name) if any(stated) else image


def _header(
    data: bytes, name: object
) -> tuple[NDArray[np.float64], Sequence[float] | None, tuple[bool, int, int], int]:
    """(exposures of (3,), primaries, what `_size` returns, where the pixels start)."""
    exposure = np.ones(3)
    primaries: Sequence[float] | None = None
    entries, start = _entries(data, name)
    for key, value in entries:
        try:
            if key == b"EXPOSURE":
                exposure *= float(value)
            elif key == b"COLORCORR":
                exposure *= [float(part) for part in value.split()]
            elif key == b"PRIMARIES" and primaries is not XYZ:
                primaries = [float(part) for part in value.split()]
        except ValueError as error:
            raise InputError(f"{name} {_DAMAGED}: {key.decode()} is {error}") from None
        if key == b"FORMAT" and value == b"32-bit_rle_xyze":
            primaries = XYZ
        elif key == b"FORMAT" and value != b"32-bit_rle_rgbe":
            raise InputError(f"{name} is of an unknown kind: convert it to 32-bit_rle_rgbe or OpenEXR")
    if not (np.isfinite(exposure).all() and (exposure > 0.0).all()):
        raise InputError(f"{name} {_DAMAGED}: its exposure is {exposure.tolist()}")
    return exposure, primaries, *_size(data, start, name)


def _entries(data: bytes, name: object) -> tuple[list[tuple[bytes, bytes]], int]:
    """[(key, value)] of the lines of a header, and where the line after it starts."""
    found: list[tuple[bytes, bytes]] = []
    start = 0
    while True:
        end = data.find(b"\n", start, FREE)
        if end < 0:
            raise InputError(f"{name} {_DAMAGED}: its header has no end")
        line, start = data[start:end].strip(), end + 1
        if not line:
            return found, start
        key, _, value = line.partition(b"=")
        found.append((key, value.strip()))


def _size(data: bytes, start: int, name: object) -> tuple[tuple[bool, int, int], int]:
    """(whether rows go upward, rows, columns), and where the pixels start."""
    end = data.find(b"\n", start, start + 100)
    found = _RESOLUTION.fullmatch(data[start:end]) if end >= 0 else None
    if found is None or not (int(found[2]) and int(found[3])):
        raise InputError(f"{name} {_DAMAGED}: its picture has no size, such as -Y 512 +X 1024")
    return (found[1] == b"+", int(found[2]), int(found[3])), end + 1


@kernel
def _unpack(data: NDArray[np.uint8], at: Any, pixels: NDArray[np.uint8], may_be_new: bool) -> int:
    """Fill the rows of pixels (H, W, 4), in the order of the file; how many are all there."""
    size = len(data)
    for row in range(pixels.shape[0]):
        width = pixels.shape[1]
        line = pixels[row]
        new = may_be_new and at + 4 <= size and data[at] == 2 and data[at + 1] == 2 and data[at + 2] < 128
        if new:
            if (np.int64(data[at + 2]) << 8 | np.int64(data[at + 3])) != width:
                return row
            at += 4
            for channel in range(4):
                x = np.int64(0)
                while x < width:
                    if at >= size:
                        return row
                    count = np.int64(data[at])
                    at += 1
                    if count > 128:
                        count -= 128
                        if at >= size or x + count > width:
                            return row
                        for k in range(count):
                            line[x + k, channel] = data[at]
                        at += 1
                    else:
                        if count == 0 or at + count > size or x + count > width:
                            return row
                        for k in range(count):
                            line[x + k, channel] = data[at + k]
                        at += count
                    x += count
            continue
        for column in range(width):
            if at + 4 > size or (data[at] == 1 and data[at + 1] == 1 and data[at + 2] == 1):  # a run of before 1991
                return row
            for channel in range(4):
                line[column, channel] = data[at + channel]
            at += 4
    return pixels.shape[0]
