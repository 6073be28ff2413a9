"""Undo for a session: all its states of lamps and objects. Independent of the window."""

from collections.abc import Callable, Hashable
from typing import Any


class Timeline:
    """The states of several things, by name, one of which is present. changed: called after every change, undo too."""

    def __init__(self, changed: Callable[[], None] = lambda: None) -> None:
        self.changed = changed
        self._states: list[dict[str, Any]] = [{}]
        self._at = 0
        self._merging: Hashable = None

    @property
    def kept(self) -> bool:
        """Whether there is anything whose changes are kept."""
        return bool(self._states[0])

    def begin(self, name: str, start: Any) -> None:
        """Keep the changes of a thing. Call it before the first change."""
        self._states[0][name] = start

    def present(self, name: str) -> Any:
        """The present state of a thing."""
        return self._states[self._at][name]

    def follow(self, other: "Timeline") -> None:
        """Take over the states of another, whose things have the same names."""
        self._states, self._at, self._merging = list(other._states), other._at, None
        self.changed()

    def to(self, name: str, state: Any, merge: Hashable = None) -> None:
        """Change the state of a thing. merge: changes of it in a row that share it are undone as one."""
        key, changed = None if merge is None else (name, merge), {**self._states[self._at], name: state}
        del self._states[self._at + 1 :]
        if key is not None and key == self._merging:
            self._states[self._at] = changed
        else:
            self._states.append(changed)
        self._at, self._merging = len(self._states) - 1, key
        self.changed()

    def reset(self) -> None:
        """Bring all things to their start, as one change."""
        start, self._merging = self._states[0], None
        if self._states[self._at] != start:
            self._states[self._at + 1 :] = [start]
            self._at += 1
            self.changed()

    def end_merge(self) -> None:
        """Make the next change separate."""
        self._merging = None

    def undo(self) -> bool:
        """Undo the last change; return whether there was one."""
        return self._step(-1)

    def redo(self) -> bool:
        """Redo the change that was undone last; return whether there was one."""
        return self._step(1)

    def _step(self, by: int) -> bool:
        self._merging = None
        there = 0 <= self._at + by < len(self._states)
        self._at += by if there else 0
        self.changed()
        return there
