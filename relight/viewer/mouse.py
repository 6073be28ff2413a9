"""The mouse of a session's window: buttons, sliders and the split line, the camera, the light, lamps, objects."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from .camera import ORBIT_DEG
from .controls import SLIDERS
from .hand_tool import HandTool
from .lamp_tool import LampTool
from .object_tool import ObjectTool
from .part_tool import PartTool
from .pointing import Drag

if TYPE_CHECKING:
    from .canvas import HotArea

STILL = 4
"""Most pixels that the mouse moves within a click."""


class Mouse:
    """The actions of the mouse in a `window.Window`. lamps: the LampTool. objects: the ObjectTool. hand: the HandTool.
    parts: the PartTool."""

    def __init__(self, window: Any) -> None:
        self._window = window
        self.lamps, self.objects = LampTool(window), ObjectTool(window)
        self.hand, self.parts = HandTool(window), PartTool(window)
        self._tools = self.objects, self.hand, self.lamps, self.parts
        self._drag: Drag | None = None
        self._clicks: tuple[int, int] | None = None  # where a click would add a lamp, a part, or point at a shadow

    def press(self, button: str) -> Callable[[], None]:
        """The action of a pressed button."""

        def pressed() -> None:
            x, y = self._window.pointer
            left = button == "Left"
            hot = next((hot for hot in self._window.panel.hot if hot.holds(x, y)), None) if left else None
            grips = (tool.grip(hot, x, y) for tool in self._tools if left)
            self._drag = next((grip for grip in grips if grip is not None), None)
            if self._drag is not None:
                return
            if hot is not None:
                self._drag = self._pressed(hot, x, y)
                return
            self._drag = self._moved(button, x, y)
            if left and not self._window.shift and any(tool.clicks for tool in self._tools):
                self._clicks = x, y

        return pressed

    def move(self) -> None:
        """Handle a move of the mouse."""
        x, y = self._window.pointer
        if self._clicks is not None and max(abs(x - self._clicks[0]), abs(y - self._clicks[1])) <= STILL:
            return
        self._clicks = None
        if self._drag is not None:
            self._drag(x, y, self._window.shift)

    def release(self) -> None:
        """Handle the release of a button; later changes are undone separately."""
        if self._clicks is not None:
            next(tool for tool in self._tools if tool.clicks).click(*self._clicks)
        self._window.session.timeline.end_merge()
        self._drag = self._clicks = None

    def _pressed(self, hot: "HotArea", x: float, y: float) -> Drag | None:
        """Press a button or a slider of the panel."""
        value, session = hot.value, self._window.session
        if value is None:
            self._window.press_key(hot.name)
            return None
        slider = next((slider for slider in SLIDERS if slider.field == hot.name), None)

        def drag(x: float, y: float, _: bool) -> None:
            if slider is not None and slider.write is not None:
                slider.write(self._window, value(x, y))
            else:
                session.change(**{hot.name: value(x, y)})

        if slider is not None:
            drag(x, y, False)
        return drag

    def _moved(self, button: str, x: float, y: float) -> Drag:
        """Look around, move sideways or turn the light, by parts of the height of the window."""
        window, before = self._window, [x, y]

        def drag(x: float, y: float, shift: bool) -> None:
            width, height = window.size
            right, up = (x - before[0]) / height, (y - before[1]) / height
            before[:] = x, y
            if button == "Middle":
                window.look(window.orbit.moved(right, up, width / height))
            elif button == "Left" and not shift:
                window.look(window.orbit.dragged(right, up))
            elif self.hand.on:
                self.hand.turn(right, up)
            else:
                window.session.change(angle_deg=window.session.state.angle_deg + ORBIT_DEG * right)

        return drag
