"""The objects of a session while they move: their shadow with few rays at once, with all rays when the input rests."""

from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from splat2mesh.base.errors import InputError

from ..insert.asked import AskedInsert
from .bench import Answer, Bench, Check
from .history import Timeline
from .request import ObjectSource, ObjectsUnder

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight

WAITING = "lighting the objects"

AskedInserts = tuple[AskedInsert, ...]

LitPoses: TypeAlias = tuple[AskedInserts, Hashable]
"""Poses, and what identifies the light on them."""


class ObjectBench(Bench[LitPoses, "InsertedLight"]):
    """The objects of a session. source: the ObjectSource. timeline: undoes changes of their poses. key: returns what
    identifies the light on them. under: returns that light; None while it is unknown."""

    def __init__(
        self,
        source: ObjectSource,
        timeline: Timeline,
        key: Callable[[], Hashable],
        under: Callable[[], ObjectsUnder | None],
    ) -> None:
        super().__init__()
        self.source, self.timeline, self._key, self._under = source, timeline, key, under
        self.timeline.begin("objects", tuple(source.inserts.asked))

    @property
    def wanted(self) -> LitPoses:
        """As of Bench."""
        return self.placed, self._key()

    @property
    def placed(self) -> AskedInserts:
        """The objects in the requested poses."""
        found: AskedInserts = self.timeline.present("objects")
        return found

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

    def _exactly(self, state: LitPoses, check: Check) -> "Callable[[], InsertedLight] | None":
        under = self._under()
        return None if under is None else partial(self.source.exact, state[0], under, check)

    def _quickly(
        self, state: LitPoses, known: "Answer[LitPoses, InsertedLight] | None"
    ) -> "Callable[[], InsertedLight] | None":
        """Objects that have moved, in the light that they had."""
        if known is None or state[0] == known.state[0]:
            return None
        return partial(self.source.inserts.moved(state[0]).glimpse, known.result)
