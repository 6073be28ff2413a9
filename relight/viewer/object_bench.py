"""The objects of a session while they move: their shadow with few rays at once, with all rays when the input rests.

Two threads work. One takes glimpses of the newest positions. The other relights the objects and traces everything in
their reach, and stops once they have moved. The session shows the newest result of both.
"""

from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from splat2mesh.base.errors import InputError

from ..insert.asked import AskedInsert
from .history import Timeline
from .sources import ObjectSource, ObjectsUnder
from .worker import Superseded, in_words

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight

WAITING = "lighting the objects"

AskedInserts = tuple[AskedInsert, ...]


class ShownObjects(NamedTuple):
    """Objects in their light. placed: their poses. key: of the light. exact: whether with all rays."""

    light: "InsertedLight"
    placed: AskedInserts
    key: Hashable
    exact: bool


class ObjectBench:
    """The objects of a session. `poll` it often.

    source: the ObjectSource. shown: the newest result of their light, or None. timeline: undoes changes of their poses.
    """

    def __init__(self, source: ObjectSource, timeline: Timeline | None = None) -> None:
        self.source = source
        self.start: AskedInserts = tuple(source.asked)
        self.timeline = timeline or Timeline()
        self.timeline.begin("objects", self.start)
        self._failed: tuple[AskedInserts, str] | None = None
        self.shown: ShownObjects | None = None
        self._key: Hashable = None
        self._quick = ThreadPoolExecutor(1, thread_name_prefix="objects")
        self._slow = ThreadPoolExecutor(1, thread_name_prefix="objects exact")
        self._glimpse: tuple[AskedInserts, Hashable, Future] | None = None
        self._exact: tuple[AskedInserts, Hashable, Future] | None = None
        self._closed = False

    @property
    def placed(self) -> AskedInserts:
        """The objects in the requested poses."""
        found: AskedInserts = self.timeline.present("objects")
        return found

    @property
    def failure(self) -> str:
        """Why their light cannot be computed there, or ""."""
        return self._failed[1] if self._failed is not None and self._failed[0] is self.placed else ""

    @property
    def settled(self) -> bool:
        """Whether the light of the objects is complete in their present poses."""
        shown = self.shown
        return shown is not None and shown.exact and (shown.placed, shown.key) == (self.placed, self._key)

    @property
    def message(self) -> str:
        """The message to show, or ""."""
        return self.failure or (WAITING if self.shown is None else "")

    def put(
        self,
        number: int,
        at: tuple[float, float, float],
        turn_deg: float | None = None,
        lifted: bool = False,
        merge: Hashable = None,
    ) -> None:
        """Move the origin of an object to a position in the frame of the splat, and turn it. An object on the floor
        stays there unless lifted. merge: successive changes that share it are undone as one."""
        if not 0 <= number < len(self.placed):
            raise InputError(f"object {number}: expected a number from 0 to {len(self.placed) - 1}")
        old = self.placed[number]
        new = replace(old, at=at, turn_deg=old.turn_deg if turn_deg is None else turn_deg)
        new = replace(new, on=None) if lifted else new
        if new != old:
            self.timeline.to("objects", (*self.placed[:number], new, *self.placed[number + 1 :]), merge)

    def reset(self) -> None:
        """Reset the poses of all objects, as a change like others."""
        if self.placed != self.start:
            self.timeline.to("objects", self.start)

    def poll(self, under: Callable[[], ObjectsUnder] | None, key: Hashable, rests: bool) -> bool:
        """Collect the results of the threads, and give them work; return whether the picture may differ.

        under: returns the present light; None while it is unknown. key: identifies it. rests: whether input and light
        are at rest.
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
        """Stop all requests."""
        self._closed = True
        for pool in (self._quick, self._slow):
            pool.shutdown(wait=False, cancel_futures=True)

    def _taken(self, name: str, exact: bool) -> bool:
        running: tuple[AskedInserts, Hashable, Future] | None = getattr(self, name)
        if running is None or not running[2].done():
            return False
        setattr(self, name, None)
        placed, key, done = running
        error = done.exception()
        if isinstance(error, Superseded):
            return False
        if error is not None:
            self._failed = self.placed, f"the objects cannot be lit: {in_words(error)}"
            return True
        if not exact and self.shown is not None and self.shown.exact and self.shown.placed == self.placed:
            return False  # the exact one was faster
        if exact and placed != self.placed and self.shown is not None:
            return False  # a glimpse at the present poses is closer to the truth
        self.shown = ShownObjects(done.result(), placed, key, exact)
        return True
