"""Lamps under the mouse: where a click adds one, how a drag moves one, and the marks that show them."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Triple
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear

from ..lamps.asked import TEMPERATURES, parse_color
from .lamp_board import bulb_at, place_of
from .pointing import Tool, WindowView
from .recording import free_name

if TYPE_CHECKING:
    from .canvas import HotArea
    from .request import LampSource

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


class LampGrip(NamedTuple):
    """A lamp being dragged. base: pixels from the pointer to the surface near it. off: distance from that surface,
    scene units; None without one. depth: of the lamp, along the view. shift: pixels from the pointer to it."""

    number: int
    base: tuple[float, float] | None
    off: float
    depth: float
    shift: tuple[float, float]


class LampTool(Tool):
    """Lamps under the mouse and the keys of a Window. path: the file of the last save, or None."""

    name = "lamps"

    def __init__(self, window: WindowView) -> None:
        super().__init__(window)
        self.path: Path | None = None
        self._grip: LampGrip | None = None
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
        asked = bulb_at(self.in_splat(place + off * normal))
        self._do(lambda: self.bench.add(asked))

    def grip(self, hot: "HotArea | None", x: float, y: float) -> bool:
        """Start to drag the lamp of a mark, and select it."""
        if hot is None or hot.lamp is None:
            return False
        number, board = hot.lamp, self.bench
        board.select(number)
        board.timeline.end_merge()
        at = self.in_scene(place_of(board.asked(number)))
        seen = self._seen_at(at)
        if seen is None:
            return True
        base = self._window.caster.closest(at[None].astype(np.float32)).points[0]
        found, off = self._seen_at(base), float(np.linalg.norm(base - at))
        shift = None if found is None else (found[0] - x, found[1] - y)
        depth = float((self._window.orbit.eye - at) @ self._window.orbit.axes[2])
        self._grip = LampGrip(number, shift, off, depth, (seen[0] - x, seen[1] - y))
        self.holds = True
        return True

    def drag(self, x: float, y: float, shift: bool) -> None:
        """Move the dragged lamp to a pixel: along the surfaces, or with shift in the plane of the picture."""
        grip, board = self._grip, self.bench
        if grip is None or board.state.of(grip.number) is None:
            return
        hit = None if shift or grip.base is None else self.surface_at(x + grip.base[0], y + grip.base[1])
        if hit is None:
            eye, direction = self._window.orbit.ray(x + grip.shift[0], y + grip.shift[1], self._window.size)
            place = eye + direction * (grip.depth / float(-direction @ self._window.orbit.axes[2]))
        else:
            place, normal = hit
            place = place + min(grip.off, self._free(place, normal) / 2.0) * normal
        self._do(lambda: board.move(grip.number, self.in_splat(place), merge=("drag", grip.number)))

    def next_color(self) -> None:
        """Give the selected lamp the next colour."""
        number = self._selected()
        if number is not None:
            now, colors = self.bench.asked(number).color, [parse_color(name) for name in COLORS]
            name = COLORS[(colors.index(now) + 1) % len(COLORS)] if now in colors else COLORS[0]
            self._do(lambda: self.bench.change(number, color=name))

    def remove(self) -> None:
        """Remove the selected lamp."""
        number = self._selected()
        if number is not None:
            self._do(lambda: self.bench.remove(number))

    def dim_to(self, factor: float) -> None:
        """Set the factor on the captured light, by a slider."""
        self._do(lambda: self.bench.dim(factor, merge="captured"))

    def brighten_to(self, value: float) -> None:
        """Set the brightness of the selected lamp in EV, by a slider."""
        self._do(lambda: self.bench.set_selected_ev(value))

    def step_back(self, again: bool = False) -> None:
        """Undo or redo; show a message if there is nothing."""
        session = self._window.session
        if not session.timeline.kept:
            return
        if not (session.timeline.redo() if again else session.timeline.undo()):
            self._window.note = f"nothing to {'redo' if again else 'undo'}"
        self._used = True

    def save(self, path: "Path | str | None" = None) -> None:
        """Save the lamps, by default to the file of the last save, else under the first free name in this folder."""
        board = self.bench
        if board is None:
            self._window.note = "the lamps of this session cannot be changed: open it by relight SCENE --view"
            return
        path = Path(path) if path else self.path or (free_name(OTHER_FILES) if Path(FILE).exists() else Path(FILE))

        def save() -> None:
            board.save(path)
            self.path, self._window.note = path, f"saved {path.absolute()}"

        self.tried(save)

    def leave(self) -> None:
        """Save unsaved changes made with the mouse."""
        board = self.bench
        if self._used and board is not None and board.unsaved and board.state.lamps:
            self.save()

    def _do(self, change: Callable[[], object]) -> None:
        self._used = True
        self.tried(change)

    def _selected(self) -> int | None:
        board = self.bench
        number = None if board is None else board.selected
        if number is None:
            self._window.note = "no lamp is selected: press t, then click a lamp"
        return number

    # Positions: pixels, the frame of the scene, the frame of the splat

    @property
    def _source(self) -> "LampSource":
        bench = self._window.session.bench
        assert bench is not None
        return bench.source

    @property
    def _metre(self) -> float:
        """In units of the scene."""
        scale = float(np.cbrt(abs(np.linalg.det(self._motion[:3, :3])))) or 1.0
        return float(self._source.scale().metre) * scale

    def _seen_at(self, place: NDArray[np.float64]) -> tuple[float, float] | None:
        """The pixel of a position, from the lower left; None behind the eye."""
        orbit, (width, height) = self._window.orbit, self._window.size
        right, up, backward = orbit.axes @ (place - orbit.eye)
        if backward >= 0.0:
            return None
        focal = orbit.focal(self._window.size)
        return width / 2 - focal * right / backward, height / 2 - focal * up / backward

    def _free(self, place: NDArray[np.float64], normal: NDArray[np.float64]) -> float:
        """Distance from a surface along its normal to the next surface."""
        start = place + 1e-3 * self._window.session.scene.diagonal * normal
        ray = np.concatenate([start, normal])[None].astype(np.float32)
        return float(self._window.caster.first_hits(ray).distance[0])


def _shown(color: Triple) -> NDArray[np.uint8]:
    light = np.asarray(color) / max(*color, 1e-12)
    return bytes_from_unit(srgb_from_linear(light))
