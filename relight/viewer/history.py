"""Undo for a session: the states of lamps and objects, and their order. Independent of the window."""

from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

MOST_CHANGES = 1000
"""Largest number of changes of a kind that can be undone."""

State = TypeVar("State")


class Timeline:
    """The changes of several histories in the order in which they were made."""

    def __init__(self) -> None:
        self._histories: list[History[Any]] = []
        self._number, self._together = 0, False

    @property
    def kept(self) -> bool:
        """Whether any history is kept."""
        return bool(self._histories)

    def undo(self) -> bool:
        """Undo the last change; return whether there was one."""
        last = max((each.done for each in self._histories), default=0)
        return self._step([each for each in self._histories if each.done == last > 0], -1)

    def redo(self) -> bool:
        """Redo the change that was undone last; return whether there was one."""
        first = min((each.undone for each in self._histories if each.redoable), default=0)
        return self._step([each for each in self._histories if each.redoable and each.undone == first], 1)

    @contextmanager
    def together(self) -> Iterator[None]:
        """All changes inside are undone as one."""
        self._number += 1
        self._together = True
        try:
            yield
        finally:
            self._together = False

    def joined(self, history: "History[Any]") -> None:
        """Add a history."""
        self._histories.append(history)

    def next_number(self, changed: "History[Any]") -> int:
        """The number of a new change, which ends the possibility to redo earlier ones."""
        self._number += not self._together
        for each in self._histories:
            each.forget_undone()
            if each is not changed:
                each.end_merge()
        return self._number

    def _step(self, histories: "list[History[Any]]", by: int) -> bool:
        for each in self._histories:
            each.end_merge()
        for each in histories:
            each.step(by)
        return bool(histories)


class History(Generic[State]):
    """The states of something, one of which is present."""

    def __init__(self, start: State, timeline: Timeline) -> None:
        self._states, self._numbers, self._at = [start], [0], 0
        self._merging: Hashable = None
        self._timeline = timeline
        timeline.joined(self)

    @property
    def present(self) -> State:
        """The present state."""
        return self._states[self._at]

    @property
    def undoable(self) -> int:
        """How many changes can be undone."""
        return self._at

    @property
    def redoable(self) -> int:
        """How many changes can be redone."""
        return len(self._states) - 1 - self._at

    @property
    def done(self) -> int:
        """The number of the last change; 0 without one that can be undone."""
        return self._numbers[self._at] if self._at else 0

    @property
    def undone(self) -> int:
        """The number of the change that a redo would apply."""
        return self._numbers[self._at + 1]

    def to(self, state: State, merge: Hashable = None) -> None:
        """Change to a state. merge: successive changes that share it are undone as one."""
        number = self._timeline.next_number(self)
        if merge is not None and merge == self._merging:
            self._states[self._at], self._numbers[self._at] = state, number
            return
        self._states.append(state)
        self._numbers.append(number)
        del self._states[: -MOST_CHANGES - 1], self._numbers[: -MOST_CHANGES - 1]
        self._at, self._merging = len(self._states) - 1, merge

    def step(self, by: int) -> bool:
        """Move by a number of states; return whether they exist."""
        self._merging = None
        there = 0 <= self._at + by < len(self._states)
        self._at += by if there else 0
        return there

    def end_merge(self) -> None:
        """Make the next change separate."""
        self._merging = None

    def forget_undone(self) -> None:
        """Drop the changes that could be redone."""
        del self._states[self._at + 1 :], self._numbers[self._at + 1 :]
