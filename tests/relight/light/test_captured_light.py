"""captured_light.json: what was written is read, a choice stays, and what is damaged is refused in one line."""

import json
from dataclasses import replace

import numpy as np
import pytest

from relight.light.captured_light import (
    NAME,
    CapturedLights,
    LikelyLight,
    LikelySun,
    known_light,
    light_file,
    offer,
    read_environment,
    read_lights,
    write_lights,
)
from relight.light.environment import Environment
from splat2mesh.base.errors import InputError

AFTERNOON = LikelyLight("afternoon", 0.6, LikelySun(210.0, 35.0, (3.0, 2.5, 2.0)), "", 1.2, (1.0, 0.9, 0.8), 0.5, 2.0)
CLOUDY = LikelyLight("cloudy", 0.4, None, "")


def choose(folder, entry):
    write_lights(folder, replace(read_lights(folder / NAME), chosen=entry))


def light(seed, turn=0.0):
    return Environment(np.random.default_rng(seed).random((8, 16, 3), np.float32), "any", turn)


@pytest.fixture
def folder(tmp_path):
    offer(tmp_path, [(AFTERNOON, light(1)), (CLOUDY, light(2, 30.0))])
    return tmp_path


def test_what_was_offered_is_read_back(folder):
    lights = read_lights(folder / NAME)
    assert lights.chosen is None and write_lights(folder, lights).name == NAME and read_lights(folder / NAME) == lights
    for found, wanted, environment in zip(
        lights.candidates, (AFTERNOON, CLOUDY), (light(1), light(2, 30.0)), strict=True
    ):
        assert replace(found, environment="") == wanted
        back = read_environment(folder / found.environment, found.name)
        np.testing.assert_array_equal(back.radiance, environment.radiance)
        assert back.rotation_deg == environment.rotation_deg and back.name == found.name
    assert list(json.loads((folder / NAME).read_text())) == ["schema_version", "chosen", "candidates"]


def test_the_chosen_light_is_used_until_it_is_ignored_or_no_more(folder):
    assert known_light(None, folder) is None
    first, second = read_lights(folder / NAME).candidates
    choose(folder, second)
    assert known_light(None, folder).rotation_deg == 30.0 and known_light(None, folder).name == "cloudy"
    assert known_light("auto", folder) is None
    np.testing.assert_array_equal(known_light(1, folder).radiance, light(1).radiance)
    np.testing.assert_array_equal(known_light(folder / NAME, None).radiance, light(2).radiance)
    np.testing.assert_array_equal(known_light(folder / first.environment, None).radiance, light(1).radiance)
    given = light(3)
    assert known_light(given, folder) is given
    choose(folder, None)
    assert known_light(None, folder) is None and read_lights(folder / NAME).candidates == (first, second)
    assert known_light(folder / NAME, None).name == "afternoon"  # the likeliest


def test_a_choice_survives_another_offer_and_nothing_else_does(folder):
    second = read_lights(folder / NAME).candidates[1]
    choose(folder, second)
    offer(folder, [(AFTERNOON, light(5))])
    lights = read_lights(folder / NAME)
    assert lights.chosen == second and len(lights.candidates) == 1
    assert {each.name for each in folder.iterdir()} == {NAME, second.environment, lights.candidates[0].environment}


def test_other_files_of_light_may_be_named(folder):
    OpenEXR = pytest.importorskip("OpenEXR")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": light(4).radiance}).write(str(folder / "mine.exr"))
    choose(folder, replace(CLOUDY, environment="mine.exr"))
    np.testing.assert_array_equal(known_light(None, folder).radiance, light(4).radiance)
    assert light_file(folder / "mine.exr", None) == (folder / "mine.exr", "mine", False)


def test_a_scene_without_lights_has_none(tmp_path):
    assert known_light(None, tmp_path) is None and known_light(None, None) is None
    assert known_light(None, tmp_path / "mesh.ply") is None


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"schema_version": 2}, "schema version 2, expected 1"),
        ({"candidates": None}, 'expected {"schema_version": 1'),
        ({"candidates": [3]}, "candidate 1: expected an object"),
        ({"chosen": []}, "chosen: expected an object"),
        ({"name": ""}, "candidate 1: name: expected a text"),
        ({"share": 1.5}, "share: expected a number from 0 to 1, found 1.5"),
        ({"share": float("nan")}, "share: expected a number from 0 to 1"),
        ({"share": True}, "share: expected a number"),
        ({"brightness": -1}, "brightness: expected a number from 0 up, found -1"),
        ({"tint": [1, 2]}, "tint: expected three numbers"),
        ({"tint": [1, 2, "x"]}, "tint: expected a number"),
        ({"sun": 3}, "sun: expected null or an object"),
        ({"sun": {"azimuth_deg": 3}}, "sun: height_deg: expected a number from 0 to 90"),
        ({"sun": {"azimuth_deg": 3, "height_deg": 4}}, "sun: irradiance: expected three numbers"),
        ({"environment": "../other.exr"}, "lies outside its folder"),
        ({"environment": None}, "lies outside its folder"),
    ],
)
def test_damaged_content_is_refused_in_one_line(changes, problem, folder):
    content = json.loads((folder / NAME).read_text())
    of_file = changes.keys() & content.keys()
    (content if of_file else content["candidates"][0]).update(changes)
    (folder / NAME).write_text(json.dumps(content))
    with pytest.raises(InputError) as caught:
        read_lights(folder / NAME)
    assert problem in str(caught.value) and "\n" not in str(caught.value) and NAME in str(caught.value)


@pytest.mark.parametrize(
    ("choice", "problem"),
    [
        (3, "holds 2 candidates"),
        ("nowhere.exr", "no such file"),
        ("nowhere.json", "no such file"),
    ],
)
def test_lights_that_are_not_there(choice, problem, folder):
    with pytest.raises(InputError, match=f"`captured_light` {choice}.*{problem}"):
        known_light(choice, folder)


def test_a_number_needs_an_offer(tmp_path):
    for folder in (tmp_path, None):
        with pytest.raises(InputError, match=r"`captured_light` 1: .* holds no captured_light\.json"):
            known_light(1, folder)


def test_damaged_files_are_refused_in_one_line(folder):
    entry = read_lights(folder / NAME).candidates[0]
    for data in (b"", b"PK\x03\x04 no", (folder / entry.environment).read_bytes()[:200]):
        (folder / "bad.npz").write_bytes(data)
        with pytest.raises(InputError, match=r"bad\.npz is damaged"):
            known_light(folder / "bad.npz", None)
    np.savez(folder / "bad.npz", radiance=np.zeros((2, 4), np.float32), rotation_deg=0.0)
    with pytest.raises(InputError, match=r"\(H, W, 3\)"):
        known_light(folder / "bad.npz", None)
    np.savez(folder / "bad.npz", radiance=np.zeros((2, 4, 3), np.int32), rotation_deg=0.0)
    with pytest.raises(InputError, match="expected a float image"):
        known_light(folder / "bad.npz", None)
    (folder / entry.environment).unlink()
    with pytest.raises(InputError, match="no such file"):
        known_light(1, folder)
    (folder / NAME).write_text("{")
    with pytest.raises(InputError, match=r"not valid JSON.*or ignore it with `captured_light` auto"):
        known_light(None, folder)
    assert known_light("auto", folder) is None


def test_what_cannot_be_read_back_is_not_written(folder):
    before = (folder / NAME).read_bytes()
    for entry in (
        replace(CLOUDY, environment="nowhere.exr"),
        replace(CLOUDY, environment="../x.exr"),
        replace(CLOUDY, environment=read_lights(folder / NAME).candidates[0].environment, share=2.0),
    ):
        with pytest.raises(InputError):
            choose(folder, entry)
    assert (folder / NAME).read_bytes() == before
    with pytest.raises(InputError, match="cannot write"):
        write_lights(folder / NAME, CapturedLights())  # a file where the folder should be
