"""Answers to what a hand changes in a session: a quick one at once, the exact one when the input rests.

Two threads work. One answers the newest state quickly, from the newest exact answer. The other answers in full a state
that rests, and stops once another is wanted.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from .lighting import SPARE
from .worker import Superseded, in_words

Asked = TypeVar("Asked")
Found = TypeVar("Found")
Made = TypeVar("Made")

Check = Callable[..., None]
"""Called often, with any count; it ends the work by raising Superseded once another state is wanted."""


@dataclass(frozen=True, eq=False)
class Answer(Generic[Asked, Found]):
    """The result for a state. exact: whether in full."""

    state: Asked
    result: Found
    exact: bool = True


class Bench(ABC, Generic[Asked, Found]):
    """Answers the state that is wanted. `poll` it often.

    first: an Answer to begin with. spare: how many exact answers are kept for a return.
    """

    spare = SPARE

    def __init__(self, first: Answer[Asked, Found] | None = None) -> None:
        self._closed = False
        self._pools = {full: ThreadPoolExecutor(1, "exact" if full else "quick") for full in (False, True)}
        self._running: dict[bool, tuple[Asked, Future[Found]]] = {}
        self._kept = [] if first is None else [first]
        self._newest = first
        self._tried: Asked | None = None  # what was answered quickly last
        self._failed: tuple[Asked, str] | None = None
        self._prepared: Future[Any] | None = None

    @property
    @abstractmethod
    def wanted(self) -> Asked:
        """The present state. States are compared by ==."""

    @abstractmethod
    def _exactly(self, state: Asked, check: Check) -> Callable[[], Found] | None:
        """The work that finds the result for a state; None where there is nothing to do. Called in the window's thread,
        as `_quickly`; the work is not."""

    @abstractmethod
    def _quickly(self, state: Asked, known: Answer[Asked, Found] | None) -> Callable[[], Found] | None:
        """The same for a coarse result. known: the last exact Answer, if there is one."""

    def prepare(self) -> None:
        """Start the long work that comes before answers, in the thread of exact ones."""
        self._prepared = self._prepared or self.submit(self._prepare)

    def _prepare(self) -> Any:
        """That work; what it returns is `made`."""

    @property
    def waiting(self) -> bool:
        """Whether that work is not done."""
        return self._prepared is None or not self._prepared.done()

    @property
    def ready(self) -> bool:
        """Whether that work has succeeded."""
        return self._prepared is not None and not self.waiting and self._prepared.exception() is None

    @property
    def made(self) -> Any:
        """What that work has made; None before it is ready."""
        return self._prepared.result() if self._prepared is not None and self.ready else None

    @property
    def shown(self) -> Answer[Asked, Found] | None:
        """The newest Answer, or the exact one to what is wanted."""
        wanted = self.wanted
        return next((each for each in reversed(self._kept) if each.state == wanted), self._newest)

    @property
    def settled(self) -> bool:
        """Whether what is wanted is answered in full."""
        shown = self.shown
        return shown is not None and shown.exact and shown.state == self.wanted

    @property
    def failure(self) -> str:
        """Why what is wanted cannot be answered, or ""."""
        broken = None if self._prepared is None or self.waiting else self._prepared.exception()
        if broken is not None:
            return in_words(broken)
        return self._failed[1] if self._failed is not None and self._failed[0] == self.wanted else ""

    def submit(self, work: Callable[[], Made]) -> "Future[Made]":
        """Do other work in the thread of exact answers."""
        return self._pools[True].submit(work)

    def poll(self, rests: bool) -> bool:
        """Collect what is done and start what is missing; return whether the answer changed. rests: whether the input
        does, so that an exact one is worth its time."""
        changed = self._collected(False) | self._collected(True)
        wanted = self.wanted
        if self.settled:
            self._newest, self._tried = self.shown, None
        if self.settled or self.failure:
            return changed
        if wanted != self._tried and False not in self._running:
            known = self._kept[-1] if self._kept else None
            self._tried = wanted if self._start(False, wanted, self._quickly(wanted, known)) else None
        if (rests or (self._newest is None and False not in self._running)) and True not in self._running:
            self._start(True, wanted, self._exactly(wanted, self._check(wanted)))
        return changed

    def close(self) -> None:
        """End all work."""
        self._closed = True
        for pool in self._pools.values():
            pool.shutdown(wait=False, cancel_futures=True)

    def _start(self, full: bool, state: Asked, work: Callable[[], Found] | None) -> bool:
        if work is not None:
            self._running[full] = state, self._pools[full].submit(work)
        return work is not None

    def _check(self, state: Asked) -> Check:
        def check(_: int = 0) -> None:
            if self._closed or self.wanted != state:
                raise Superseded

        return check

    def _collected(self, full: bool) -> bool:
        """Take a finished answer; return whether there is one."""
        if full not in self._running or not self._running[full][1].done():
            return False
        state, done = self._running.pop(full)
        error = done.exception()
        if error is not None and not isinstance(error, Superseded):
            self._failed = state, in_words(error)
        result = None if error is not None else done.result()
        if result is not None:
            answer = Answer(state, result, full)
            if full:
                self._kept = [*self._kept, answer][-1 - self.spare :]
            if not full or self._newest is None or state == self.wanted:  # a quick one is closer to the present
                self._newest = answer
        return error is None or bool(self.failure)
