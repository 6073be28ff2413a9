"""Parts in the folder of a scene: written with a name each, found by it, and damaged files in one line."""

import json

import numpy as np
import pytest

from relight.splats.kept_parts import NAME, keep_part, kept_parts, with_files
from relight.splats.lit_part import LitPart, with_kept_lights
from splat2mesh.base.errors import InputError

MASK = np.arange(9) % 3 == 0


def test_what_is_kept_is_found_by_its_name(tmp_path):
    assert kept_parts(tmp_path) == {}
    assert [keep_part(tmp_path, MASK), keep_part(tmp_path, ~MASK)] == ["part1", "part2"]
    found = kept_parts(tmp_path)
    np.testing.assert_array_equal(np.load(found["part2"].file), ~MASK)
    assert with_files(["part1", "box:at=0,0,0,size=1,1,1", MASK], tmp_path)[0] == str(tmp_path / "part1.npy")
    assert with_files(["part1", "part7"], tmp_path / "elsewhere") == ("part1", "part7")


def test_a_part_keeps_a_light_of_its_own(tmp_path):
    keep_part(tmp_path, MASK, {"env": "lamp.exr", "exposure": 1})
    (tmp_path / "lamp.exr").write_text("")
    (found,) = with_kept_lights(("part1 exposure=2 tint=3000K",), tmp_path)
    mask, light = str(tmp_path / "part1.npy"), str(tmp_path / "lamp.exr")
    assert found == {"part": mask, "env": light, "exposure": "2", "tint": "3000K"}
    part = LitPart.parse(found | {"env": "noon"})
    assert (part.env.name, part.exposure_ev, part.words) == ("noon", 2.0, mask)
    assert with_kept_lights(({"part": MASK, "exposure": 1},), tmp_path)[0]["part"] is MASK


def test_a_name_may_be_changed_and_is_not_taken_twice(tmp_path):
    keep_part(tmp_path, MASK)
    path = tmp_path / NAME
    path.write_text(path.read_text().replace('"part1"', '"the chair"'))
    assert keep_part(tmp_path, ~MASK) == "part2"  # whose file is another
    assert with_files(["the chair", "part2"], tmp_path) == (str(tmp_path / "part1.npy"), str(tmp_path / "part2.npy"))


def test_a_file_of_that_name_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    keep_part(tmp_path, MASK)
    (tmp_path / "part1").write_text("0 1")
    assert with_files(["part1"], tmp_path) == ("part1",)


def test_an_empty_part_is_refused(tmp_path):
    with pytest.raises(InputError, match="no splats"):
        keep_part(tmp_path, np.zeros(4, bool))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "content",
    [
        "{", "[]", '{"schema_version": 2, "parts": []}', '{"schema_version": 1, "parts": [{"name": "a"}]}',
        json.dumps({"schema_version": 1, "parts": [{"name": "a", "file": "../a.npy", "splats": 3}]}),
        json.dumps({"schema_version": 1, "parts": [{"name": "a", "file": "a.npy", "splats": 3, "light": 1}]}),
    ],
)  # fmt: skip
def test_a_damaged_file_is_one_line(tmp_path, content):
    (tmp_path / NAME).write_text(content)
    with pytest.raises(InputError, match=NAME):
        kept_parts(tmp_path)
