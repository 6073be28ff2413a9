"""The lists of kernels that a first run compiles ahead name what a run asks for."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))

import kernel_lists
from scenes.__main__ import main as make_scene

ROOT = Path(__file__).parents[2]


def test_runs_are_merged_in_the_order_of_need():
    first = [("a", ["x"], 1.0), ("b", ["x"], 1.0), ("d", ["x"], 1.0)]
    second = [("a", ["x"], 2.0), ("c", ["x"], 2.0), ("a", ["y"], 2.0), ("d", ["x"], 2.0), ("e", ["x"], 2.0)]
    found = kernel_lists.merged([first, second])
    assert [name + kinds[0] for name, kinds, *_ in found] == ["ax", "cx", "ay", "bx", "dx", "ex"]
    assert [runs for *_, runs in found] == [2, 1, 1, 1, 2, 1]


def test_a_list_holds_each_type_once_and_leaves_out_what_has_no_text(tmp_path, capsys):
    rows = [("m.a", ["int64", ["tuple", "int64"]], 0.126, 2), ("m.b", "no text for it", 1.0, 1), ("m.c", ["int64"], 1.0, 1)]
    kernel_lists.write(tmp_path / "list.json", rows)
    found = json.loads((tmp_path / "list.json").read_text())
    assert found == {"types": ["int64", ["tuple", "int64"]], "kernels": [["m.a", [0, 1], 0.13, 2], ["m.c", [0], 1.0, 1]]}
    assert "left out m.b" in capsys.readouterr().err


@pytest.mark.slow
def test_a_small_run_asks_for_listed_kernels_alone(tmp_path):
    """Fails where kernels, their types or their order changed: run scripts/kernel_lists.py again."""
    assert make_scene([str(tmp_path / "truth"), "--kind", "object", *kernel_lists.SMALL]) == 0
    runs = {
        "splat2mesh": [tmp_path / "truth" / "splat.ply", "-o", tmp_path / "scene", *kernel_lists.COARSE],
        "relight": [tmp_path / "scene", "--env", "sunset"],
    }
    for command, words in runs.items():
        content = json.loads((ROOT / command / kernel_lists.LIST).read_text())
        known = [(name, [content["types"][place] for place in places]) for name, places, *_ in content["kernels"]]
        asked = [(name, kinds) for name, kinds, _ in kernel_lists.recorded(command, *words)]
        assert [row for row in asked if list(row) not in [list(each) for each in known]] == []
