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
    third = [("c", ["x"], 3.0), ("d", ["x"], 3.0), ("e", ["x"], 3.0)]
    found = kernel_lists.merged({"object": first, "garden": second, "room": third})
    assert [name + kinds[0] for name, kinds, *_ in found] == ["ax", "cx", "ay", "bx", "dx", "ex"]
    assert [asked_by for *_, asked_by in found] == ["some", "place", "some", "object", "every", "place"]


def test_a_list_holds_each_type_once_and_leaves_out_what_has_no_text(tmp_path, capsys):
    rows = [
        ("m.a", ["int64", ["tuple", "int64"]], 0.126, "every"),
        ("m.b", "no text", 1.0, "some"),
        ("m.c", ["int64"], 1.0, "place"),
    ]
    kernel_lists.write(tmp_path / "list.json", rows)
    found = json.loads((tmp_path / "list.json").read_text())
    assert found["types"] == ["int64", ["tuple", "int64"]]
    assert found["kernels"] == [["m", "a", [0, 1], 0.13, "every"], ["m", "c", [0], 1.0, "place"]]
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
        known = [
            (f"{module}.{name}", [content["types"][place] for place in places])
            for module, name, places, *_ in content["kernels"]
        ]
        asked = [(name, kinds) for name, kinds, _ in kernel_lists.recorded(command, *words)]
        assert [row for row in asked if list(row) not in [list(each) for each in known]] == []
