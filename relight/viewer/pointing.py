"""What the tools under the mouse share: when they act, the surface at a pixel, and a change that may be refused."""

import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.render.raycaster import RayCaster

if TYPE_CHECKING:
    from .camera import Orbit
    from .canvas import HotArea
    from .session import Session


Drag = Callable[[float, float, bool], None]
"""What a mouse does that moves with a button down: x, y in pixels from the lower left, and whether shift is down."""


class WindowView:
    """A window on a scene, as tools know it. session: the Session. plotter: the pyvista.Plotter. orbit: the camera.
    note: a line of the window's own."""

    session: "Session"
    plotter: Any
    orbit: "Orbit"
    note: str

    @property
    def size(self) -> tuple[int, int]:
        """Present width and height in pixels."""
        width, height = self.plotter.render_window.GetSize()
        return width, height

    @property
    def pointer(self) -> tuple[int, int]:
        """The pixel of the mouse, from the lower left."""
        x, y = self.plotter.iren.interactor.GetEventPosition()
        return x, y

    @property
    def shift(self) -> bool:
        """Whether the shift key is down."""
        return bool(self.plotter.iren.interactor.GetShiftKey())

    @cached_property
    def caster(self) -> RayCaster:
        """The surface of the scene."""
        return RayCaster(self.session.scene.vertices, self.session.scene.faces)

    def look(self, orbit: "Orbit") -> None:
        """Look from an Orbit."""
        self.orbit = orbit


class Tool:
    """What mouse and keys change in a Window while `State.tool` is `name`. Pixels count from the lower left.

    clickable: whether clicks on the scene are for it while it is on.
    """

    name = ""
    clickable = True

    def __init__(self, window: WindowView) -> None:
        self._window = window

    @property
    def bench(self) -> Any:
        """What it changes: the session's of that name. None without one."""
        return getattr(self._window.session, self.name)

    @property
    def on(self) -> bool:
        """Whether the mouse acts on it."""
        return self._window.session.uses(self.name)

    @property
    def clicks(self) -> bool:
        """Whether clicks on the scene are for it."""
        return self.on and self.clickable

    def toggle(self) -> None:
        """Start or stop to use it."""
        if self.bench is not None:
            self._window.session.change(tool="" if self.on else self.name)

    def grip(self, hot: "HotArea | None", x: float, y: float) -> Drag | None:
        """Take a press at a pixel, on a hot area or none: the Drag that follows, or None where it is not for this."""
        return None

    def click(self, x: float, y: float) -> None:
        """Take a click on the scene."""

    def surface_at(self, x: float, y: float) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The surface point at a pixel and its unit normal towards the eye, scene frame; None without one."""
        eye, direction = self._window.orbit.ray(x, y, self._window.size)
        hits = self._window.caster.first_hits(np.concatenate([eye, direction])[None].astype(np.float32))
        distance = float(hits.distance[0])
        if not math.isfinite(distance):
            return None
        normal = hits.normals[0].astype(np.float64)
        return eye + distance * direction, normal if normal @ direction < 0.0 else -normal

    def in_scene(self, place: ArrayLike) -> NDArray[np.float64]:
        """A position (3,) of the frame of the splat in that of the scene."""
        motion = self._motion
        return np.asarray(motion[:3, :3] @ np.asarray(place, np.float64) + motion[:3, 3])

    def in_splat(self, place: NDArray[np.float64]) -> Triple:
        """The same the other way round."""
        motion = self._motion
        x, y, z = (float(each) for each in np.linalg.solve(motion[:3, :3], place - motion[:3, 3]))
        return x, y, z

    def tried(self, change: Callable[[], object]) -> None:
        """Make a change; show a message if it is refused."""
        try:
            change()
        except (OSError, InputError) as error:
            self._window.note = str(error)

    @property
    def _motion(self) -> NDArray[np.float64]:
        return np.asarray(self._window.session.scene.scene_from_splat, np.float64)
