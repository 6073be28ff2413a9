"""The light of a session's lamps while they change: at once by one ray a vertex, as a relight lights them at rest."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine.light_mix import LightBeside
from ..engine.placed import Placed
from .bench import Answer, Bench, Check
from .lamp_board import BoardLamp, BoardState, LampBoard
from .lighting import SPARE
from .request import LampSource

DARK = "the lamps light nothing: they are inside a wall, outside, or face away"


class LampsLit(NamedTuple):
    """beside: the light beside the environment; None for none. message: the text to show, or ""."""

    beside: LightBeside | None
    message: str = ""


class LampBench(Bench[BoardState, LampsLit]):
    """The light of a LampBoard on a LampSource. ready: whether changes show at once."""

    def __init__(self, source: LampSource, board: LampBoard, first: LightBeside | None) -> None:
        exact = partial(partial, self._lit)
        super().__init__(lambda: board.state, exact, self._quickly, Answer(board.start, LampsLit(first)))
        self.source, self.ready = source, False
        self._glimpses: dict[BoardLamp, NDArray[np.float32]] = {}

    @property
    def message(self) -> str:
        """The text to show on the present lamps, or ""."""
        shown = self.shown
        return self.failure or (shown.result.message if shown is not None and self.settled else "")

    def prepare(self) -> None:
        """Start the long work, in the thread."""
        self.submit(self._prepared)

    def mixture(self) -> LightBeside | None:
        """The light now shown beside the environment; None for none."""
        shown = self.shown
        return None if shown is None else shown.result.beside

    def _prepared(self) -> None:
        if not self.ready:
            self.source.prepare()
            self.ready = True

    def _lit(self, state: BoardState, check: Check) -> LampsLit:
        """The light of a state as a relight finds it."""
        self._prepared()
        check()
        if not state.lamps:
            return LampsLit(self.source.mixture(state.captured, None))
        tracer = self.source.light_of([lamp.asked for lamp in state.lamps], state.captured)
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
        captured, plain = self.source.mixture(before.captured, None), self.source.light_of((), 1.0).without_bounces
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

    def _glimpse(self, lamp: BoardLamp) -> NDArray[np.float32]:
        """The direct light of a lamp with hard shadows, (V, 3)."""
        if lamp not in self._glimpses:
            while len(self._glimpses) >= SPARE:
                self._glimpses.pop(next(iter(self._glimpses)))
            self._glimpses[lamp] = self.source.light_of([lamp.asked], 1.0).glimpse()
        return self._glimpses[lamp]
