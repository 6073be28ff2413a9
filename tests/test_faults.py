"""Both commands with a fault at one of their file operations: nothing lost, half or left behind.

`scripts/bench faults` tries all operations.
"""

import random

import pytest
from fault_cases import CASES, made
from fault_runs import FAULTS, Server, Trial, built, part_of, state_of

RUNS = 1
"""Of each fault in each case; the operations are drawn."""


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("server")
    library = built(folder)
    if library is None:
        pytest.skip("faults are put in by a library that a C compiler makes, on Linux")
    server = Server(library, folder)
    yield server
    server.close()


@pytest.mark.parametrize("name", ["mesh", "light", "more"])
def test_a_fault_anywhere_loses_nothing_and_leaves_nothing(server, tmp_path, name):
    trial, chance = Trial(server, CASES[name], made(tmp_path / "template", name), tmp_path), random.Random(name)
    assert len(trial.operations) > 30
    for fault in FAULTS:
        for at in chance.sample(range(len(trial.operations)), RUNS):
            found = trial.outcome(fault, at)
            assert not found.wrong, (found, trial.operations[at])


def test_of_two_runs_at_once_one_is_refused_or_both_are_done(server, tmp_path):
    made(tmp_path / "run", "new")
    both = server.at_once([(CASES["new"], tmp_path / "run", 0.0)] * 2)
    assert sorted(code for code, _ in both) in ([0, 0], [0, 2]), both
    state = state_of(tmp_path / "run")
    assert "out/report.json" in part_of(state, "out")
    assert not [name for name in state if "unfinished" in name]


@pytest.mark.slow
def test_a_fault_that_loses_something_is_seen(server, tmp_path):
    """What judges the others must see the worst: a half output, a lost file, a wrong code."""
    trial = Trial(server, CASES["mesh"], made(tmp_path / "template", "mesh"), tmp_path)
    half = {name: digest for name, digest in trial.after.items() if name != "out/scene.json"}
    assert list(trial._wrong_state(half, "error")) == ["out is half"]
    assert list(trial._wrong_state({"ball.ply": "other"}, "error")) == ["out is lost", "ball.ply was changed"]
    assert list(trial._wrong_end("full", 0, "", half)) == ["done, and out is not what it should be"]
    assert list(trial._wrong_end("term", 1, "Traceback", half))[:2] == ["exit code 1", "a traceback"]
