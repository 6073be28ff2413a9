"""The text on the window: buttons, sliders, figures and help, redrawn when one of them changes."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..output.kinds import PICTURE_SIZE
from ..planning.planner import SAMPLE_VERTICES
from ..transfer.settings import BOUNCES, SUN
from .canvas import BAR, CHIP, DARK, DIM, HANDLE, IDLE, MARGIN, ON, TEXT, WARNING, Canvas, HotArea
from .controls import CONTROLS, MOUSE, SLIDERS, Control, Slider, key_name
from .hand_tool import draw_hand
from .lighting import STAGES, FinishedShading
from .splats import WAITING
from .state import RANGES

if TYPE_CHECKING:
    from .lamp_tool import Mark
    from .session import Session

Units = tuple[float, float]
"""Least width and height of the window in units."""

DESIGN_SIZE = PICTURE_SIZE
"""Of the window in which a unit is a pixel; others are scaled by what fits."""

LEAST_SCALE = 0.5  # below which texts cannot be read
TOP = 48
BOTTOM = 2 * TOP
"""Heights of the two bars."""

CURVE = 2 * BOTTOM, BOTTOM
"""Width and height of the curve of a plan."""

_GAP = MARGIN // 2
_HELP_WIDTH = DESIGN_SIZE[0] - 2 * BOTTOM
_CHIP_ROOM = CURVE[0]  # for the text of a button: a long name must not push others out of the window
_MARK = MARGIN // 3  # half the width of the mark of a lamp


def scale_of(size: tuple[int, int]) -> float:
    """Pixels in a unit, in a window of this width and height."""
    return max(min(size[0] / DESIGN_SIZE[0], size[1] / DESIGN_SIZE[1]), LEAST_SCALE)


def bars_of(size: tuple[int, int]) -> tuple[float, float]:
    """Shares of the height of a window that the bars above and below take."""
    scale = scale_of(size)
    return scale * TOP / size[1], scale * BOTTOM / size[1]


class Panel(Canvas):
    """All text over the scene. hot: list of HotArea, the topmost first."""

    def __init__(self) -> None:
        super().__init__()
        self.hot: list[HotArea] = []

    def draw(
        self,
        session: "Session",
        size: tuple[int, int],
        note: str = "",
        marks: "Sequence[Mark]" = (),
        bare: bool = False,
    ) -> bool:
        """Update the panel; return whether it changed. size: width, height of the window. note: a line of its own.
        marks: of lamps. bare: nothing but the split line."""
        panel = session.state.panel and not bare
        self.hot, before = [], self.contents
        width, height = size
        scale = scale_of(size)
        self.clear(scale)
        units = width / scale, height / scale
        if session.state.split:
            self._split(session, units, panel)
        if panel:
            for mark in marks:
                self._mark(mark)
            self._top(session, units)
            self._bottom(session, units, note)
            if session.state.help:
                self._help(session, units)
            elif session.uses("hand") and session.hand is not None:
                draw_hand(self, session.hand, units[1] - TOP, self._hot)
        return before != self.contents

    def _top(self, session: "Session", units: Units) -> None:
        width, height = units
        base = height - TOP
        self.rectangle(0, base, width, TOP, BAR)
        right = width - MARGIN
        for control in reversed([control for control in CONTROLS if control.row == "modes"]):
            right -= self._chip(session, control, right, base + 12, from_right=True) + _GAP
        count = sum(len(chunk.vertices) for chunk in session.scene.chunks)
        self.text(MARGIN, base + 27, session.name, TEXT)
        lit = session.answers.lit
        facts = f"{count:,} vertices" + (f", {lit.settings}" if lit else "")
        self.text(MARGIN, base + 10, self.fitted(facts, right - 2 * MARGIN), DIM)
        progress = session.answers.progress
        if progress and not session.settled:
            share = progress[1] if progress[1] is not None else 1.0
            self.rectangle(0, base - 2, width * share, 2, ON if progress[1] is not None else CHIP)

    def _bottom(self, session: "Session", units: Units, note: str) -> None:
        width, _ = units
        self.rectangle(0, 0, width, BOTTOM, BAR)
        hand = session.uses("hand")
        self._curve(session, width - MARGIN - CURVE[0], BOTTOM + 60)
        sliders = [slider for slider in SLIDERS if slider.there(session) and slider.of_hand == hand]
        each = (width - 2 * MARGIN - 2 * (len(sliders) - 1) * _GAP) / len(sliders)
        for index, slider in enumerate(sliders):
            self._slider(session, slider, MARGIN + index * (each + 2 * _GAP), 54, each)
        left: float = MARGIN
        for control in CONTROLS:
            if control.row in ("hand" if hand else "choices", "both") and control.there(session):
                left += self._chip(session, control, left, 12) + _GAP
        figures, follows = status(session)
        notice = session.answers.message or session.failure or session.notice
        if hand and session.hand is not None:
            figures, follows, notice = session.hand.figures, session.hand.follows, session.hand.message
        warning = note or notice or (session.splats.message if session.splats else "")
        if warning:
            follows, color = warning, WARNING
        else:
            color = DIM
        room = width - 2 * MARGIN
        self._plate(MARGIN, BOTTOM + 8, figures, TEXT)
        self._plate(MARGIN, BOTTOM + 30, self.fitted(follows, room), color)

    def _plate(self, left: float, base: float, string: str, color: tuple[int, ...]) -> None:
        """A line of text on a separate plate, over the scene."""
        if string:
            self.rectangle(left - 8, base, self.width(string) + 16, 20, BAR)
            self.text(left, base + 5, string, color)

    def _slider(self, session: "Session", slider: Slider, left: float, base: float, width: float) -> None:
        low, high = RANGES[slider.field]
        value = getattr(session.state, slider.field) if slider.read is None else slider.read(session)
        value = min(max(value, low), high)
        to, back = (np.log, np.exp) if slider.logarithmic else (float, float)
        share = (to(value) - to(low)) / (to(high) - to(low))
        self.text(left, base + 16, slider.text, DIM)
        text = slider.show(value)
        self.text(left + width - self.width(text), base + 16, text, TEXT)
        self.rectangle(left, base + 4, width, 3, CHIP)
        if slider.field == "exposure_ev":
            middle = left + width / 2
            start, end = sorted((middle, left + width * share))
            self.rectangle(start, base + 4, end - start, 3, ON)
        else:
            self.rectangle(left, base + 4, width * share, 3, ON)
        self.rectangle(left + (width - 6) * share, base - 1, 6, 13, HANDLE)

        def value_at(x: float) -> float:
            place = min(max((x - left - 3) / (width - 6), 0.0), 1.0)
            # A full turn equals no turn, so the right end stops just short of it.
            place = min(place, 1.0 - 1e-6) if slider.field == "angle_deg" else place
            return float(back(to(low) + place * (to(high) - to(low))))

        self._hot((left - 4, base - 6, width + 8, 36), slider.field, value_at)

    def _curve(self, session: "Session", left: float, base: float) -> None:
        """What tolerances cost on this scene under this light: seconds upwards, both logarithmic; a click takes one."""
        state, (key, shading), (low, high) = session.state, session.answers.newest("shading"), RANGES["tolerance"]
        if shading is None or state.mode != "relit" or session.uses("hand") or state.help:
            return
        lit: FinishedShading = shading
        points = [point for point in lit.curve if low <= point[1] <= high]
        if len(points) < 2:
            return
        width, height = CURVE
        self.rectangle(left, base, width, height, BAR)
        self.text(left + 8, base + height - 18, f"planned {lit.planned:.2g} s", DIM)
        spread = np.log(points[-1][0] / points[0][0])
        for seconds, tolerance, size, color in (
            *((*point, 3, HANDLE) for point in points),
            (lit.planned, key[1], 7, ON),
        ):
            x = left + 8 + (width - 16) * np.log(tolerance / low) / np.log(high / low)
            y = base + 8 + (height - 36) * np.clip(np.log(seconds / points[0][0]) / spread, 0.0, 1.0)
            self.rectangle(x - size / 2, y - size / 2, size, size, color)

        def tolerance_at(x: float) -> float:
            return float(low * (high / low) ** np.clip((x - left - 8) / (width - 16), 0.0, 1.0))

        self._hot((left, base, width, height), "tolerance", tolerance_at)

    def _chip(self, session: "Session", control: Control, place: float, base: float, from_right: bool = False) -> float:
        """A button; returns its width."""
        text, lit = control.chip(session) if control.chip else "", control.lit(session)
        text = self.fitted(text, _CHIP_ROOM)
        width = self.width(text) + 18
        left = place - width if from_right else place
        self.rectangle(left, base, width, 24, ON if lit == 1 else IDLE if lit else CHIP)
        self.text(left + 9, base + 6, text, DARK if lit == 1 else TEXT)
        self._hot((left, base, width, 24), control.key)
        return width

    def _split(self, session: "Session", units: Units, panel: bool) -> None:
        width, height = units
        x = session.state.split_at * width
        low, high = (BOTTOM, height - TOP) if panel else (0, height)
        self.rectangle(x - 1, low, 2, high - low, HANDLE)
        middle = (low + high) / 2
        self.rectangle(x - 4, middle - 18, 8, 36, HANDLE)
        if panel:
            after = "albedo" if session.uses("hand") else "relit"
            for text, left in (("captured", x - 14 - self.width("captured")), (after, x + 14)):
                if left > 8 and left + self.width(text) < width - 8:
                    self.rectangle(left - 7, high - 34, self.width(text) + 14, 20, BAR)
                    self.text(left, high - 29, text, TEXT)
        self._hot((x - 8, low, 16, high - low), "split_at", lambda at: at / width)

    def _mark(self, mark: "Mark") -> None:
        """A lamp: a square of its colour in a dark frame, a bright one where it is selected."""
        x, y = mark.x / self.scale, mark.y / self.scale
        for half, color in (
            (_MARK + 3, HANDLE if mark.selected else BAR),
            (_MARK + 1, BAR),
            (_MARK, (*mark.color, 255)),
        ):
            self.rectangle(x - half, y - half, 2 * half, 2 * half, color)
        half = _MARK + 6
        self._hot((x - half, y - half, 2 * half, 2 * half), "lamp", lamp=mark.number)

    def _help(self, session: "Session", units: Units) -> None:
        width, height = units
        rows = [(key_name(control), control.text) for control in CONTROLS if control.there(session)] + list(MOUSE)
        half = -(-len(rows) // 2)
        left, base = (width - _HELP_WIDTH) / 2, BOTTOM + 60
        tall = height - TOP - base
        step = (tall - 2 * MARGIN) / half
        self.rectangle(left, base, _HELP_WIDTH, tall, (*BAR[:3], 240))
        columns = (rows[:half], 16, 62), (rows[half:], 400, 470)
        for part, key_at, text_at in columns:
            for row, (key, text) in enumerate(part):
                y = base + tall - MARGIN - (row + 1) * step + 6
                self.text(left + key_at, y, key, ON[:3])
                self.text(left + text_at, y, text, TEXT)

    def _hot(
        self,
        box: tuple[float, ...],  # units
        name: str,
        value: Callable[[float], float] | None = None,  # at a place across the window, in units
        lamp: int | None = None,
    ) -> None:
        scale = self.scale

        def at(x: float, _: float) -> float:
            assert value is not None
            return value(x / scale)

        area = HotArea(tuple(scale * each for each in box), name, None if value is None else at, lamp)
        self.hot.insert(0, area)


def status(session: "Session") -> tuple[str, str]:
    """(figures, what follows): the two lines about the light that is shown."""
    if session.answers.light is None:
        return "", "starting: the captured colours until the first light"
    follows, progress = _follows(session), session.answers.progress
    if progress and not session.settled:
        label, share = progress
        follows += (" \N{MIDDLE DOT} " if follows else "") + STAGES.get(label, label)
        follows += f" {100 * share:.0f} %" if share is not None else ""
    figures, lit, error = [], session.answers.lit, session.answers.error
    if error is not None and session.state.mode == "relit":
        planned = f", planned {100 * lit.predicted:.2g} %" if lit is not None and lit.predicted is not None else ""
        figures.append(f"error {100 * error:.2g} %{planned} (traced at {SAMPLE_VERTICES} vertices)")
    if session.light_seconds is not None:
        figures.append(f"light {1e3 * session.light_seconds:.1f} ms")
    if lit is not None and {SUN, BOUNCES} & session.effects:
        counts = (lit.sun_count, "sun"), (len(lit.bounces), "bounce")
        parts = [f"{count} {word}" + "s" * (count > 1) for count, word in counts if count]
        figures.append(f"with {', '.join(parts) or 'nothing to add'} {1e3 * lit.seconds:.0f} ms")
    return "   ".join(figures), follows


def _follows(session: "Session") -> str:
    """What the picture lacks, in words."""
    state = session.state
    if session.splats is not None and session.shows_splats and session.splats.waiting:
        return WAITING
    if state.environment != session.answers.light_name:
        return f"loading {state.environment}"
    if session.waiting_for:
        return f"{session.waiting_for} " + ("when the light rests" if state.turning else "on the way")
    return ""
