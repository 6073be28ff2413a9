"""The objects of a session while they move: their shadow by few rays at once, by all rays when the hand rests.

Two threads work: one takes glimpses of the newest positions, the other lights the objects anew and traces all that
they can reach, and stops where they have moved on. What is shown is the newest of both.
"""

from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from splat2mesh.base.errors import InputError

from ..insert.asked import AskedInsert
from .history import History, Timeline
from .object_source import ObjectSource, ObjectsUnder
from .worker import Superseded

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight

WAITING = "lighting the objects"

Placed = tuple[AskedInsert, ...]


class ShownObjects(NamedTuple):
    """Objects in their light. placed: where they stand. key: of the light. exact: whether by all rays."""

    light: "InsertedLight"
    placed: Placed
    key: Hashable
    exact: bool


class ObjectBench:
    """The objects of a session. `poll` it often.

    source: the ObjectSource. shown: what is there of their light, or None. history: where they stood. timeline: that of
    the session's other changes.
    """

    def __init__(self, source: ObjectSource, timeline: Timeline | None = None) -> None:
        self.source = source
        self.start: Placed = tuple(source.asked)
        self.history: History[Placed] = History(self.start, timeline or Timeline())
        self._failed: tuple[Placed, str] | None = None
        self.shown: ShownObjects | None = None
        self._key: Hashable = None
        self._quick = ThreadPoolExecutor(1, thread_name_prefix="objects")
        self._slow = ThreadPoolExecutor(1, thread_name_prefix="objects exact")
        self._glimpse: tuple[Placed, Hashable, Future] | None = None
        self._exact: tuple[Placed, Hashable, Future] | None = None
        self._closed = False

    @property
    def placed(self) -> Placed:
        """The objects where they are to stand."""
        return self.history.present

    @property
    def failure(self) -> str:
        """Why their light cannot be found there, or ""."""
        return self._failed[1] if self._failed is not None and self._failed[0] is self.placed else ""

    @property
    def settled(self) -> bool:
        """Whether the light of the objects is complete where they stand."""
        shown = self.shown
        return shown is not None and shown.exact and (shown.placed, shown.key) == (self.placed, self._key)

    @property
    def message(self) -> str:
        """What there is to tell, or ""."""
        return self.failure or (WAITING if self.shown is None else "")

    def put(
        self,
        number: int,
        at: tuple[float, float, float],
        turn_deg: float | None = None,
        lifted: bool = False,
        merge: Hashable = None,
    ) -> None:
        """Put the origin of an object at a position in the frame of the splat, and turn it. It stays on the floor if
        it was let down on it and is not lifted. merge: changes in a row that share it are undone as one."""
        if not 0 <= number < len(self.placed):
            raise InputError(f"object {number}: expected a number from 0 to {len(self.placed) - 1}")
        old = self.placed[number]
        new = replace(old, at=at, turn_deg=old.turn_deg if turn_deg is None else turn_deg)
        new = replace(new, on=None) if lifted else new
        if new != old:
            self.history.to((*self.placed[:number], new, *self.placed[number + 1 :]), merge)

    def reset(self) -> None:
        """All objects where they stood at the start; a change as others."""
        if self.placed != self.start:
            self.history.to(self.start)

    def poll(self, under: Callable[[], ObjectsUnder] | None, key: Hashable, rests: bool) -> bool:
        """Take in what the threads have found, and give them work; whether the picture may differ.

        under: returns the light now; None while it is not known. key: tells it from others. rests:
        whether hand and light do.
        """
        self._key = key
        changed = self._taken("_glimpse", False) | self._taken("_exact", True)
        if self.failure or under is None:
            return changed
        shown = self.shown
        if shown is not None and shown.placed != self.placed and self._glimpse is None:
            work = self._quick.submit(self.source.glimpse, self.placed, shown.light)
            self._glimpse = self.placed, shown.key, work
        if (rests or shown is None) and self._exact is None and not self.settled:
            placed = self.placed

            def check(_: int = 0) -> None:
                if self._closed or self.placed != placed or self._key != key:
                    raise Superseded

            self._exact = placed, key, self._slow.submit(self.source.exact, placed, under(), check)
        return changed

    def close(self) -> None:
        """Ask for nothing any more."""
        self._closed = True
        for pool in (self._quick, self._slow):
            pool.shutdown(wait=False, cancel_futures=True)

    def _taken(self, name: str, exact: bool) -> bool:
        running: tuple[Placed, Hashable, Future] | None = getattr(self, name)
        if running is None or not running[2].done():
            return False
        setattr(self, name, None)
        placed, key, done = running
        error = done.exception()
        if isinstance(error, Superseded):
            return False
        if error is not None:
            text = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
            self._failed = self.placed, f"the objects cannot be lit: {text}"
            return True
        if not exact and self.shown is not None and self.shown.exact and self.shown.placed == self.placed:
            return False  # the exact one was faster
        if exact and placed != self.placed and self.shown is not None:
            return False  # a glimpse of where they are is nearer to the truth
        self.shown = ShownObjects(done.result(), placed, key, exact)
        return True
