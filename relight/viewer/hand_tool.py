"""The captured light under the mouse: maps of the offered lights and of the present one, on which its sun is dragged,
and the two clicks that find it."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..light.sun_position import toward
from .camera import ORBIT_DEG
from .canvas import BAR, CHIP, DARK, DIM, MARGIN, ON, TEXT, Canvas, HotArea
from .hand_bench import HandBench
from .pointing import Drag, Tool, WindowView

SUN_MAP, OFFER = "hand sun", "hand light"
"""Names of the hot areas: the map of the present light, and those of the offered lights, whose number follows."""

LOWEST_DEG = 1.0

EDGE = "click the edge of a shadow"
CASTER = "click what casts that edge: the corner or rim towards the sun"


CELL = 3
LARGE = 2 * CELL
"""Sides of a texel of a map, in units: of an offered light, and of the present one, whose sun is dragged."""

GAP = 10
LEFT = LINE = MARGIN
"""Units: between maps, from the left edge, and the height of a name."""

Hot = Callable[..., None]
"""((left, base, width, height), name): an area that takes the mouse."""


class HandTool(Tool):
    """The captured light under the mouse and the keys of a Window. clickable: whether clicks point at a shadow."""

    name = "hand"

    def __init__(self, window: WindowView) -> None:
        super().__init__(window)
        self._edge: NDArray[np.float64] | None = None
        self._point_at(False)

    def _point_at(self, wanted: bool) -> None:
        self.clickable, self._edge, self._window.note = wanted, None, EDGE if wanted else ""

    def toggle(self) -> None:
        """As of Tool. It begins with the capture left of the line."""
        self._point_at(False)
        super().toggle()
        if self.bench is not None:
            self.bench.prepare()
            self._window.session.change(split=self.on)

    def next_light(self) -> None:
        """Begin with the next offered light."""
        if self.on:
            self.bench.choose(self.bench.number + 1)

    def ask(self) -> None:
        """Ask for the edge of a shadow and what casts it, or no more."""
        if self.on:
            self._point_at(not self.clickable)

    def click(self, x: float, y: float) -> None:
        """Take a click at a pixel: the edge of a shadow, then what casts it."""
        hit, edge = self.surface_at(x, y), self._edge
        if hit is None:
            self._window.note = "no surface there: " + (EDGE if edge is None else CASTER)
        elif edge is None:
            self._edge, self._window.note = hit[0], CASTER
        else:
            self._point_at(False)
            self.tried(lambda: self.bench.point(edge, hit[0]))

    def grip(self, hot: HotArea | None, x: float, y: float) -> Drag | None:
        """Take a press on one of its maps."""
        if hot is None or not hot.name.startswith((SUN_MAP, OFFER)):
            return None
        if hot.name != SUN_MAP:
            self.bench.choose(int(hot.name.removeprefix(OFFER)))
            return lambda *_: None
        left, base, width, height = hot.box

        def drag(x: float, y: float, _: bool) -> None:
            longitude = math.pi * (1.0 - 2.0 * (x - left) / width)
            azimuth_deg = math.degrees(math.atan2(math.sin(longitude), -math.cos(longitude)))
            height_deg = max(180.0 * (y - base) / height - 90.0, LOWEST_DEG)
            self.bench.change(azimuth_deg=azimuth_deg, height_deg=height_deg)

        drag(x, y, False)
        return drag

    def turn(self, right: float, up: float) -> None:
        """Move the sun by a drag in the picture, in heights of the window."""
        hand = self.bench.hand
        azimuth_deg, height_deg = hand.azimuth_deg - ORBIT_DEG * right, hand.height_deg + ORBIT_DEG / 2.0 * up
        self.bench.change(azimuth_deg=azimuth_deg, height_deg=height_deg)

    def keep(self) -> None:
        """Write the light into the folder of the scene; show where, or why not."""

        def keep() -> None:
            path = self.bench.keep()
            if path is not None:
                self._window.note = f"kept in {path}: commands use it from now on"

        if self.on:
            self.tried(keep)


def place_on_map(azimuth_deg: float, height_deg: float) -> tuple[float, float]:
    """Where a sun stands on a lat-long map: parts of its width from the left, and of its height from below."""
    x, _, z = toward(azimuth_deg, height_deg)
    return (0.5 - math.atan2(x, z) / (2.0 * math.pi)) % 1.0, 0.5 + height_deg / 180.0


def draw_hand(canvas: Canvas, bench: HandBench, top: float, hot: Hot) -> None:
    """Draw the maps below a height: the present light first, then the offered ones."""
    if not bench.ready:
        return
    present = bench.map_of(None)
    width, height = LARGE * present.shape[1], LARGE * present.shape[0]
    base = top - GAP - LINE - height
    names = [_name(bench, number) for number in range(len(bench.offered))]
    wide = max(width, *(CELL * present.shape[1] + GAP + canvas.width(name) for name in names))
    small = CELL * present.shape[0] + GAP
    low = base - GAP - len(names) * small
    canvas.rectangle(LEFT - 8, low, wide + 16, top - low, BAR)
    canvas.text(LEFT, base + height + 5, "captured light: drag its sun", TEXT)
    canvas.picture(LEFT, base, LARGE, present)
    right, up = place_on_map(bench.hand.azimuth_deg, bench.hand.height_deg)
    if bench.hand.sun_share > 0.0:
        x, y = LEFT + right * width, base + up * height
        canvas.rectangle(x - 5, y - 5, 10, 10, (*DARK, 255))
        canvas.rectangle(x - 3, y - 3, 6, 6, ON)
    hot((LEFT, base, width, height), SUN_MAP)
    for number, name in enumerate(names):
        base -= small
        shown, used = bench.map_of(number), number == bench.number
        across, tall = CELL * shown.shape[1], CELL * shown.shape[0]
        canvas.rectangle(LEFT - 2, base - 2, across + 4, tall + 4, ON if used else CHIP)
        canvas.picture(LEFT, base, CELL, shown)
        canvas.text(LEFT + across + GAP, base + tall / 2 - 4, name, TEXT if used else DIM)
        hot((LEFT - 2, base - 2, wide, tall + 4), f"{OFFER}{number}")


def _name(bench: HandBench, number: int) -> str:
    entry = bench.offered[number].entry
    if entry.by_hand:
        return f"{number + 1}  {entry.name}"
    share = 100.0 * entry.share
    return f"{number + 1}  {entry.name}, " + (f"{share:.0f} %" if share >= 0.5 else "below 1 %")
