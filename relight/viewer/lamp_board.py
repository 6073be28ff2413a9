"""The user's changes to the lamps of a session, with undo and redo. Independent of the window."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError

from ..lamps.asked import AskedLamp, moved
from ..lamps.shapes import MeshLamp, RectangleLamp, TubeLamp, checked_vector
from .history import History, Timeline

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
    """The lamps of a session and the changes to them.

    state: the present BoardState. start: the first one. selected: the number of the lamp that keys act on, or None.
    """

    def __init__(
        self, lamps: Sequence[AskedLamp] = (), captured: float = 1.0, timeline: Timeline | None = None
    ) -> None:
        self.start = BoardState(tuple(BoardLamp(place, each) for place, each in enumerate(lamps, 1)), float(captured))
        self._timeline = timeline or Timeline()
        self._history, self._saved = History(self.start, self._timeline), self.start
        self._selected: int | None = None
        self._next = len(lamps) + 1

    @property
    def state(self) -> BoardState:
        """The present state, immutable."""
        return self._history.present

    @property
    def selected(self) -> int | None:
        """The number of the selected lamp, or None."""
        number = self._selected
        return number if number is not None and self.state.of(number) is not None else None

    @property
    def unsaved(self) -> bool:
        """Whether the lamps differ from those at the start, or those saved last."""
        return self.state.lamps != self._saved.lamps

    @property
    def undoable(self) -> int:
        """How many changes can be undone."""
        return self._history.undoable

    @property
    def redoable(self) -> int:
        """How many changes can be redone."""
        return self._history.redoable

    def select(self, number: int | None) -> None:
        """Select a lamp, or none. Raises InputError for an unknown number."""
        if number is not None:
            self.asked(number)
        self._selected = number

    def asked(self, number: int) -> AskedLamp:
        """The lamp of a number. Raises InputError for an unknown number."""
        found = self.state.of(number)
        if found is None:
            numbers = ", ".join(str(lamp.number) for lamp in self.state.lamps) or "none is there"
            raise InputError(f"lamp {number}: expected the number of a lamp ({numbers})")
        return found

    def add(self, asked: AskedLamp) -> int:
        """Add a lamp and select it; return its number."""
        number = self._next
        self._next += 1
        self._history.to(replace(self.state, lamps=(*self.state.lamps, BoardLamp(number, asked))))
        self._selected = number
        return number

    def change(self, number: int, asked: AskedLamp, merge: Hashable = None) -> None:
        """Replace a lamp. merge: successive changes that share it are undone as one."""
        if asked is not self.asked(number):
            lamps = (lamp if lamp.number != number else BoardLamp(number, asked) for lamp in self.state.lamps)
            self._history.to(replace(self.state, lamps=tuple(lamps)), merge)

    def move(self, number: int, position: Triple, merge: Hashable = None) -> None:
        """Move the `place_of` a lamp to a position."""
        asked = self.asked(number)
        offset = np.subtract(checked_vector("position", position), place_of(asked))
        if offset.any():
            x, y, z = offset.tolist()
            self.change(number, replace(asked, shape=moved(asked.shape, (x, y, z))), merge)

    def remove(self, number: int) -> None:
        """Remove a lamp."""
        self.asked(number)
        self._history.to(replace(self.state, lamps=tuple(lamp for lamp in self.state.lamps if lamp.number != number)))

    def dim(self, captured: float, merge: Hashable = None) -> None:
        """Set the factor on the captured light, from 0 to `MOST_CAPTURED`. Raises InputError for a non-finite one."""
        if not np.isfinite(captured):
            raise InputError(f"captured must be a finite number, found {captured}")
        captured = float(min(max(captured, 0.0), MOST_CAPTURED))
        if captured != self.state.captured:
            self._history.to(replace(self.state, captured=captured), merge)

    def reset(self) -> None:
        """Reset everything, as a change like others."""
        if self.state != self.start:
            self._history.to(self.start)

    def undo(self) -> bool:
        """Undo the last change of lamps, or of others on the timeline; return whether there was one."""
        return self._timeline.undo()

    def redo(self) -> bool:
        """Redo the change that was undone last; return whether there was one."""
        return self._timeline.redo()

    def end_merge(self) -> None:
        """Make the next change separate."""
        self._history.end_merge()

    def saved(self) -> None:
        """Record that the present lamps are saved."""
        self._saved = self.state


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
