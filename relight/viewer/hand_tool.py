"""The captured light under the mouse: the map on which its sun is dragged, and the two clicks that find it."""

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..light.sun_position import toward
from .camera import ORBIT_DEG
from .hand_bench import HandBench
from .pointing import surface_at, tried

if TYPE_CHECKING:
    from .window_view import WindowView

SUN_MAP, OFFER = "hand sun", "hand light"
"""Names of the hot areas: the map of the present light, and those of the offered lights, whose number follows."""

LOWEST_DEG = 1.0

EDGE = "click the edge of a shadow"
CASTER = "click what casts that edge: the corner or rim towards the sun"


class HandTool:
    """The captured light under the mouse and the keys of a Window."""

    def __init__(self, window: "WindowView") -> None:
        self._window = window
        self.pointing = False
        self._edge: NDArray[np.float64] | None = None
        self._aims: tuple[float, ...] | None = None

    @property
    def on(self) -> bool:
        """Whether the captured light is being set."""
        return self._window.session.state.by_hand and self._window.session.hand is not None

    @property
    def clicks(self) -> bool:
        """Whether clicks on the scene point at shadows."""
        return self.on and self.pointing

    def toggle(self) -> None:
        """Start or stop to set the captured light. It begins with the capture left of the line."""
        session = self._window.session
        if session.hand is None:
            return
        self.pointing, self._edge = False, None
        shown = not session.state.by_hand
        session.hand.prepare()
        session.change(by_hand=shown, split=shown, placing=False, arranging=False)

    def next_light(self) -> None:
        """Begin with the next offered light."""
        if self.on and self._bench.ready:
            self._window.session.set_hand(lambda bench: bench.choose(bench.number + 1))

    def ask(self) -> None:
        """Ask for the edge of a shadow and what casts it, or no more."""
        if self.on:
            self.pointing, self._edge = not self.pointing, None
            self._window.note = EDGE if self.pointing else ""

    def click(self, x: float, y: float) -> None:
        """Take a click at a pixel: the edge of a shadow, then what casts it."""
        hit = surface_at(self._window, self._bench.source, x, y)
        if hit is None:
            self._window.note = "no surface there: " + (EDGE if self._edge is None else CASTER)
            return
        if self._edge is None:
            self._edge, self._window.note = hit[0], CASTER
            return
        edge, self._edge, self.pointing, self._window.note = self._edge, None, False, ""
        tried(self._window, lambda: self._window.session.set_hand(lambda bench: bench.point(edge, hit[0])))

    def grip(self, name: str, box: tuple[float, ...], x: float, y: float) -> bool:
        """Take a press on a hot area, if it is a map; return whether it is."""
        if name == SUN_MAP:
            self._aims = box
            self.aim(x, y)
            return True
        if name.startswith(OFFER):
            number = int(name.removeprefix(OFFER))
            self._window.session.set_hand(lambda bench: bench.choose(number))
            return True
        return False

    @property
    def holds(self) -> bool:
        """Whether the sun is dragged on its map."""
        return self._aims is not None

    def aim(self, x: float, y: float) -> None:
        """Put the sun where a pixel of the map is."""
        if self._aims is None:
            return
        left, base, width, height = self._aims
        longitude = math.pi * (1.0 - 2.0 * (x - left) / width)
        height_deg = 180.0 * (y - base) / height - 90.0
        level = (math.sin(longitude), 0.0, math.cos(longitude))
        azimuth = math.degrees(math.atan2(level[0], -level[2]))
        changes = {"azimuth_deg": azimuth, "height_deg": max(height_deg, LOWEST_DEG)}
        self._window.session.set_hand(lambda bench: bench.change(**changes))

    def let_go(self) -> None:
        """End a drag."""
        self._aims = None

    def turn(self, right: float, up: float) -> None:
        """Move the sun by a drag in the picture, in heights of the window."""
        hand = self._bench.hand
        changes = {
            "azimuth_deg": hand.azimuth_deg - ORBIT_DEG * right,
            "height_deg": hand.height_deg + ORBIT_DEG / 2.0 * up,
        }
        self._window.session.set_hand(lambda bench: bench.change(**changes))

    def keep(self) -> None:
        """Write the light into the folder of the scene; show where, or why not."""
        if not self.on:
            return

        def keep() -> None:
            path = self._bench.keep()
            if path is not None:
                self._window.note = f"kept in {path}: commands use it from now on"

        tried(self._window, keep)

    @property
    def _bench(self) -> HandBench:
        bench = self._window.session.hand
        assert bench is not None
        return bench


def place_on_map(azimuth_deg: float, height_deg: float) -> tuple[float, float]:
    """Where a sun stands on a lat-long map: parts of its width from the left, and of its height from below."""
    x, _, z = toward(azimuth_deg, height_deg)
    return (0.5 - math.atan2(x, z) / (2.0 * math.pi)) % 1.0, 0.5 + height_deg / 180.0
