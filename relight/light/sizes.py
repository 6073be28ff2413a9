"""Declared sizes of light pictures, checked against their files before memory is allocated."""

import struct
from typing import Any

from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import FREE
from splat2mesh.scene.gltftextures import MOST_TEXELS

MOST_CHANNELS = 8
"""Factor on the values of all channels and parts of a file: light needs three channels, renderers write some more."""

_DEEP = b"deepscanline", b"deeptile"


def check_pixels(name: object, width: int, height: int, size: int) -> None:
    """Raise InputError for a picture that declares more pixels than its file has bytes, or than MOST_TEXELS where that
    is more. name: of the file."""
    most = max(MOST_TEXELS, size)
    if width * height > most:
        raise InputError(
            f"{name} announces {width} x {height} pixels in {size:,} bytes, expected at most {most:,}: make it smaller"
        )


def check_exr(name: object, data: bytes) -> None:
    """Check the sizes in the header of an OpenEXR file, given whole, before it is read.

    Raises InputError for a header that makes no sense, deep pixels, or more pixels or channels than may be read. The
    library that reads the pixels checks the rest. Source: "OpenEXR File Layout".
    """
    try:
        parts = _exr_headers(data)
    except (struct.error, ValueError, IndexError, KeyError) as error:
        raise InputError(f"{name} is a damaged OpenEXR file (its header: {error}): copy or export it again") from None
    values = 0
    for part in parts:
        if part.get("type") in _DEEP:
            raise InputError(f"{name} holds deep pixels, which are not supported: export it flat")
        for window in ("dataWindow", "displayWindow"):
            left, top, right, bottom = struct.unpack("<4i", part[window][:16])
            width, height = right - left + 1, bottom - top + 1
            if width < 1 or height < 1 or max(map(abs, (left, top, right, bottom))) > 1 << 24:
                raise InputError(f"{name} is a damaged OpenEXR file: its {window} is {width} x {height}")
            check_pixels(name, width, height, len(data))
            if window == "dataWindow":
                values += width * height * _channels(part["channels"])
    most = MOST_CHANNELS * max(MOST_TEXELS, len(data))
    if values > most:
        raise InputError(f"{name} announces {values:,} values in all its channels, expected at most {most:,}")


def _channels(packed: bytes) -> int:
    """The number of channels in a channel list: each a name, a zero and 16 bytes."""
    count, at = 0, 0
    while at < len(packed) and packed[at]:
        at = packed.index(b"\0", at) + 17
        count += 1
    return count


def _exr_headers(data: bytes) -> list[dict[str, Any]]:
    """The attributes of each part, as bytes."""
    (version,) = struct.unpack_from("<I", data, 4)
    several, at, parts = bool(version & 0x1000), 8, []
    while True:
        part: dict[str, Any] = {}
        while data[at]:
            end = data.index(b"\0", at, at + 256)
            name = data[at:end].decode("latin-1")
            end = data.index(b"\0", end + 1, end + 257)
            (size,) = struct.unpack_from("<i", data, end + 1)
            at = end + 5 + size
            if size < 0 or at > min(len(data), FREE):
                raise ValueError(f"{name[:40]!a} goes beyond its end")
            part[name] = data[at - size : at].rstrip(b"\0") if name == "type" else data[at - size : at]
        at += 1
        parts.append(part)
        if not several or not data[at]:
            return parts
