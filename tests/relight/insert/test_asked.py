"""What a person asks to have put in, in words, files and values."""

import json

import numpy as np
import pytest

from relight.arguments import parser
from relight.cli import request_of
from relight.insert.asked import AskedInsert, asked_inserts, described
from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh


@pytest.fixture
def statue(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a statue.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return "a statue.obj"


def test_words_layouts_and_values_ask_for_the_same(statue, tmp_path):
    (asked,) = asked_inserts([f"{statue} at=1.5,0,-.6 turn=30 scale=2 on=floor albedo=.5"])
    layout = {"file": statue, "at": [1.5, 0, -0.6], "turn": 30, "scale": 2, "on": "floor", "albedo": 0.5}
    for content in ([layout], {"objects": [layout]}):
        (tmp_path / "layout.json").write_text(json.dumps(content))
        (other,) = asked_inserts(["layout.json"])
        assert described(other) == described(asked)
    value = AskedInsert(statue, (1.5, 0, -0.6), 30, 2, "floor", (0.5, 0.5, 0.5))
    assert described(asked_inserts([value])[0]) == described(asked)


def test_options_belong_to_the_object_before_them(statue):
    line = ["garden", "--insert", statue, "--at", "-1.5,0,-.6", "--turn", "-30", "--insert", statue, "--at", "0,0,1"]
    request = request_of(parser().parse_args([*line, "--scale", "2", "--on", "floor"]))
    first, second = asked_inserts(request.inserted)
    assert (first.at, first.turn_deg, first.scale, first.on) == ((-1.5, 0.0, -0.6), -30.0, None, None)
    assert (second.at, second.turn_deg, second.scale, second.on) == ((0.0, 0.0, 1.0), 0.0, 2.0, "floor")
    assert request.env == "captured"


def test_two_numbers_after_at_are_where_the_sun_shines(statue):
    line = ["garden", "--insert", statue, "--at", "0,0,1", "--sun", "2026-06-21T19:30+02:00", "--at", "48.85,2.35"]
    request = request_of(parser().parse_args(line))
    assert request.at == "48.85,2.35"
    assert asked_inserts(request.inserted)[0].at == (0.0, 0.0, 1.0)


def test_three_numbers_that_no_object_takes_are_where_a_probe_stands(statue):
    line = ["garden", "--format", "probe", "--at", "-1,2,3", "--insert", statue, "--at", "0,0,1", "--at", "4,5,6"]
    request = request_of(parser().parse_args(line))
    assert request.probe_at == ((-1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    assert asked_inserts(request.inserted)[0].at == (0.0, 0.0, 1.0)
    with pytest.raises(InputError, match="belongs to the format probe"):
        request_of(parser().parse_args(["garden", "--at", "-1,2,3"]))


@pytest.mark.parametrize("option", ["--turn", "--scale", "--on"])
def test_an_option_without_an_object_is_refused(option, capsys):
    with pytest.raises(SystemExit) as ended:
        parser().parse_args(["garden", option, "1,2,3"])
    assert ended.value.code == 2
    assert "needs an --insert before it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing.glb at=0,0,0", "no such file"),
        ("at=0,0,0", "expected a file first"),
        ("a statue.obj", "at: missing"),
        ("a statue.obj at=0,0", "expected three numbers"),
        ("a statue.obj at=0,0,nan", "expected three numbers"),
        ("a statue.obj at=0,0,0 at=1,1,1", "given twice"),
        ("a statue.obj at=0,0,0 scale=0", "above 0"),
        ("a statue.obj at=0,0,0 scale=-1", "above 0"),
        ("a statue.obj at=0,0,0 on=wall", "expected floor"),
        ("a statue.obj at=0,0,0 albedo=2", "from 0 to 1"),
        ("a statue.obj at=0,0,0 size=3", "expected some of"),
        ("layout.json at=0,0,0", "a layout sets the positions"),
        ("broken.json", "not valid JSON"),
        ("empty.json", "expected a list"),
        ("lost.json", "no such file beside"),
        ("out.json", "lies outside"),
    ],
)
def test_what_makes_no_sense_is_one_line(text, message, statue, tmp_path):
    (tmp_path / "layout.json").write_text(json.dumps([{"file": statue, "at": [0, 0, 0]}]))
    (tmp_path / "broken.json").write_text("[")
    (tmp_path / "empty.json").write_text("[]")
    (tmp_path / "lost.json").write_text(json.dumps([{"file": "lost.glb", "at": [0, 0, 0]}]))
    (tmp_path / "out.json").write_text(json.dumps([{"file": "../out.glb", "at": [0, 0, 0]}]))
    with pytest.raises(InputError, match=message) as raised:
        asked_inserts([text])
    assert "\n" not in str(raised.value)


def test_a_mesh_in_memory_is_an_object_and_numbers_are_none():
    mesh = Mesh(np.eye(3, dtype=np.float32), np.eye(3, dtype=np.float32), np.int32([[0, 1, 2]]), np.zeros((3, 3), "u1"))
    assert asked_inserts([mesh])[0].name == "mesh"
    with pytest.raises(InputError, match="expected a file"):
        asked_inserts([3])
