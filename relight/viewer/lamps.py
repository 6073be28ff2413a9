"""The lamps of a session: the user's changes, and their light: at once by one ray a vertex, as a relight at rest."""

import os
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import vector
from splat2mesh.scene.color import luminance

from ..engine.light_mix import LightBeside
from ..engine.placed import Placed
from ..lamps.asked import LARGEST_EV, WHITE, AskedLamp, Brightness, LampScale, resolve
from ..lamps.fields import changed
from ..lamps.photometry import axis_intensity
from ..lamps.shapes import MeshLamp, RectangleLamp, SphereLamp, TubeLamp, shifted
from ..lamps.spec import asked_lamps, write_lamps
from .bench import Answer, Bench, Check
from .history import Timeline
from .lighting import SPARE
from .request import LampSource

DARK = "the lamps light nothing: they are inside a wall, outside, or face away"

MOST_CAPTURED = 10.0
"""Largest factor on the captured light."""


class BoardLamp(NamedTuple):
    """A lamp of a session. number: unique within the session. asked: in the frame of the splat."""

    number: int
    asked: AskedLamp


@dataclass(frozen=True)
class BoardState:
    """The lamps of a session, in order, and the factor on the captured light."""

    lamps: tuple[BoardLamp, ...]
    captured: float

    def of(self, number: int) -> AskedLamp | None:
        """The lamp of a number, or None."""
        return next((lamp.asked for lamp in self.lamps if lamp.number == number), None)


class LampBoard:
    """The lamps of a session, the captured light beside them, and the changes to both. Positions are in the frame of
    the splat. The timeline undoes every change.

    state: the present BoardState. start: the first one. selected: the number of the lamp that keys act on, or None.
    scale: returns the LampScale that a lamp's brightness must fit; without, any does. command: as of LampSource.
    """

    def __init__(
        self,
        lamps: Sequence[AskedLamp] = (),
        captured: float = 1.0,
        timeline: Timeline | None = None,
        scale: Callable[[], LampScale] | None = None,
        command: str = "",
    ) -> None:
        self.start = BoardState(tuple(BoardLamp(place, each) for place, each in enumerate(lamps, 1)), float(captured))
        self.timeline = timeline or Timeline()
        self.timeline.begin("lamps", self.start)
        self._scale, self._command, self._saved = scale, command, self.start
        self._selected: int | None = None
        self._next = len(lamps) + 1

    @property
    def state(self) -> BoardState:
        """The present state, immutable."""
        found: BoardState = self.timeline.present("lamps")
        return found

    @property
    def selected(self) -> int | None:
        """The number of the selected lamp, or None."""
        number = self._selected
        return number if number is not None and self.state.of(number) is not None else None

    @property
    def unsaved(self) -> bool:
        """Whether the lamps differ from those at the start, or those saved last."""
        return self.state.lamps != self._saved.lamps

    def follow(self, other: "LampBoard") -> None:
        """Number lamps as another does whose timeline was taken over, with the same lamp selected."""
        self._next, self._selected, self._saved = other._next, other._selected, other._saved

    def select(self, number: int | None) -> None:
        """Select a lamp, or none. Raises InputError for an unknown number."""
        if number is not None:
            self.asked(number)
        self._selected = number
        self.timeline.changed()

    def asked(self, number: int) -> AskedLamp:
        """The lamp of a number. Raises InputError for an unknown number."""
        found = self.state.of(number)
        if found is None:
            numbers = ", ".join(str(lamp.number) for lamp in self.state.lamps) or "none is there"
            raise InputError(f"lamp {number}: expected the number of a lamp ({numbers})")
        return found

    def add(self, lamp: Any) -> int:
        """Add a lamp and select it; return its number.

        lamp: one, as of `LightingOptions.placed`. Raises InputError for anything else, and for one too bright."""
        found = asked_lamps([lamp])
        if len(found) != 1:
            raise InputError(f"`lamp`: has {len(found)} lamps, expected one")
        number = self._next
        added = BoardLamp(number, self._checked(found[0]))
        self._next, self._selected = number + 1, number
        self._to(replace(self.state, lamps=(*self.state.lamps, added)))
        return number

    def change(
        self,
        number: int,
        *,
        color: str | Sequence[float] | None = None,  # as of `color=`
        brightness: str | None = None,  # as of `brightness=`, such as "+1EV"
        name: str | None = None,
        stops: float = 0.0,  # by which it gets brighter
        merge: Hashable = None,
    ) -> None:
        """Change colour, brightness or name of a lamp. Raises InputError for invalid values."""
        given = {"color": color, "brightness": brightness, "name": name}
        given = {field: value for field, value in given.items() if value is not None}
        asked = self.asked(number)
        asked = changed(asked, given) if given else asked
        self.put(number, self._checked(_brighter(asked, stops) if stops else asked), merge)

    def put(self, number: int, asked: AskedLamp, merge: Hashable = None) -> None:
        """Replace a lamp. merge: successive changes that share it are undone as one."""
        if asked is not self.asked(number):
            lamps = (lamp if lamp.number != number else BoardLamp(number, asked) for lamp in self.state.lamps)
            self._to(replace(self.state, lamps=tuple(lamps)), merge)

    def move(self, number: int, position: Sequence[float], merge: Hashable = None) -> None:
        """Move the `place_of` a lamp to a position (3,)."""
        asked = self.asked(number)
        offset = np.subtract(vector("position", position), place_of(asked))
        if offset.any():
            x, y, z = offset.tolist()
            self.put(number, replace(asked, shape=shifted(asked.shape, (x, y, z))), merge)

    def remove(self, number: int) -> None:
        """Remove a lamp."""
        self.asked(number)
        self._to(replace(self.state, lamps=tuple(lamp for lamp in self.state.lamps if lamp.number != number)))

    def dim(self, captured: float, merge: Hashable = None) -> None:
        """Set the factor on the captured light, from 0 to `MOST_CAPTURED`. Raises InputError for a non-finite one."""
        if not np.isfinite(captured):
            raise InputError(f"captured must be a finite number, found {captured}")
        captured = float(min(max(captured, 0.0), MOST_CAPTURED))
        if captured != self.state.captured:
            self._to(replace(self.state, captured=captured), merge)

    @property
    def selected_ev(self) -> float:
        """Brightness of the selected lamp in EV: 0 equals the captured light at 1 m; dark is -40. 0 without one."""
        if self.selected is None or self._scale is None:
            return 0.0
        asked = self.asked(self.selected)
        if asked.brightness.unit == "EV":
            return asked.brightness.value
        scale = self._scale()
        bright = float(luminance(axis_intensity(resolve(asked, scale)))) / (scale.irradiance * scale.metre**2)
        return float(np.log2(max(bright, 2.0**-LARGEST_EV)))

    def set_selected_ev(self, value: float) -> None:
        """Set it; successive changes are undone as one."""
        number = self.selected
        if number is not None:
            self.change(number, brightness=f"{value:.2f}EV", merge=("brightness", number))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the lamps as JSON, which `--lamp` reads. Raises InputError without lamps."""
        assert self._scale is not None  # of a session
        about = self._command.format(lamps=os.path.basename(path), captured=f"{self.state.captured:g}")
        write_lamps(path, [lamp.asked for lamp in self.state.lamps], self._scale(), about)
        self._saved = self.state

    def _to(self, state: BoardState, merge: Hashable = None) -> None:
        self.timeline.to("lamps", state, merge)

    def _checked(self, asked: AskedLamp) -> AskedLamp:
        """The lamp, if it can be lit. Raises InputError for one too bright."""
        if self._scale is not None:
            resolve(asked, self._scale())
        return asked


def _brighter(asked: AskedLamp, stops: float) -> AskedLamp:
    """The lamp with 2^stops times its light."""
    if not np.isfinite(stops):
        raise InputError(f"stops must be a finite number, found {stops}")
    value, unit = asked.brightness.value, asked.brightness.unit
    with np.errstate(over="ignore"):
        more = value + stops if unit == "EV" else float(np.float64(value) * np.exp2(stops))
    return replace(asked, brightness=Brightness(more, unit))


def place_of(asked: AskedLamp) -> Triple:
    """Position of a lamp in the frame of the splat: its middle, or the middle of a tube or mesh."""
    match asked.shape:
        case MeshLamp(vertices=vertices):
            place = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
        case TubeLamp(start=start, end=end):
            place = np.add(start, end) / 2.0
        case RectangleLamp(center=center):
            place = np.asarray(center)
        case shape:
            place = np.asarray(shape.position)
    x, y, z = (float(each) for each in place)
    return x, y, z


class LampsLit(NamedTuple):
    """beside: the light beside the environment; None for none. message: the text to show, or ""."""

    beside: LightBeside | None
    message: str = ""


class LampBench(Bench[BoardState, LampsLit]):
    """The light of a LampBoard on a LampSource. Changes show at once when it is ready."""

    def __init__(self, source: LampSource, board: LampBoard, first: LightBeside | None) -> None:
        super().__init__(Answer(board.start, LampsLit(first)))
        self.source, self._board = source, board
        self._glimpse = lru_cache(SPARE)(self._traced)

    @property
    def wanted(self) -> BoardState:
        """As of Bench."""
        return self._board.state

    @property
    def message(self) -> str:
        """The text to show on the present lamps, or ""."""
        shown = self.shown
        return self.failure or (shown.result.message if shown is not None and self.settled else "")

    def mixture(self) -> LightBeside | None:
        """The light now shown beside the environment; None for none."""
        shown = self.shown
        return None if shown is None else shown.result.beside

    def _prepare(self) -> None:
        self.source.mixture(1.0, None)
        self.source.mix.light_of([AskedLamp(SphereLamp((0.0, 0.0, 0.0), intensity=WHITE))], 1.0).glimpse()  # compiled

    def _exactly(self, state: BoardState, check: Check) -> Callable[[], LampsLit]:
        self.prepare()
        return partial(self._lit, state, check)

    def _lit(self, state: BoardState, check: Check) -> LampsLit:
        """The light of a state as a relight finds it."""
        check()
        if not state.lamps:
            return LampsLit(self.source.mixture(state.captured, None))
        tracer = self.source.mix.light_of([lamp.asked for lamp in state.lamps], state.captured)
        direct = tracer.direct_of(*range(len(state.lamps)), advance=check)
        check()
        beside = self.source.mixture(state.captured, tracer.with_bounces(direct))
        dark = not direct.any() and (tracer.emitters.color > 0.0).any()
        return LampsLit(beside, DARK if dark else "")

    def _quickly(self, state: BoardState, known: Answer[BoardState, LampsLit] | None) -> Callable[[], LampsLit] | None:
        return partial(self._changed, state, known) if self.ready and known is not None else None

    def _changed(self, state: BoardState, known: Answer[BoardState, LampsLit]) -> LampsLit:
        """The light of a state from a known one: what lamps changed since do is replaced, by one ray a vertex."""
        before, beside = known.state, known.result.beside
        captured, plain = self.source.mixture(before.captured, None), self.source.mix.light_of((), 1.0).without_bounces
        level = np.float32(captured.level)
        radiance, received = np.zeros_like(captured.radiance), np.zeros_like(captured.received)
        if beside is not None:
            radiance = level * (beside.radiance - captured.radiance)
            received = level * (beside.received - captured.received)
        for one, other, add in ((before, state, np.subtract), (state, before, np.add)):
            for lamp in one.lamps:
                if lamp not in other.lamps:
                    light = plain(self._glimpse(lamp))
                    radiance, received = add(radiance, light.radiance), add(received, light.received)
        radiance, received = np.maximum(radiance, 0.0), np.maximum(received, 0.0)
        lamps = Placed(radiance, received, received, []) if state.lamps else None
        return LampsLit(self.source.mixture(state.captured, lamps))

    def _traced(self, lamp: BoardLamp) -> NDArray[np.float32]:
        """The direct light of a lamp with hard shadows, (V, 3)."""
        return self.source.mix.light_of([lamp.asked], 1.0).glimpse()
