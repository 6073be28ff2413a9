"""Changing the lamps of a session, for Python and for the keys of the window."""

import os
from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import luminance

from ..engine.light_mix import LightBeside
from ..lamps.asked import LARGEST_EV, AskedLamp, Brightness, resolve
from ..lamps.fields import changed
from ..lamps.photometry import axis_intensity
from ..lamps.placing import asked_lamps
from ..lamps.saving import write_lamps
from .history import Timeline
from .lamp_bench import LampBench, without_color
from .lamp_board import BoardState, LampBoard
from .lamp_source import LampSource

_NOT_HERE = "the lamps of this session cannot be changed: open it by `relight SCENE --view`, or `view_request`"


class LampEditing:
    """The lamps of a session, and the captured light beside them.

    board: LampBoard, and bench: LampBench, or None in a session whose lamps cannot be changed. Positions are in the
    frame of the splat. Every change can be undone.
    """

    def __init__(self, source: LampSource | None, mixture: LightBeside | None) -> None:
        self._mixture, self.timeline = mixture, Timeline()
        self.board: LampBoard | None = None
        self.bench: LampBench | None = None
        if source is not None:
            self.board = LampBoard(source.asked, source.captured, self.timeline)
            self.bench = LampBench(source, self.board, mixture)

    @property
    def lamps_now(self) -> BoardState:
        """The present lamps, with their numbers, and the factor on the captured light."""
        return self._board.state

    def add_lamp(self, lamp: Any) -> int:
        """Add a lamp and select it.

        Parameters
        ----------
        lamp : Lamp, AskedLamp, str or path
            As of `LightingOptions.placed`; one lamp.

        Returns
        -------
        int
            Its number.

        Raises
        ------
        InputError
            For anything but one lamp, and in a session whose lamps cannot be changed.
        """
        found = asked_lamps([lamp])
        if len(found) != 1:
            raise InputError(f"`lamp`: has {len(found)} lamps, expected one")
        number = self._board.add(self._checked(found[0]))
        self._edited()
        return number

    def move_lamp(self, number: int, position: Sequence[float], merge: Hashable = None) -> None:
        """Move the middle of a lamp to a position (3,). merge: successive moves that share it are undone as one."""
        x, y, z = position
        self._board.move(number, (x, y, z), merge)
        self._edited()

    def change_lamp(
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
        asked = self._board.asked(number)
        given = {field: value for field, value in given.items() if value is not None}
        asked = changed(asked, given) if given else asked
        self._board.change(number, self._checked(_brighter(asked, stops) if stops else asked), merge)
        self._edited()

    def remove_lamp(self, number: int) -> None:
        """Remove a lamp."""
        self._board.remove(number)
        self._edited()

    def dim_captured(self, factor: float, merge: Hashable = None) -> None:
        """Multiply the captured light by a factor from 0."""
        self._board.dim(factor, merge)
        self._edited()

    def select_lamp(self, number: int | None) -> None:
        """Choose the lamp that keys act on, or none."""
        self._board.select(number)
        self._edited()

    def undo(self) -> bool:
        """Undo the last change of lamps, captured light or objects; return whether there was one."""
        done = self._kept.undo()
        self._edited()
        return done

    def redo(self) -> bool:
        """Redo it; return whether there was one."""
        done = self._kept.redo()
        self._edited()
        return done

    def reset_lamps(self) -> None:
        """Reset all lamps and the captured light, as one change."""
        self._board.reset()
        self._edited()

    def lamp_ev(self) -> float:
        """Brightness of the selected lamp in EV: 0 equals the captured light at 1 m; dark is -40."""
        board, bench = self._board, self.bench
        if bench is None or board.selected is None:
            return 0.0
        asked = board.asked(board.selected)
        if asked.brightness.unit == "EV":
            return asked.brightness.value
        scale = bench.source.scale()
        bright = float(luminance(axis_intensity(resolve(asked, scale)))) / (scale.irradiance * scale.metre**2)
        return float(np.log2(max(bright, 2.0**-LARGEST_EV)))

    def set_lamp_ev(self, value: float) -> None:
        """Set it; successive changes are undone as one."""
        number = self._board.selected
        if number is not None:
            self.change_lamp(number, brightness=f"{value:.2f}EV", merge=("brightness", number))

    def save_lamps(self, path: str | os.PathLike[str]) -> None:
        """Write the lamps as JSON, which `--lamp` reads. Raises InputError without lamps."""
        board, bench = self._board, self.bench
        assert bench is not None
        asked = [lamp.asked for lamp in board.state.lamps]
        about = bench.source.command.format(lamps=os.path.basename(path), captured=f"{board.state.captured:g}")
        write_lamps(path, asked, bench.source.scale(), about)
        board.saved()

    def _checked(self, asked: AskedLamp) -> AskedLamp:
        """The lamp, if it can be lit. Raises InputError for one too bright."""
        board, bench = self._board, self.bench
        assert board is not None and bench is not None
        for each in (asked, without_color(asked)):
            resolve(each, bench.source.scale())
        return asked

    @property
    def _kept(self) -> Timeline:
        if not self.timeline.kept:
            raise InputError(_NOT_HERE)
        return self.timeline

    @property
    def _board(self) -> LampBoard:
        if self.board is None:
            raise InputError(_NOT_HERE)
        return self.board

    def _edited(self) -> None:
        """The work after a change."""


def bulb_at(position: Triple) -> AskedLamp:
    """The lamp that a click adds: a warm bulb, as bright as `--lamp x,y,z`."""
    return asked_lamps([",".join(repr(float(each)) for each in position)])[0]


def _brighter(asked: AskedLamp, stops: float) -> AskedLamp:
    """The lamp with 2^stops times its light."""
    if not np.isfinite(stops):
        raise InputError(f"stops must be a finite number, found {stops}")
    value, unit = asked.brightness.value, asked.brightness.unit
    with np.errstate(over="ignore"):
        more = value + stops if unit == "EV" else float(np.float64(value) * np.exp2(stops))
    return replace(asked, brightness=Brightness(more, unit))
