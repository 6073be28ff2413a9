"""The light of a session's lamps while they change: at once by one ray a vertex, exactly when the input rests.

The light is a sum of terms, one a lamp, traced as if the lamp were white. Colour and brightness scale a term; a new
position needs a new one, and the other lamps keep theirs. A glimpse of the new term is taken at once. The rest follows
in a thread: the exact term, its bounces, and finally all lamps together as a relight lights them, which is the lasting
result. Finished states are kept, so undo shows them at once, to the bit.
"""

import queue
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..engine.light_mix import LightBeside
from ..lamps.asked import AskedLamp, resolve
from ..lamps.photometry import axis_intensity
from ..live.terms import MOST_LAMPS
from .lamp_board import BoardLamp, BoardState, LampBoard, without_color
from .lighting import SPARE
from .sources import LampSource, LampSum
from .worker import Superseded, in_words

DARK = "the lamps light nothing: they are inside a wall, outside, or face away"

Value = TypeVar("Value")


class LampTerm(NamedTuple):
    """The light of a lamp in white: (V, 3) float32.

    direct: on the white scene. radiance, received: contribution of bounces to exit radiance and irradiance over pi;
    None until computed. axis: (3,), intensity on its main axis, to which all is proportional.
    """

    direct: NDArray[np.float32]
    radiance: NDArray[np.float32] | None
    received: NDArray[np.float32] | None
    axis: NDArray[np.float64]


class LampBench:
    """The light of a LampBoard on a LampSource. `poll` it often.

    ready: whether glimpses can be taken. message: the text to show on the present lamps, or "".
    """

    def __init__(self, source: LampSource, board: LampBoard, first: LightBeside | None) -> None:
        self.source, self.board, self.ready = source, board, False
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="lamps")
        self._running: tuple[BoardState, Future] | None = None
        self._wanted = board.state
        self._events: queue.SimpleQueue[tuple[str, Any, Any]] = queue.SimpleQueue()
        self._finished: dict[BoardState, LightBeside | None] = {board.start: first}
        self._terms: dict[Hashable, LampTerm] = {}
        self._glimpses: dict[Hashable, LampTerm] = {}
        self._parts: dict[int, tuple[AskedLamp, LampTerm, LampTerm | None, LampSum]] = {}
        self._bounced: dict[Hashable, LampTerm] = {}  # by number: the last term of each lamp whose bounces were known
        self._axes: dict[tuple[AskedLamp, bool], NDArray[np.float64]] = {}
        self._dark: set[BoardState] = set()
        self._failed: tuple[BoardState, str] | None = None
        self._shown: tuple[BoardState, int] | None = None
        self._looked: tuple[BoardState, int] | None = None
        self._mixture, self._news = first, 0

    @property
    def settled(self) -> bool:
        """Whether the light of the present lamps is complete."""
        return self.board.state in self._finished

    @property
    def failure(self) -> str:
        """Why the light of the present lamps cannot be computed, or ""."""
        return self._failed[1] if self._failed is not None and self._failed[0] == self.board.state else ""

    @property
    def message(self) -> str:
        """The text to show on the present lamps, or ""."""
        return self.failure or (DARK if self.board.state in self._dark else "")

    def prepare(self) -> None:
        """Start the long work, in the thread."""
        if not self.ready and self._running is None:
            self._running = self.board.state, self._thread.submit(self._prepared)

    def poll(self, rests: bool) -> bool:
        """Collect the results of the thread, and give it work if the input rests; return whether the light may
        differ."""
        self._wanted = self.board.state
        changed = False
        if self._running is not None and self._running[1].done():
            state, done = self._running
            self._running, error = None, done.exception()
            if error is not None and not isinstance(error, Superseded):
                self._failed, changed = (state, in_words(error)), True
        while not self._events.empty():
            kind, key, payload = self._events.get()
            getattr(self, f"_take_{kind}")(key, payload)
            changed = True
        self._news += changed
        if rests and self._running is None and not self.failure:
            if not self.settled:
                self._running = self._wanted, self._thread.submit(self._work, self._wanted)
            elif self.ready and self._missing():  # for the first change that is to come
                self._running = self._wanted, self._thread.submit(self._warmed, self._wanted)
        return changed

    def mixture(self) -> LightBeside | None:
        """The light now shown beside the environment; None for none."""
        state, shown = self.board.state, (self.board.state, self._news)
        if shown == self._shown:
            return self._mixture
        if state in self._finished:
            self._mixture = self._finished[state]
        elif self.ready:
            self._mixture = self.source.mixture(state.captured, self._sum(state) if state.lamps else None)
        else:
            return self._mixture
        self._shown = shown
        return self._mixture

    def close(self) -> None:
        """Stop all requests."""
        self._wanted = BoardState((), -1.0)
        self._thread.shutdown(wait=False, cancel_futures=True)

    # In the window's thread

    def _sum(self, state: BoardState) -> LampSum:
        """The light of lamps, from finished terms and glimpses."""
        found: list[LampSum] = []
        for lamps in self._groups(state):
            key, axis = _key(lamps), self._axis(lamps, white=True)
            if not axis.any():
                continue
            term = self._terms.get(key) or self._glimpses.get(key)
            if term is None:
                term = LampTerm(self.source.light_of(_bare(lamps), state.captured).glimpse(), None, None, axis)
                _keep(self._glimpses, key, term, SPARE)
            found.append(self._parts_of(lamps, term))
        if not found:
            nothing = self.source.light_of((), state.captured).glimpse()
            return LampSum(nothing, nothing)
        radiance, received = found[0].radiance.copy(), found[0].received.copy()
        for parts in found[1:]:
            radiance += parts.radiance
            received += parts.received
        return LampSum(radiance, received)

    def _parts_of(self, lamps: Sequence[BoardLamp], term: LampTerm) -> LampSum:
        """The light of a term in the colour of its lamp, kept until either changes."""
        number, asked = lamps[0]
        bounced = term if term.radiance is not None else self._bounced.get(number)
        kept = self._parts.get(number)
        if kept is not None and kept[0] is asked and kept[1] is term and kept[2] is bounced:
            return kept[3]
        shines = self._axis(lamps)
        plain = self.source.light_of((), 1.0).without_bounces(_share(shines, term.axis) * term.direct)
        radiance, received = plain.radiance, plain.received
        if bounced is not None and bounced.radiance is not None and bounced.received is not None:
            share = _share(shines, bounced.axis)
            radiance, received = radiance + share * bounced.radiance, received + share * bounced.received
            _keep(self._bounced, number, bounced, 2 * MOST_LAMPS)
        parts = LampSum(radiance, received)
        _keep(self._parts, number, (asked, term, bounced, parts), 2 * MOST_LAMPS)
        return parts

    def _axis(self, lamps: Sequence[BoardLamp], white: bool = False) -> NDArray[np.float64]:
        """Intensity on the main axis (3,), with or without its colour; of several that share a term, ones."""
        if len(lamps) > 1:
            return np.ones(3)
        asked = lamps[0].asked
        key = asked, white
        found = self._axes.get(key)
        if found is None:
            found = axis_intensity(resolve(without_color(asked) if white else asked, self.source.scale()))
            _keep(self._axes, key, found, 4 * MOST_LAMPS)
        return found

    def _groups(self, state: BoardState) -> list[list[BoardLamp]]:
        """The lamps that share a term."""
        if len(state.lamps) <= MOST_LAMPS:
            return [[lamp] for lamp in state.lamps]
        untouched = set(self.board.start.lamps)
        rest = [lamp for lamp in state.lamps if lamp in untouched]
        return [[lamp] for lamp in state.lamps if lamp not in untouched] + ([rest] if rest else [])

    def _missing(self) -> bool:
        """Whether the term of a shining lamp is missing; evaluated once per state and its results since."""
        if self._looked == (self.board.state, self._news):
            return False
        self._looked = self.board.state, self._news
        groups = self._groups(self.board.state)
        return any(not self._known(lamps) and self._axis(lamps, white=True).any() for lamps in groups)

    def _take_prepared(self, _: None, __: None) -> None:
        self.ready = True

    def _take_term(self, lamps: Sequence[BoardLamp], term: LampTerm) -> None:
        present = self._groups(self.board.state)
        for each in map(_key, present):
            if each in self._terms:
                self._terms[each] = self._terms.pop(each)  # drops the oldest first
        _keep(self._terms, _key(lamps), term, len(present) + SPARE)
        if term.radiance is not None:
            _keep(self._bounced, lamps[0].number, term, 2 * MOST_LAMPS)

    def _take_finished(self, state: BoardState, found: tuple[LightBeside, bool]) -> None:
        first = self._finished.pop(self.board.start)
        _keep(self._finished, state, found[0], SPARE)
        self._finished[self.board.start] = first
        if found[1]:
            self._dark.add(state)

    # In the thread of the bench

    def _prepared(self) -> None:
        if not self.ready:
            self.source.prepare()
            self._events.put(("prepared", None, None))

    def _warmed(self, state: BoardState) -> None:
        self._trace(state, self._check(state))

    def _check(self, state: BoardState) -> Callable[..., None]:
        """Ends the work on a state once another is wanted."""

        def check(_: int = 0) -> None:
            if self._wanted != state:
                raise Superseded

        return check

    def _work(self, state: BoardState) -> None:
        """Compute the light of a state, from its terms to the whole; ends early if another is wanted."""
        check = self._check(state)
        self._prepared()
        check()
        axis, white = np.zeros(3), np.zeros(3)
        if len(state.lamps) == 1:
            axis, white = self._axis(state.lamps), self._axis(state.lamps, white=True)
        alone = bool((axis > 0.0).all())  # then the whole determines the term
        if not alone:
            self._trace(state, check)
        elif _key(state.lamps) not in self._terms:  # soft shadows before a plan is made
            self._tell(
                state.lamps, LampTerm(self.source.light_of(_bare(state.lamps), 1.0).draft(check), None, None, white)
            )
        placed, dark = None, False
        if state.lamps:
            tracer = self.source.light_of([lamp.asked for lamp in state.lamps], state.captured)
            direct = tracer.direct_of(*range(len(state.lamps)), advance=check)
            check()
            share = _share(white, axis)
            if alone:
                self._tell(state.lamps, LampTerm(share * direct, None, None, white))
            placed = tracer.with_bounces(direct)
            if alone:
                plain = tracer.without_bounces(direct)
                more = share * (placed.radiance - plain.radiance), share * (placed.received - plain.received)
                self._tell(state.lamps, LampTerm(share * direct, *more, white))
            dark = not direct.any() and any(self._axis([lamp]).any() for lamp in state.lamps)
        check()
        self._events.put(("finished", state, (self.source.mixture(state.captured, placed), dark)))

    def _trace(self, state: BoardState, check: Callable[..., None]) -> None:
        """Compute the missing terms, direct light first."""
        for lamps in self._groups(state):
            axis = self._axis(lamps, white=True)
            if self._known(lamps) or not axis.any():
                continue
            tracer = self.source.light_of(_bare(lamps), state.captured)
            direct = tracer.draft(check)
            self._tell(lamps, LampTerm(direct, None, None, axis))
            check()
            placed, plain = tracer.with_bounces(direct), tracer.without_bounces(direct)
            self._tell(
                lamps, LampTerm(direct, placed.radiance - plain.radiance, placed.received - plain.received, axis)
            )
            check()

    def _known(self, lamps: Sequence[BoardLamp]) -> bool:
        term = self._terms.get(_key(lamps))
        return term is not None and term.radiance is not None

    def _tell(self, lamps: Sequence[BoardLamp], term: LampTerm) -> None:
        self._events.put(("term", lamps, term))


def _bare(lamps: Sequence[BoardLamp]) -> list[AskedLamp]:
    """The lamp that a term is traced for."""
    return [without_color(lamps[0].asked)] if len(lamps) == 1 else [lamp.asked for lamp in lamps]


def _key(lamps: Sequence[BoardLamp]) -> Hashable:
    """The key of a term: only the shape of a lamp, which includes its position."""
    if len(lamps) == 1:
        asked = lamps[0].asked
        return asked.shape, asked.radius_in_metres
    return tuple(lamp.number for lamp in lamps)


def _share(wanted: NDArray[np.float64], given: NDArray[np.float64]) -> NDArray[np.float32]:
    """The factor on a term, (3,) float32, from intensities on the main axis."""
    return np.divide(wanted, given, out=np.zeros(3), where=given > 0.0).astype(np.float32)


def _keep(kept: dict[Any, Value], key: Any, value: Value, most: int) -> None:
    """Keep a value as the newest; drop the oldest."""
    kept.pop(key, None)
    kept[key] = value
    while len(kept) > most:
        kept.pop(next(iter(kept)))
