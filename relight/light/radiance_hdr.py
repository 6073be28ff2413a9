"""Radiance pictures (.hdr, RGBE) as writers have made them since 1991: plain or in run lengths, row after row.

Source: Ward, "Real Pixels", Graphics Gems II (1991); Radiance, src/common/color.c, header.c and resolu.c.
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import FREE
from splat2mesh.base.kernels import kernel
from splat2mesh.scene.gltftextures import MOST_TEXELS

from .color_spaces import XYZ, as_rec709

_RESOLUTION = re.compile(rb"([+-])Y +(\d{1,9}) +\+X +(\d{1,9})\s*")
_DAMAGED = "is a damaged or unusual Radiance HDR file"
_NEW_RUNS = 8, 32767  # widths that may be packed in the new way


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
