"""A sheet of named pictures side by side: the capture, its albedo, and lights."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont

MOST = 12
"""Pictures on a sheet: of more, an even choice."""

LABEL = 0.075
"""Height of the line with a picture's name, of the picture's height."""

GAP = 4  # pixels between pictures


def grey(level: int) -> tuple[int, int, int]:
    """A grey, sRGB bytes."""
    return level, level, level


INK, PAPER, SHADE, MARK = grey(226), grey(20), grey(48), ImageColor.getrgb("darkorange")
"""sRGB bytes of texts, of what is behind them, of what stands out from that a little, and of what is marked: no surface
is as bright an orange. Of the session too."""


def sheet(
    pictures: Sequence[tuple[str, NDArray]],  # names and pictures, (H, W, 3) uint8, all of one size
) -> NDArray:
    """The sheet, (H, W, 3) uint8: up to three pictures in a row, in two columns where that leaves no gap."""
    if len(pictures) > MOST:
        pictures = [pictures[round(index)] for index in np.linspace(0, len(pictures) - 1, MOST)]
    height, width = pictures[0][1].shape[:2]
    line = round(LABEL * height)
    columns = len(pictures) if len(pictures) <= 3 else 2 if len(pictures) == 4 else 3
    rows = math.ceil(len(pictures) / columns)
    result = np.empty((rows * (height + line + GAP) + GAP, columns * (width + GAP) + GAP, 3), np.uint8)
    result[:] = PAPER
    for index, (name, picture) in enumerate(pictures):
        top = index // columns * (height + line + GAP) + GAP
        left = index % columns * (width + GAP) + GAP
        result[top : top + line, left : left + width] = _written(name, line, width)
        result[top + line : top + line + height, left : left + width] = picture
    return result


def _written(name: str, height: int, width: int) -> NDArray[np.uint8]:
    """A line of text, (height, width, 3) uint8."""
    line = Image.new("RGB", (width, height), PAPER)
    font = ImageFont.load_default(max(round(0.6 * height), 8))
    ImageDraw.Draw(line).text((height // 3, height // 2), name, INK, font, anchor="lm")
    return np.asarray(line)
