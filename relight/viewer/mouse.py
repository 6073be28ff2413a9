"""The mouse of a session's window: buttons, sliders and the split line, the camera, the light, lamps, objects."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from .camera import ORBIT_DEG
from .controls import SLIDERS
from .hand_tool import HandTool
from .lamp_tool import LampTool
from .object_tool import ObjectTool
from .part_tool import PartTool
from .pointing import Tool, WindowView

if TYPE_CHECKING:
    from .canvas import HotArea

STILL = 4
"""Most pixels that the mouse moves within a click."""


class Mouse:
    """The actions of the mouse in a Window. lamps: the LampTool. objects: the ObjectTool. hand: the HandTool. parts:
    the PartTool."""

    def __init__(self, window: WindowView) -> None:
        self._window = window
        self.lamps: LampTool = LampTool(window)
        self.objects: ObjectTool = ObjectTool(window)
        self.hand: HandTool = HandTool(window)
        self.parts: PartTool = PartTool(window)
        self._tools = self.objects, self.hand, self.lamps, self.parts
        self._holder: Tool | None = None
        self._drag: tuple[str, HotArea | None, tuple[int, int]] | None = None
        self._clicks: tuple[int, int] | None = None  # where a click would add a lamp, a part, or point at a shadow

    def press(self, button: str) -> Callable[[], None]:
        """The action of a pressed button."""

        def pressed() -> None:
            window = self._window
            x, y = window.pointer
            hot = next((hot for hot in window.panel.hot if hot.holds(x, y)), None) if button == "Left" else None
            self._drag = button, hot, (x, y)
            self._clicks = self._holder = None
            if button == "Left":
                self._holder = next((tool for tool in self._tools if tool.grip(hot, x, y)), None)
            if self._holder is not None:
                return
            if hot is None:
                takes = button == "Left" and not window.shift and any(tool.clicks for tool in self._tools)
                self._clicks = (x, y) if takes else None
            elif hot.value is None:
                window.press_key(hot.name)
            elif hot.name in [slider.field for slider in SLIDERS]:
                self._set(hot, x, y)

        return pressed

    def move(self) -> None:
        """Handle a move of the mouse."""
        if self._drag is None:
            return
        window = self._window
        button, hot, (before_x, before_y) = self._drag
        x, y = window.pointer
        if self._holder is not None:
            if self._holder.holds:
                self._holder.drag(x, y, window.shift)
            return
        if self._clicks is not None:
            if max(abs(x - self._clicks[0]), abs(y - self._clicks[1])) <= STILL:
                return
            self._clicks = None
        self._drag = button, hot, (x, y)
        width, height = window.size
        right, up = (x - before_x) / height, (y - before_y) / height
        if hot is not None:
            if hot.value is not None:
                self._set(hot, x, y)
        elif button == "Right" or (button == "Left" and window.shift):
            self._turn(right, up)
        elif button == "Middle":
            window.look(window.orbit.moved(right, up, width / height))
        else:
            window.look(window.orbit.dragged(right, up))

    def _turn(self, right: float, up: float) -> None:
        """Turn the light, or move the captured sun while it is set, by a drag in heights of the window."""
        session = self._window.session
        if self.hand.on:
            self.hand.turn(right, up)
        else:
            session.change(angle_deg=session.state.angle_deg + ORBIT_DEG * right)

    def release(self) -> None:
        """Handle the release of a button."""
        if self._clicks is not None:
            next(tool for tool in self._tools if tool.clicks).click(*self._clicks)
        for tool in self._tools:
            tool.let_go()
        self._drag = self._clicks = self._holder = None

    def _set(self, hot: "HotArea", x: float, y: float) -> None:
        assert hot.value is not None
        value, session = hot.value(x, y), self._window.session
        slider = next((slider for slider in SLIDERS if slider.field == hot.name), None)
        if slider is not None and slider.write is not None:
            slider.write(self._window, value)
        else:
            session.change(**{hot.name: value})
