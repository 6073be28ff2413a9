"""Lamps under the mouse: where a click adds one, how a drag moves one, and the marks that show them."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Triple
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear

from ..lamps.asked import TEMPERATURES, parse_color
from .lamps import LampBoard, place_of
from .pointing import Drag, Tool, WindowView
from .recording import free_name

if TYPE_CHECKING:
    from .canvas import HotArea

OFF_M = 0.3
"""Distance of a new lamp from the surface in metres; half of the free distance if that is less than twice this."""

COLORS = *TEMPERATURES, "red", "orange", "yellow", "green", "cyan", "blue", "magenta"
"""The cycle of a lamp's colours."""

FILE, OTHER_FILES = "lamps.json", "lamps_{:04d}.json"


class Mark(NamedTuple):
    """A visible lamp: its number, pixels from the lower left, sRGB bytes, and whether it is selected."""

    number: int
    x: float
    y: float
    color: tuple[int, int, int]
    selected: bool


class LampTool(Tool):
    """Lamps under the mouse and the keys of a Window. path: the file of the last save, or None."""

    name = "lamps"

    def __init__(self, window: WindowView) -> None:
        super().__init__(window)
        self.path: Path | None = None
        self._used = False

    def marks(self) -> list[Mark]:
        """The lamps in view, while clicks add lamps."""
        if not self.on:
            return []
        found, board = [], self.bench
        for number, asked in board.state.lamps:
            place = self._seen_at(self.in_scene(place_of(asked)))
            if place is not None:
                red, green, blue = (int(each) for each in _shown(asked.color))
                found.append(Mark(number, *place, (red, green, blue), number == board.selected))
        return found

    def toggle(self) -> None:
        """As of Tool; the light of the first lamp is prepared."""
        super().toggle()
        if self._window.session.bench is not None:
            self._window.session.bench.prepare()

    def click(self, x: float, y: float) -> None:
        """Add a bulb near the surface at a pixel; without a surface show a message."""
        hit = self.surface_at(x, y)
        if hit is None:
            self._window.note = "no surface there: click on a surface to add a lamp"
            return
        place, normal = hit
        off = min(OFF_M * self._metre, self._free(place, normal) / 2.0)
        asked = ",".join(repr(each) for each in self.in_splat(place + off * normal))
        self.do(lambda board: board.add(asked))

    def grip(self, hot: "HotArea | None", x: float, y: float) -> Drag | None:
        """Select the lamp of a mark, and start to drag it: along the surfaces, or with shift in the picture's plane."""
        if hot is None or hot.lamp is None:
            return None
        number, board, window = hot.lamp, self.bench, self._window
        board.select(number)
        board.timeline.end_merge()
        at = self.in_scene(place_of(board.asked(number)))
        seen = self._seen_at(at)
        if seen is None:
            return lambda *_: None
        base = window.caster.closest(at[None].astype(np.float32)).points[0]
        found, off = self._seen_at(base), float(np.linalg.norm(base - at))  # the surface nearby, and how far it is
        depth = float((window.orbit.eye - at) @ window.orbit.axes[2])

        def drag(to_x: float, to_y: float, shift: bool) -> None:
            if board.state.of(number) is None:
                return
            right, up = to_x - x, to_y - y
            hit = None if shift or found is None else self.surface_at(found[0] + right, found[1] + up)
            if hit is None:
                eye, direction = window.orbit.ray(seen[0] + right, seen[1] + up, window.size)
                place = eye + direction * (depth / float(-direction @ window.orbit.axes[2]))
            else:
                place, normal = hit
                place = place + min(off, self._free(place, normal) / 2.0) * normal
            self.do(lambda board: board.move(number, self.in_splat(place), merge=("drag", number)))

        return drag

    def next_color(self) -> None:
        """Give the selected lamp the next colour."""

        def change(board: LampBoard, number: int) -> None:
            now, colors = board.asked(number).color, [parse_color(name) for name in COLORS]
            name = COLORS[(colors.index(now) + 1) % len(COLORS)] if now in colors else COLORS[0]
            board.change(number, color=name)

        self._to_selected(change)

    def remove(self) -> None:
        """Remove the selected lamp."""
        self._to_selected(LampBoard.remove)

    def step_back(self, again: bool = False) -> None:
        """Undo or redo; show a message if there is nothing."""
        session = self._window.session
        if not session.timeline.kept:
            return
        if not (session.timeline.redo() if again else session.timeline.undo()):
            self._window.note = f"nothing to {'redo' if again else 'undo'}"
        self._used = True

    def save(self) -> None:
        """Save the lamps: to the file of the last save, else under the first free name in this folder."""
        board = self.bench
        if board is None:
            self._window.note = "the lamps of this session cannot be changed: open it by relight SCENE --view"
            return
        path = self.path or (free_name(OTHER_FILES) if Path(FILE).exists() else Path(FILE))

        def save() -> None:
            board.save(path)
            self.path, self._window.note = path, f"saved {path.absolute()}"

        self.tried(save)

    def leave(self) -> None:
        """Save unsaved changes made with the mouse."""
        board = self.bench
        if self._used and board is not None and board.unsaved and board.state.lamps:
            self.save()

    def do(self, change: Callable[[LampBoard], object]) -> None:
        """Change the lamps, or the captured light; show a message if that is refused."""
        self._used = True
        self.tried(lambda: change(self.bench))

    def _to_selected(self, change: Callable[[LampBoard, int], None]) -> None:
        number = None if self.bench is None else self.bench.selected
        if number is None:
            self._window.note = "no lamp is selected: press t, then click a lamp"
        else:
            self.do(lambda board: change(board, number))

    # Positions: pixels, the frame of the scene, the frame of the splat

    @property
    def _metre(self) -> float:
        """In units of the scene."""
        assert self._window.session.bench is not None
        scale = float(np.cbrt(abs(np.linalg.det(self._motion[:3, :3])))) or 1.0
        return float(self._window.session.bench.source.mix.scale.metre) * scale

    def _seen_at(self, place: NDArray[np.float64]) -> tuple[float, float] | None:
        """The pixel of a position, from the lower left; None behind the eye."""
        size = self._window.size
        ((x, y),), (depth,) = self._window.orbit.view(size).project(place[None])
        return (float(x), size[1] - float(y)) if depth > 0.0 else None

    def _free(self, place: NDArray[np.float64], normal: NDArray[np.float64]) -> float:
        """Distance from a surface along its normal to the next surface."""
        start = place + 1e-3 * self._window.session.scene.diagonal * normal
        ray = np.concatenate([start, normal])[None].astype(np.float32)
        return float(self._window.caster.first_hits(ray).distance[0])


def _shown(color: Triple) -> NDArray[np.uint8]:
    light = np.asarray(color) / max(*color, 1e-12)
    return bytes_from_unit(srgb_from_linear(light))
