"""What is written on the window: buttons, sliders, figures and help, drawn again whenever one of them changes.

Two kinds of VTK actors draw it, one for all rectangles and one for each text, so that it looks and works the same in a
window, off screen and in a browser.
"""

from collections.abc import Callable
from typing import NamedTuple

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

from ..planning.effects import BOUNCES, SUN
from .controls import CONTROLS, MOUSE, SLIDERS, key_name
from .lighting import CONVERGED, SAMPLE, STAGES
from .modes import MODES, map_colors
from .session import RANGES

DESIGN_SIZE = 960, 720
"""Of the window in which a unit is a pixel; others are scaled by what fits."""

SCALES = 0.5, 3.0
TOP, BOTTOM = 48, 96
"""Heights of the two bars."""

_MARGIN, _GAP = 16, 8
_BAR, _CHIP, _ON = (15, 16, 19, 215), (44, 47, 54, 255), (233, 178, 84, 255)
_IDLE = (122, 99, 58, 255)
_TRACK, _HANDLE, _LINE = (66, 70, 79, 255), (233, 233, 236, 255), (233, 178, 84, 235)
_TEXT, _DIM, _DARK, _WARNING = (226, 228, 232), (150, 155, 164), (24, 22, 18), (240, 150, 110)
_SIZE, _SMALL = 13, 12
_HELP_WIDTH, _HELP_ROW = 720, 21
_DPI = 72  # a point is a pixel


class Hot(NamedTuple):
    """A part of the window that takes the mouse. box: left, bottom, width, height in pixels.

    name: key of a control, field of a slider, or "split". value: of a mouse position, what a slider would be set to.
    """

    box: tuple
    name: str
    value: Callable | None = None

    def holds(self, x, y):
        """Whether a position is within."""
        left, bottom, width, height = self.box
        return left <= x < left + width and bottom <= y < bottom + height


class Panel:
    """Everything that is written over the scene.

    hot: list of Hot, the topmost first. boxes: dict of text -> (left, bottom, width, height) in pixels, as drawn.
    """

    def __init__(self, renderer):
        self._renderer, self._texts, self._drawn = renderer, [], None
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
        self._widths = {}
        self.hot, self.boxes = [], {}

    def hide(self):
        """Draw nothing of it, until `draw` is called again."""
        self._shapes.VisibilityOff()
        for actor, _ in self._texts:
            actor.VisibilityOff()
        self._drawn = None

    def draw(self, session, size, frames_per_second=None, note="", bare=False):
        """Bring the panel up to date; returns whether anything of it changed.

        size: width, height of the window. frames_per_second: to be shown, or None. note: a line of the window's own.
        bare: nothing but the split line.
        """
        panel = session.state.panel and not bare
        self._rectangles, self._written, self.hot = [], [], []
        width, height = size
        self._scale = float(np.clip(min(width / DESIGN_SIZE[0], height / DESIGN_SIZE[1]), *SCALES))
        units = width / self._scale, height / self._scale
        if session.state.split:
            self._split(session, units, panel)
        if panel:
            self._top(session, units)
            self._bottom(session, units, frames_per_second, note)
            if session.state.help:
                self._help(units)
            elif MODES[session.state.mode].scale:
                self._scalar_bar(session, units)
        drawing = self._rectangles, self._written
        if drawing == self._drawn:
            return False
        self._drawn = drawing
        self._show()
        return True

    def _top(self, session, units):
        width, height = units
        base = height - TOP
        self._rectangle(0, base, width, TOP, _BAR)
        right = width - _MARGIN
        for control in reversed([control for control in CONTROLS if control.row == "modes"]):
            right -= self._chip(session, control, right, base + 12, from_right=True) + _GAP
        name = session.scene.path.name if session.scene.path else "scene"
        count = sum(len(chunk.vertices) for chunk in session.scene.chunks)
        self._text(_MARGIN, base + 27, name, _TEXT, bold=True)
        lit = session.lit
        facts = f"{count:,} vertices" + (f", {lit.settings}" if lit else "")
        self._text(_MARGIN, base + 10, self._fitted(facts, right - 2 * _MARGIN), _DIM, _SMALL)
        progress = session.progress
        if progress and not session.settled:
            share = progress[1] if progress[1] is not None else 1.0
            self._rectangle(0, base - 2, width * share, 2, _LINE if progress[1] is not None else _TRACK)

    def _bottom(self, session, units, frames_per_second, note):
        width, _ = units
        self._rectangle(0, 0, width, BOTTOM, _BAR)
        each = (width - 2 * _MARGIN - 2 * 2 * _GAP) / 3
        for index, slider in enumerate(SLIDERS):
            self._slider(session, slider, _MARGIN + index * (each + 2 * _GAP), 54, each)
        left = _MARGIN
        for control in CONTROLS:
            if control.row == "choices":
                left += self._chip(session, control, left, 12) + _GAP
        figures, follows = status(session, frames_per_second)
        warning = note or session.message or session.failure
        if warning:
            follows, color = warning, _WARNING
        else:
            color = _DIM
        room = width - 2 * _MARGIN
        self._plate(_MARGIN, BOTTOM + 8, figures, _TEXT)
        self._plate(_MARGIN, BOTTOM + 30, self._fitted(follows, room), color)

    def _plate(self, left, base, string, color):
        """A line of text on a plate of its own, over the scene."""
        if string:
            self._rectangle(left - 8, base, self._width(string, _SMALL) + 16, 20, _BAR)
            self._text(left, base + 5, string, color, _SMALL)

    def _slider(self, session, slider, left, base, width):
        low, high = RANGES[slider.field]
        value = getattr(session.state, slider.field)
        to, back = (np.log, np.exp) if slider.logarithmic else (float, float)
        share = (to(value) - to(low)) / (to(high) - to(low))
        self._text(left, base + 16, slider.text, _DIM, _SMALL)
        text = slider.show(value)
        self._text(left + width - self._width(text, _SMALL), base + 16, text, _TEXT, _SMALL)
        self._rectangle(left, base + 4, width, 3, _TRACK)
        if slider.field == "exposure_ev":
            middle = left + width / 2
            start, end = sorted((middle, left + width * share))
            self._rectangle(start, base + 4, end - start, 3, _ON)
        else:
            self._rectangle(left, base + 4, width * share, 3, _ON)
        self._rectangle(left + (width - 6) * share, base - 1, 6, 13, _HANDLE)
        scale = self._scale

        def value_at(x, y):
            place = min(max((x / scale - left - 3) / (width - 6), 0.0), 1.0)
            # A full turn is no turn: the right end stops just short of where the angle begins again.
            place = min(place, 1.0 - 1e-6) if slider.field == "angle_deg" else place
            return float(back(to(low) + place * (to(high) - to(low))))

        self._hot(left - 4, base - 6, width + 8, 36, slider.field, value_at)

    def _chip(self, session, control, place, base, from_right=False):
        """A button; returns its width."""
        text, lit = control.chip(session), control.lit(session)
        width = self._width(text, _SMALL) + 18
        left = place - width if from_right else place
        self._rectangle(left, base, width, 24, _ON if lit == 1 else _IDLE if lit else _CHIP)
        self._text(left + 9, base + 6, text, _DARK if lit == 1 else _TEXT, _SMALL)
        self._hot(left, base, width, 24, control.key)
        return width

    def _split(self, session, units, panel):
        width, height = units
        x = session.state.split_at * width
        low, high = (BOTTOM, height - TOP) if panel else (0, height)
        self._rectangle(x - 1, low, 2, high - low, _HANDLE)
        middle = (low + high) / 2
        self._rectangle(x - 4, middle - 18, 8, 36, _HANDLE)
        scale = self._scale
        if panel:
            for text, left in (("captured", x - 14 - self._width("captured", _SMALL)), ("relit", x + 14)):
                if left > 8 and left + self._width(text, _SMALL) < width - 8:
                    self._rectangle(left - 7, high - 34, self._width(text, _SMALL) + 14, 20, _BAR)
                    self._text(left, high - 29, text, _TEXT, _SMALL)
        self._hot(x - 8, low, 16, high - low, "split_at", lambda at, _: at / scale / width)

    def _scalar_bar(self, session, units):
        width, _ = units
        steps, tall = 48, 220
        left, base = width - _MARGIN - 16, BOTTOM + 76
        end = MODES[session.state.mode].scale(session)
        known = session.reference is not None
        title = "relative error" if known else "reference follows"
        title_width = max(self._width(title, _SMALL), 76)
        self._rectangle(left + 26 - title_width - 12, base - 12, title_width + 12, tall + 44, _BAR)
        self._text(left + 20 - self._width(title, _SMALL), base + tall + 12, title, _TEXT if known else _DIM, _SMALL)
        if not known:
            return
        for index, color in enumerate(map_colors((np.arange(steps) + 0.5) / steps)):
            self._rectangle(left + 6, base + index * tall / steps, 14, tall / steps + 0.5, (*map(int, color), 255))
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            text = f"{100 * end * share:.3g} %"
            self._text(left - self._width(text, _SMALL), base + share * tall - 4, text, _DIM, _SMALL)

    def _help(self, units):
        width, height = units
        rows = [(key_name(control), control.text) for control in CONTROLS] + list(MOUSE)
        half = -(-len(rows) // 2)
        tall = half * _HELP_ROW + 2 * _MARGIN
        left = (width - _HELP_WIDTH) / 2
        base = BOTTOM + 60 + max(0, (height - TOP - BOTTOM - 60 - tall) / 2)
        self._rectangle(left, base, _HELP_WIDTH, tall, (*_BAR[:3], 240))
        columns = (rows[:half], 16, 62), (rows[half:], 400, 470)
        for part, key_at, text_at in columns:
            for row, (key, text) in enumerate(part):
                y = base + tall - _MARGIN - (row + 1) * _HELP_ROW + 6
                self._text(left + key_at, y, key, _ON[:3], _SMALL, bold=True)
                self._text(left + text_at, y, text, _TEXT, _SMALL)

    def _hot(self, left, base, width, height, name, value=None):
        box = tuple(self._scale * number for number in (left, base, width, height))
        self.hot.insert(0, Hot(box, name, value))

    def _rectangle(self, left, base, width, height, color):
        self._rectangles.append((*(self._scale * n for n in (left, base, left + width, base + height)), color))

    def _text(self, left, base, string, color, size=_SIZE, bold=False):
        place = round(self._scale * left), round(self._scale * base)
        self._written.append((string, place, color, max(6, round(self._scale * size)), bold))

    def _width(self, string, size=_SIZE):
        """Width of a text in units."""
        return self._extent(string, max(6, round(self._scale * size)), False)[1] / self._scale

    def _fitted(self, string, room):
        """The text, cut short where it is wider than `room` units."""
        stem = string
        while stem and self._width(string, _SMALL) > room:
            stem = stem[:-3].rstrip()
            string = stem + "..." if stem else ""
        return string

    def _extent(self, string, size, bold):
        """Left, width, lower, height in pixels of a text about its origin; kept, since measuring draws it."""
        key = string, size, bold
        if key not in self._widths:
            if len(self._widths) > 2000:
                self._widths.clear()
            properties, box = _text_property((0, 0, 0), size, bold), [0, 0, 0, 0]
            self._measure.GetBoundingBox(properties, string, box, _DPI)
            self._widths[key] = box[0], box[1] - box[0] + 1, box[2], box[3] - box[2] + 1
        return self._widths[key]

    def _show(self):
        """Hand rectangles and texts to VTK. Texts keep their actors, which draw themselves anew when they change."""
        self._shapes.VisibilityOn()
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


def status(session, frames_per_second=None):
    """(figures, what follows): the two lines about the light that is shown."""
    if session.light is None:
        return "", "starting: the captured colours until the first light"
    figures, lit = [], session.lit
    if session.error is not None and session.state.mode in ("relit", "error"):
        planned = f", planned {100 * lit.predicted:.2g} %" if lit is not None and lit.predicted is not None else ""
        figures.append(f"error {100 * session.error:.2g} %{planned} (traced at {SAMPLE} vertices)")
    if session.light_seconds is not None:
        figures.append(f"light {1e3 * session.light_seconds:.1f} ms")
    if lit is not None and {SUN, BOUNCES} & session.effects:
        figures.append(f"with {_parts(session, lit)} {1e3 * lit.seconds:.0f} ms")
    if frames_per_second:
        figures.append(f"{frames_per_second:.0f} pictures/s")
    follows = ""
    if session.state.environment != session.light_name:
        follows = f"loading {session.state.environment}"
    elif session.state.mode == "error" and session.reference is None:
        follows = f"computing the reference: {CONVERGED}"
    elif session.state.mode == "error":
        follows = f"against {CONVERGED}, itself within {100 * session.reference.error:.2g} %"
    elif session.waiting_for:
        follows = f"{session.waiting_for} " + ("when the light rests" if session.state.turning else "on the way")
    if session.progress and not session.settled:
        label, share = session.progress
        follows += (" \N{MIDDLE DOT} " if follows else "") + STAGES.get(label, label)
        follows += f" {100 * share:.0f} %" if share is not None else ""
    return "   ".join(figures), follows


def _parts(session, lit):
    parts = [f"{lit.sun_count} suns" if lit.sun_count != 1 else "1 sun"] if lit.sun_count else []
    parts += [f"{len(lit.bounces)} bounce" + "s" * (len(lit.bounces) > 1)] if lit.bounces else []
    return ", ".join(parts) or "nothing to add"


def _text_property(color, size, bold):
    properties = vtkTextProperty()
    properties.SetFontFamilyToArial()
    properties.SetFontSize(size)
    properties.SetColor(*(channel / 255.0 for channel in color))
    properties.SetBold(bold)
    return properties
