"""Undo over several histories: always the last change, whichever it was of."""

import numpy as np
import pytest

from relight.viewer.history import Timeline


@pytest.mark.parametrize("seed", range(20))
def test_any_row_of_changes_undoes_and_redoes_as_a_list_of_all_states_would(seed):
    rng = np.random.default_rng(seed)
    timeline = Timeline()
    for name in range(3):
        timeline.begin(name, 0)
    states, at = [(0, 0, 0)], 0  # the oracle: all states together
    for number in range(1, 200):
        what = rng.integers(5)
        if what < 2:
            which = int(rng.integers(3))
            timeline.to(which, number)
            states = [*states[: at + 1], tuple(number if i == which else s for i, s in enumerate(states[at]))]
            at += 1
        elif what == 2:
            timeline.reset()
            if states[at] != (0, 0, 0):
                states = [*states[: at + 1], (0, 0, 0)]
                at += 1
        elif what == 3:
            assert timeline.undo() == (at > 0)
            at = max(at - 1, 0)
        else:
            assert timeline.redo() == (at < len(states) - 1)
            at = min(at + 1, len(states) - 1)
        assert tuple(timeline.present(name) for name in range(3)) == states[at]


def test_changes_in_a_row_are_one_unless_something_came_between():
    timeline = Timeline()
    timeline.begin("one", "a")
    timeline.begin("other", "x")
    for state in "bcd":
        timeline.to("one", state, "drag")
    timeline.to("other", "y")
    timeline.to("one", "e", "drag")
    timeline.end_merge()
    timeline.to("one", "f", "drag")
    seen = []
    while timeline.undo():
        seen.append(timeline.present("one") + timeline.present("other"))
    assert seen == ["ey", "dy", "dx", "ax"]
    assert timeline._at == 0


def test_nothing_to_undo():
    assert not Timeline().undo() and not Timeline().redo() and not Timeline().kept
