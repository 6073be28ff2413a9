"""Rectangles, texts and small pictures over the picture of a scene, in units that grow with the window."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..output.sheet import INK, MARK, PAPER, SHADE

TEXT_SIZE = 12  # units


def _between(one: tuple[int, ...], other: tuple[int, ...]) -> tuple[int, ...]:
    return tuple((a + b) // 2 for a, b in zip(one, other, strict=True))


OPAQUE = np.iinfo(np.uint8).max
TEXT, DARK, DIM, WARNING = INK, PAPER, _between(INK, SHADE), MARK
BAR, CHIP, ON, HANDLE = (*DARK, 215), (*SHADE, OPAQUE), (*MARK, OPAQUE), (*TEXT, OPAQUE)
IDLE = *_between(MARK, DARK), OPAQUE
"""sRGB bytes of texts, and of what is drawn, with opacity."""

MARGIN = 16  # units from the edges of the window


class HotArea(NamedTuple):
    """A part of the window that takes the mouse. box: left, bottom, width, height in pixels.

    name: key of a control, field of a slider, or "split". value: of a mouse position, the resulting slider value.
    lamp: the number of the lamp there.
    """

    box: tuple[float, ...]
    name: str
    value: Callable[[float, float], float] | None = None
    lamp: int | None = None

    def holds(self, x: float, y: float) -> bool:
        """Whether a position is inside."""
        left, bottom, width, height = self.box
        return left <= x < left + width and bottom <= y < bottom + height


class Canvas:
    """Clear it, put rectangles, pictures and texts on it, then draw them over a picture, texts last.

    scale: pixels in a unit.
    """

    def __init__(self) -> None:
        self.clear(1.0)

    def clear(self, scale: float) -> None:
        """Restart with a unit of this many pixels."""
        self.scale, self._font = scale, _font(round(scale * TEXT_SIZE))
        self._shapes: list[tuple[tuple[int, ...], Any]] = []  # left, lower, right, upper; a colour or a picture
        self._texts: list[tuple[str, int, int, tuple[int, ...]]] = []

    @property
    def contents(self) -> tuple[list, list]:
        """What is on it, to compare."""
        return self._shapes, self._texts

    @property
    def boxes(self) -> dict[tuple[str, int, int], tuple[float, ...]]:
        """Where each text stands: dict of (text, x, y) -> (left, bottom, width, height) in pixels."""
        found: dict[tuple[str, int, int], tuple[float, ...]] = {}
        for string, x, y, _ in self._texts:
            left, top, right, bottom = self._font.getbbox(string, anchor="ls")
            found[string, x, y] = x + left, y - bottom, right - left, bottom - top
        return found

    def rectangle(self, left: float, base: float, width: float, height: float, color: tuple[int, ...]) -> None:
        """color: (4,) bytes."""
        self._shapes.append((self._pixels(left, base, left + width, base + height), color))

    def picture(self, left: float, base: float, cell: float, shown: NDArray[np.uint8]) -> None:
        """shown: (H, W, 3), whose pixels are squares with sides of `cell` units."""
        height, width = shown.shape[:2]
        box = self._pixels(left, base, left + width * cell, base + height * cell)
        sides = box[2] - box[0], box[3] - box[1]
        self._shapes.append((box, Image.fromarray(shown).resize(sides, Image.Resampling.NEAREST)))

    def text(self, left: float, base: float, string: str, color: tuple[int, ...]) -> None:
        """color: (3,) bytes."""
        x, y = self._pixels(left, base)
        self._texts.append((string, x, y, color))

    def width(self, string: str) -> float:
        """Width of a text in units."""
        return float(self._font.getlength(string)) / self.scale

    def fitted(self, string: str, room: float) -> str:
        """The text, cut short where it is wider than `room` units."""
        stem = string
        while stem and self.width(string) > room:
            stem = stem[:-3].rstrip()
            string = stem + "..." if stem else ""
        return string

    def over(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """What is on it before a picture (H, W, 3)."""
        image = Image.fromarray(picture)
        pen, floor = ImageDraw.Draw(image, "RGBA"), image.height
        for (left, low, right, high), shown in self._shapes:
            if isinstance(shown, Image.Image):
                image.paste(shown, (left, floor - high))
            elif right > left and high > low:
                pen.rectangle((left, floor - high, right - 1, floor - low - 1), shown)
        for string, x, y, color in self._texts:
            pen.text((x, floor - y), string, color, self._font, anchor="ls")
        return np.array(image)

    def _pixels(self, *units: float) -> tuple[int, ...]:
        return tuple(round(self.scale * each) for each in units)


@lru_cache
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
