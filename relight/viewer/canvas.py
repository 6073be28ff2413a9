"""Rectangles and texts over a VTK scene, in units that grow with the window.

Two kinds of VTK actors draw them, one for all rectangles and one for each text. They look and work the same in a
window, off screen and in a browser.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from vtkmodules.vtkCommonCore import vtkPoints, vtkUnsignedCharArray
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import (
    vtkActor2D,
    vtkCoordinate,
    vtkPolyDataMapper2D,
    vtkTextActor,
    vtkTextProperty,
    vtkTextRenderer,
)

from ..output.sheet import INK, MARK, PAPER, SHADE


class Style(NamedTuple):
    """How a text looks. size: in units."""

    size: int = 12
    bold: bool = False


SMALL, KEY = Style(), Style(bold=True)


def _between(one: tuple[int, ...], other: tuple[int, ...]) -> tuple[int, ...]:
    return tuple((a + b) // 2 for a, b in zip(one, other, strict=True))


OPAQUE = np.iinfo(np.uint8).max
TEXT, DARK, DIM, WARNING = INK, PAPER, _between(INK, SHADE), MARK
BAR, CHIP, ON, HANDLE = (*DARK, 215), (*SHADE, OPAQUE), (*MARK, OPAQUE), (*TEXT, OPAQUE)
IDLE = *_between(MARK, DARK), OPAQUE
"""sRGB bytes of texts, and of what is drawn, with opacity."""

MARGIN = 16  # units from the edges of the window
_DPI = 72  # a point is a pixel


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
    """Clear it, put rectangles and texts on it, then show it.

    boxes: dict of (text, x, y) -> (left, bottom, width, height) in pixels, as shown. scale: pixels in a unit.
    """

    def __init__(self, renderer: Any) -> None:
        self._renderer = renderer
        self._texts: list[list[Any]] = []  # actors, and what each shows
        self._drawn: tuple[list[tuple], list[tuple]] | None = None
        self._points, self._quads, self._colors = vtkPoints(), vtkCellArray(), vtkUnsignedCharArray()
        self._colors.SetNumberOfComponents(4)
        shapes = vtkPolyData()
        shapes.SetPoints(self._points)
        shapes.SetPolys(self._quads)
        shapes.GetCellData().SetScalars(self._colors)
        self._mapper = vtkPolyDataMapper2D()
        self._mapper.SetInputData(shapes)
        pixels = vtkCoordinate()
        pixels.SetCoordinateSystemToDisplay()
        self._mapper.SetTransformCoordinate(pixels)
        self._shapes = vtkActor2D()
        self._shapes.SetMapper(self._mapper)
        renderer.AddViewProp(self._shapes)
        self._measure = vtkTextRenderer.GetInstance()
        self._widths: dict[tuple[str, int, bool], tuple[int, int, int, int]] = {}
        self.boxes: dict[tuple[str, int, int], tuple[int, int, int, int]] = {}
        self.scale = 1.0
        self._rectangles: list[tuple] = []
        self._written: list[tuple] = []
        self.clear(1.0)

    def clear(self, scale: float) -> None:
        """Restart with a unit of this many pixels."""
        self._rectangles, self._written, self.scale = [], [], scale

    def rectangle(self, left: float, base: float, width: float, height: float, color: tuple[int, ...]) -> None:
        """color: (4,) bytes."""
        self._rectangles.append((*(self.scale * n for n in (left, base, left + width, base + height)), color))

    def text(self, left: float, base: float, string: str, color: tuple[int, ...], style: Style = SMALL) -> None:
        """color: (3,) bytes."""
        place = round(self.scale * left), round(self.scale * base)
        self._written.append((string, place, color, self._pixels(style), style.bold))

    def width(self, string: str) -> float:
        """Width of a small text in units."""
        return self._extent(string, self._pixels(SMALL), False)[1] / self.scale

    def fitted(self, string: str, room: float) -> str:
        """The small text, cut short where it is wider than `room` units."""
        stem = string
        while stem and self.width(string) > room:
            stem = stem[:-3].rstrip()
            string = stem + "..." if stem else ""
        return string

    def show(self) -> bool:
        """Pass rectangles and texts to VTK; return whether they changed.

        Texts keep their actors, which redraw themselves on a change.
        """
        drawing = self._rectangles, self._written
        if drawing == self._drawn:
            return False
        self._drawn = drawing
        self._points.Reset()
        self._quads.Reset()
        self._colors.Reset()
        for left, low, right, high, color in self._rectangles:
            first = self._points.GetNumberOfPoints()
            for corner in ((left, low), (right, low), (right, high), (left, high)):
                self._points.InsertNextPoint(*corner, 0.0)
            self._quads.InsertNextCell(4, range(first, first + 4))
            self._colors.InsertNextTuple4(*color)
        for part in (self._points, self._quads, self._colors, self._mapper.GetInput()):
            part.Modified()
        while len(self._texts) < len(self._written):
            actor = vtkTextActor()
            actor.SetLayerNumber(1)
            self._renderer.AddViewProp(actor)
            self._texts.append([actor, None])
        self.boxes = {}
        for index, entry in enumerate(self._texts):
            actor, before = entry
            now = self._written[index] if index < len(self._written) else None
            actor.SetVisibility(now is not None)
            if now is None:
                continue
            string, (x, y), color, size, bold = now
            if now != before:
                actor.SetInput(string)
                actor.SetTextProperty(_text_property(color, size, bold))
                actor.SetDisplayPosition(x, y)
                entry[1] = now
            left, wide, low, tall = self._extent(string, size, bold)
            self.boxes[string, x, y] = x + left, y + low, wide, tall
        return True

    def _pixels(self, style: Style) -> int:
        return round(self.scale * style.size)

    def _extent(self, string: str, size: int, bold: bool) -> tuple[int, int, int, int]:
        """Left, width, lower, height in pixels of a text about its origin; kept, since measuring draws it."""
        key = string, size, bold
        if key not in self._widths:
            properties, box = _text_property((0, 0, 0), size, bold), [0, 0, 0, 0]
            self._measure.GetBoundingBox(properties, string, box, _DPI)
            self._widths[key] = box[0], box[1] - box[0] + 1, box[2], box[3] - box[2] + 1
        return self._widths[key]


def _text_property(color: tuple[int, ...], size: int, bold: bool) -> vtkTextProperty:
    properties = vtkTextProperty()
    properties.SetFontFamilyToArial()
    properties.SetFontSize(size)
    properties.SetColor(*(channel / 255.0 for channel in color))
    properties.SetBold(bold)
    return properties
