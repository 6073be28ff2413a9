"""Declared sizes of light pictures, checked against their files before memory is allocated."""

from typing import Any

from splat2mesh.base.errors import InputError
from splat2mesh.scene.gltftextures import MOST_TEXELS

MOST_CHANNELS = 8
"""Factor on the values of all channels and parts of a file: light needs three channels, renderers write some more."""


def check_pixels(name: object, width: int, height: int, size: int) -> None:
    """Raise InputError for a picture that declares more pixels than its file has bytes, or than MOST_TEXELS where that
    is more. name: of the file."""
    most = max(MOST_TEXELS, size)
    if width * height > most:
        raise InputError(
            f"{name} announces {width} x {height} pixels in {size:,} bytes, expected at most {most:,}: make it smaller"
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
