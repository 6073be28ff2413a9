"""Lamps under the mouse: where a click adds one, how a drag moves one, and the marks that show them."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Triple
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear

from ..lamps.color import TEMPERATURES, parse_color
from .lamp_board import LampBoard, bulb_at, place_of
from .pointing import surface_at, tried
from .recording import free_name

if TYPE_CHECKING:
    from .sources import LampSource
    from .window_view import WindowView

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


class LampTool:
    """Lamps under the mouse and the keys of a Window. path: the file of the last save, or None."""

    def __init__(self, window: "WindowView") -> None:
        self._window = window
        self.path: Path | None = None
        self._grip: LampGrip | None = None
        self._used = False

    @property
    def on(self) -> bool:
        """Whether clicks add lamps."""
        return self._window.session.state.placing and self._window.session.lamps is not None

    def marks(self) -> list[Mark]:
        """The lamps in view, while clicks add lamps."""
        if not self.on:
            return []
        found, board = [], self._board
        for number, asked in board.state.lamps:
            place = self._seen_at(self._in_scene(place_of(asked)))
            if place is not None:
                red, green, blue = (int(each) for each in _shown(asked.color))
                found.append(Mark(number, *place, (red, green, blue), number == board.selected))
        return found

    def toggle(self) -> None:
        """Start or stop adding lamps."""
        session = self._window.session
        if session.bench is not None:
            session.change(placing=not session.state.placing, arranging=False)
            session.bench.prepare()

    def put(self, x: float, y: float) -> None:
        """Add a bulb near the surface at a pixel; without a surface show a message."""
        hit = surface_at(self._window, self._source, x, y)
        if hit is None:
            self._window.note = "no surface there: click on a surface to add a lamp"
            return
        place, normal = hit
        off = min(OFF_M * self._metre, self._free(place, normal) / 2.0)
        asked = bulb_at(self._in_splat(place + off * normal))
        self._do(lambda: self._board.add(asked))

    def grip(self, number: int, x: float, y: float) -> None:
        """Start to drag the lamp at a pixel, and select it."""
        board = self._board
        board.select(number)
        board.timeline.end_merge()
        at = self._in_scene(place_of(board.asked(number)))
        seen = self._seen_at(at)
        if seen is None:
            return
        base, off = self._base(at)
        found = None if base is None else self._seen_at(base)
        shift = None if found is None else (found[0] - x, found[1] - y)
        depth = float((self._window.orbit.eye - at) @ self._window.orbit.axes[2])
        self._grip = LampGrip(number, shift, off, depth, (seen[0] - x, seen[1] - y))

    @property
    def holds(self) -> bool:
        """Whether a lamp is being dragged."""
        return self._grip is not None

    def drag(self, x: float, y: float, freely: bool) -> None:
        """Move the dragged lamp to a pixel: along the surfaces, or `freely` in the plane of the picture."""
        grip, board = self._grip, self._board
        if grip is None or board.state.of(grip.number) is None:
            return
        hit = (
            None
            if freely or grip.base is None
            else surface_at(self._window, self._source, x + grip.base[0], y + grip.base[1])
        )
        if hit is None:
            eye, direction = self._window.orbit.ray(x + grip.shift[0], y + grip.shift[1], self._window.size)
            place = eye + direction * (grip.depth / float(-direction @ self._window.orbit.axes[2]))
        else:
            place, normal = hit
            place = place + min(grip.off, self._free(place, normal) / 2.0) * normal
        self._do(lambda: board.move(grip.number, self._in_splat(place), merge=("drag", grip.number)))

    def let_go(self) -> None:
        """End the drag; later changes are undone separately."""
        self._grip = None
        self._window.session.timeline.end_merge()

    def next_color(self) -> None:
        """Give the selected lamp the next colour."""
        number = self._selected()
        if number is not None:
            now, colors = self._board.asked(number).color, [parse_color(name) for name in COLORS]
            name = COLORS[(colors.index(now) + 1) % len(COLORS)] if now in colors else COLORS[0]
            self._do(lambda: self._board.change(number, color=name))

    def remove(self) -> None:
        """Remove the selected lamp."""
        number = self._selected()
        if number is not None:
            self._do(lambda: self._board.remove(number))

    def dim_to(self, factor: float) -> None:
        """Set the factor on the captured light, by a slider."""
        self._do(lambda: self._board.dim(factor, merge="captured"))

    def brighten_to(self, value: float) -> None:
        """Set the brightness of the selected lamp in EV, by a slider."""
        self._do(lambda: self._board.set_selected_ev(value))

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
        board = self._window.session.lamps
        if board is None:
            self._window.note = "the lamps of this session cannot be changed: open it by relight SCENE --view"
            return
        path = Path(path) if path else self.path or (free_name(OTHER_FILES) if Path(FILE).exists() else Path(FILE))

        def save() -> None:
            board.save(path)
            self.path, self._window.note = path, f"saved {path.absolute()}"

        tried(self._window, save)

    def leave(self) -> None:
        """Save unsaved changes made with the mouse."""
        board = self._window.session.lamps
        if self._used and board is not None and board.unsaved and board.state.lamps:
            self.save()

    def _do(self, change: Callable[[], object]) -> None:
        self._used = True
        tried(self._window, change)

    def _selected(self) -> int | None:
        board = self._window.session.lamps
        number = None if board is None else board.selected
        if number is None:
            self._window.note = "no lamp is selected: press t, then click a lamp"
        return number

    # Positions: pixels, the frame of the scene, the frame of the splat

    @property
    def _board(self) -> LampBoard:
        board = self._window.session.lamps
        assert board is not None  # or no lamp can be reached
        return board

    @property
    def _source(self) -> "LampSource":
        bench = self._window.session.bench
        assert bench is not None
        return bench.source

    @property
    def _metre(self) -> float:
        """In units of the scene."""
        scale = float(np.cbrt(abs(np.linalg.det(self._source.scene_from_splat[:3, :3])))) or 1.0
        return float(self._source.scale().metre) * scale

    def _in_scene(self, place: ArrayLike) -> NDArray[np.float64]:
        motion = self._source.scene_from_splat
        return np.asarray(motion[:3, :3] @ np.asarray(place, np.float64) + motion[:3, 3])

    def _in_splat(self, place: NDArray[np.float64]) -> Triple:
        motion = self._source.scene_from_splat
        x, y, z = (float(each) for each in np.linalg.solve(motion[:3, :3], place - motion[:3, 3]))
        return x, y, z

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
        return float(self._source.first_hits(np.concatenate([start, normal])[None].astype(np.float32)).distance[0])

    def _base(self, at: NDArray[np.float64]) -> tuple[NDArray[np.float64] | None, float]:
        """The nearest surface point to a lamp, and its distance."""
        ways = fibonacci_sphere()
        rays = np.concatenate([np.broadcast_to(at, ways.shape), ways], axis=1).astype(np.float32)
        distance = self._source.first_hits(rays).distance
        nearest = int(np.argmin(distance))
        if not math.isfinite(distance[nearest]):
            return None, 0.0
        return at + float(distance[nearest]) * ways[nearest], float(distance[nearest])


def _shown(color: Triple) -> NDArray[np.uint8]:
    light = np.asarray(color) / max(*color, 1e-12)
    return bytes_from_unit(srgb_from_linear(light))
