"""Undo and redo of lamps, without light and window."""

import numpy as np
import pytest

from relight.lamps.asked import AskedLamp, Brightness
from relight.lamps.shapes import SphereLamp
from relight.lamps.spec import asked_lamps
from relight.viewer.lamps import MOST_CAPTURED, LampBoard, place_of
from splat2mesh.base.errors import InputError


def bulb(*position):
    return AskedLamp(SphereLamp(position, intensity=(1.0, 1.0, 1.0)), Brightness(1.0, "picture"))


def test_random_changes_are_undone_and_done_again_one_by_one():
    """The states on the way back are those on the way there, as the same objects."""
    rng, board = np.random.default_rng(1), LampBoard([bulb(0.0, 0.0, 0.0)], 0.5)
    passed = [board.state]
    for _ in range(300):
        numbers, kind = [lamp.number for lamp in board.state.lamps], rng.integers(6)
        if kind == 0 or not numbers:
            board.add(bulb(*rng.random(3)))
        elif kind == 1:
            board.remove(int(rng.choice(numbers)))
        elif kind == 2:
            board.move(int(rng.choice(numbers)), tuple(rng.random(3)))
        elif kind == 3:
            board.put(int(rng.choice(numbers)), bulb(*rng.random(3)))
        elif kind == 4:
            board.dim(rng.random())
        else:
            board.select(int(rng.choice(numbers)))
            continue
        passed.append(board.state)
    assert board.timeline._at == len(passed) - 1
    for expected in reversed(passed[:-1]):
        assert board.timeline.undo() and board.state is expected
        assert board.selected is None or board.state.of(board.selected) is not None
    assert not board.timeline.undo() and board.state is board.start
    for expected in passed[1:]:
        assert board.timeline.redo() and board.state is expected
    assert not board.timeline.redo() and board.state is passed[-1]


def test_a_change_after_undo_drops_what_could_be_done_again():
    board = LampBoard()
    board.add(bulb(1.0, 0.0, 0.0))
    board.timeline.undo()
    assert len(board.timeline._states) - 1 - board.timeline._at == 1
    number = board.add(bulb(2.0, 0.0, 0.0))
    assert len(board.timeline._states) - 1 - board.timeline._at == 0 and number == 2  # numbers are never used twice
    assert place_of(board.asked(number)) == (2.0, 0.0, 0.0)


def test_a_drag_is_one_change():
    board = LampBoard()
    number = board.add(bulb(0.0, 0.0, 0.0))
    for x in (1.0, 2.0, 3.0):
        board.move(number, (x, 0.0, 0.0), merge="drag")
    assert board.timeline._at == 2 and place_of(board.asked(number)) == (3.0, 0.0, 0.0)
    board.timeline.end_merge()
    board.move(number, (4.0, 0.0, 0.0), merge="drag")
    assert board.timeline._at == 3
    board.timeline.undo()
    assert place_of(board.asked(number)) == (3.0, 0.0, 0.0)
    board.move(number, (5.0, 0.0, 0.0), merge="drag")  # does not reach into what was before the undo
    board.timeline.undo()
    assert place_of(board.asked(number)) == (3.0, 0.0, 0.0)


def test_what_changes_nothing_is_no_change():
    board = LampBoard([bulb(0.0, 1.0, 0.0)], 0.5)
    board.move(1, (0.0, 1.0, 0.0))
    board.dim(0.5)
    board.put(1, board.asked(1))
    assert board.timeline._at == 0 and not board.unsaved
    board.dim(99.0)
    assert board.state.captured == MOST_CAPTURED and not board.unsaved  # the lamps are what is saved
    board.remove(1)
    assert board.unsaved and board.selected is None
    board._saved = board.state
    assert not board.unsaved
    board.timeline.undo()
    assert board.unsaved


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("1,2,3", (1.0, 2.0, 3.0)),
        ("spot:1,2,3 target=0,0,0", (1.0, 2.0, 3.0)),
        ("rectangle:1,2,3 target=0,0,0 width=1 height=1", (1.0, 2.0, 3.0)),
        ("tube:0,2,3 to=2,2,3", (1.0, 2.0, 3.0)),
    ],
)
def test_every_kind_moves_by_its_middle(text, place):
    board = LampBoard(asked_lamps([text]))
    assert place_of(board.asked(1)) == place
    board.move(1, (4.0, 4.0, 4.0))
    assert place_of(board.asked(1)) == pytest.approx((4.0, 4.0, 4.0))


def test_what_is_not_there_is_refused():
    board = LampBoard([bulb(0.0, 0.0, 0.0)])
    for act in (board.remove, board.select, board.asked, lambda number: board.move(number, (0.0, 0.0, 0.0))):
        with pytest.raises(InputError, match="lamp 7"):
            act(7)
    for position in ((np.nan, 0.0, 0.0), (0.0, 0.0)):
        with pytest.raises(InputError, match="position"):
            board.move(1, position)
    with pytest.raises(InputError, match="captured"):
        board.dim(np.inf)
    assert board.timeline._at == 0
