"""Objects under the mouse: a drag moves one over the ground, with the shift key up and down; keys turn it."""

from typing import TYPE_CHECKING, Any

import numpy as np

from splat2mesh.base.arrays import Triple

from .pointing import Drag, Tool, WindowView

if TYPE_CHECKING:
    from .canvas import HotArea


class ObjectTool(Tool):
    """Objects under the mouse and the keys of a Window. selected: the number of the object that keys turn."""

    name = "objects"
    clickable = False  # clicks are for the camera

    def __init__(self, window: WindowView) -> None:
        super().__init__(window)
        self.selected = 0

    def grip(self, hot: "HotArea | None", x: float, y: float) -> Drag | None:
        """Start to drag the object at a pixel: at the height of the gripped point, or with shift up and down."""
        window, bench = self._window, self.bench
        if hot is not None or not self.on or bench is None or bench.shown is None:
            return None
        standing = bench.shown.result.standing
        eye, direction = window.orbit.ray(x, y, window.size)
        ray = np.concatenate([standing.frame.unit(eye[None])[0], direction])[None].astype(np.float32)
        hits = standing.caster.first_hits(ray)
        if hits.faces[0] < 0:
            return None
        place = eye + float(hits.distance[0]) * standing.frame.diagonal * direction
        number = self.selected = int(standing.owner[hits.faces[0]])
        begun, start = bench.placed[number].at, y
        unit = float((eye - place) @ window.orbit.axes[2]) / window.orbit.focal(window.size)  # of a pixel there

        def drag(to_x: float, to_y: float, shift: bool) -> None:
            if shift:
                way = np.array([0.0, (to_y - start) * unit, 0.0])
            else:
                eye, direction = window.orbit.ray(to_x, to_y, window.size)
                away = (place[1] - eye[1]) / (direction[1] or np.inf)
                way = eye + away * direction - place
                if not (away > 0.0 and np.linalg.norm(way) < window.session.scene.diagonal):
                    return
            x, y, z = (np.add(begun, self.in_splat(place + way)) - self.in_splat(place)).tolist()
            self._put(number, (x, y, z), lifted=shift, merge=("drag", number))

        return drag

    def turn(self, angle_deg: float) -> None:
        """Turn the selected object about the vertical, counter-clockwise from above."""
        if self.bench is not None:
            asked = self.bench.placed[self.selected]
            self._put(self.selected, asked.at, turn_deg=(asked.turn_deg + angle_deg) % 360.0)

    def _put(self, number: int, at: Triple, **how: Any) -> None:
        """Move an object, as `ObjectBench.put`; show the options that place it there."""
        self.bench.put(number, at, **how)
        asked = self.bench.placed[number]
        place = ",".join(f"{each:.4g}" for each in asked.at)
        on = f" --on {asked.on}" if asked.on else ""
        turn = f" --turn {asked.turn_deg:g}" if asked.turn_deg else ""
        self._window.note = f"--insert {asked.name} --at {place}{turn}{on}"
