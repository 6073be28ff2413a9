"""Objects under the mouse: a drag moves one over the ground, with the shift key up and down; keys turn it."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .pointing import Tool, WindowView

if TYPE_CHECKING:
    from .canvas import HotArea


class ObjectGrip(NamedTuple):
    """An object being dragged. place: (3,) the gripped point, scene frame. at: (3,) of the object, frame of the
    splat. y: the pixel's row. unit: scene units per pixel there."""

    number: int
    place: NDArray[np.float64]
    at: tuple[float, float, float]
    y: float
    unit: float


class ObjectTool(Tool):
    """Objects under the mouse and the keys of a Window. selected: the number of the object that keys turn."""

    name = "objects"

    def __init__(self, window: WindowView) -> None:
        super().__init__(window)
        self.selected = 0
        self._grip: ObjectGrip | None = None

    @property
    def clicks(self) -> bool:
        """Clicks are for the camera."""
        return False

    def grip(self, hot: "HotArea | None", x: float, y: float) -> bool:
        """Start to drag the object at a pixel."""
        bench = self.bench
        if hot is not None or not self.on or bench is None or bench.shown is None:
            return False
        standing = bench.shown.result.standing
        eye, direction = self._window.orbit.ray(x, y, self._window.size)
        frame = standing.frame
        ray = np.concatenate([frame.unit(eye[None])[0], direction])[None].astype(np.float32)
        hits = standing.caster.first_hits(ray)
        if hits.faces[0] < 0:
            return False
        place = eye + float(hits.distance[0]) * frame.diagonal * direction
        self.selected = int(standing.owner[hits.faces[0]])
        depth = float((eye - place) @ self._window.orbit.axes[2])
        self._grip = ObjectGrip(
            self.selected, place, bench.placed[self.selected].at, y, depth / self._window.orbit.focal(self._window.size)
        )
        self.holds = True
        return True

    def drag(self, x: float, y: float, shift: bool) -> None:
        """Move the dragged object to a pixel: at the height of the gripped point, or with shift up and down."""
        grip, bench = self._grip, self.bench
        if grip is None or bench is None:
            return
        if shift:
            way = np.array([0.0, (y - grip.y) * grip.unit, 0.0])
        else:
            eye, direction = self._window.orbit.ray(x, y, self._window.size)
            away = (grip.place[1] - eye[1]) / (direction[1] or np.inf)
            way = eye + away * direction - grip.place
            if not (away > 0.0 and np.linalg.norm(way) < self._window.session.scene.diagonal):
                return
        dx, dy, dz = np.subtract(self.in_splat(grip.place + way), self.in_splat(grip.place)).tolist()
        x0, y0, z0 = grip.at
        self._put(grip.number, (x0 + dx, y0 + dy, z0 + dz), lifted=shift)

    def let_go(self) -> None:
        """As of Tool; show the options of what was dragged."""
        if self._grip is not None:
            self._tell(self._grip.number)
        self._grip = None
        super().let_go()

    def turn(self, angle_deg: float) -> None:
        """Turn the selected object about the vertical, counter-clockwise from above."""
        bench = self.bench
        if bench is not None:
            asked = bench.placed[self.selected]
            self._put(self.selected, asked.at, (asked.turn_deg + angle_deg) % 360.0)
            self._tell(self.selected)

    def _put(
        self, number: int, at: tuple[float, float, float], turn_deg: float | None = None, lifted: bool = False
    ) -> None:
        merge = ("drag", number) if self.holds else None
        self.tried(lambda: self.bench.put(number, at, turn_deg, lifted, merge))

    def _tell(self, number: int) -> None:
        """Show the options that place the object at its present pose."""
        asked = self.bench.placed[number]
        at = ",".join(f"{each:.4g}" for each in asked.at)
        on = f" --on {asked.on}" if asked.on else ""
        turn = f" --turn {asked.turn_deg:g}" if asked.turn_deg else ""
        self._window.note = f"--insert {asked.name} --at {at}{turn}{on}"
