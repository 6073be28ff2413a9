"""Light turned about any axis, `--rotate 45:x,y,z`: by the image, by harmonics, and through the command."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from viewer_scenes import ball_on_plate

from relight import Environment, LightingOptions
from relight.cli import angles_from, axis_from, main
from relight.jobs.job import Job
from relight.request import RelightRequest
from relight.sh import rotors
from splat2mesh.base.errors import InputError

AXIS, ANGLE_DEG = (1.0, 2.0, -0.5), 70.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("turned") / "ball"
    ball_on_plate().save(path)
    return path


def relit(folder, out, *words):
    given = [str(folder), "--env", "studio", "--method", "analytic", "--bands", "3", "--albedo", "captured", "-q"]
    code = main([*given, "--format", "npy", "--no-cache", "-o", str(out), *words])
    return code, None if code else (np.load(out / "radiance.npy"), json.loads((out / "report.json").read_text()))


def test_the_radiance_of_a_direction_is_that_of_the_direction_turned_back():
    light = Environment.load("studio").rotated(30.0)
    directions = np.random.default_rng(0).normal(size=(2000, 3))
    turn = Rotation.from_rotvec(np.radians(ANGLE_DEG) * np.array(AXIS) / np.linalg.norm(AXIS))
    found = light.turned_about(AXIS, ANGLE_DEG)
    expected = light.lookup(turn.inv().apply(directions))
    # An edge of a softbox is half a texel softer: .5% of all.
    assert np.linalg.norm(found.lookup(directions) - expected) < 0.01 * np.linalg.norm(expected)
    turned = rotors.rotate(light.sh(6), rotors.from_axis_angle(AXIS, np.radians(ANGLE_DEG)))
    assert np.linalg.norm(found.sh(6) - turned) < 1e-3 * np.linalg.norm(turned)
    np.testing.assert_allclose(found.sh(1), light.sh(1), rtol=1e-6)  # the mean is the same


def test_a_sun_of_one_texel_keeps_its_light_and_comes_from_where_it_is_turned_to():
    image = np.zeros((64, 128, 3), np.float32)
    image[20, 30] = 1e4
    light = Environment(image)
    moment = light.sh(2)[[3, 1, 2], 1]
    turn = Rotation.from_rotvec(np.radians(200.0) * np.array(AXIS) / np.linalg.norm(AXIS))
    found = light.turned_about(np.array(AXIS) * 1e200, 200.0)  # of any length
    np.testing.assert_allclose(found.sh(1), light.sh(1), rtol=1e-6)
    # A texel of the turned image takes it up in quarters, within a tenth of 2.8 degrees.
    np.testing.assert_allclose(found.sh(2)[[3, 1, 2], 1], turn.apply(moment), atol=5e-3 * np.linalg.norm(moment))


def test_across_the_seam_and_the_poles_nothing_is_lost():
    light = Environment(np.full((16, 32, 3), 0.7, np.float32))
    np.testing.assert_allclose(light.turned_about((1, 1, 0), 123.0).radiance, 0.7, rtol=1e-6)


def test_about_the_vertical_it_is_the_plain_turn_to_the_bit(folder, tmp_path):
    _, (plain, _) = relit(folder, tmp_path / "plain", "--rotate", "45")
    for words in ("45:0,1,0", "45:0,3e5,0", "-45:0,-1,0"):
        _, (found, report) = relit(folder, tmp_path / words[:6].replace(":", ""), "--rotate", words, "--overwrite")
        np.testing.assert_array_equal(found, plain)
        assert report["angle_deg"] == 45.0 and report["turned"] is None
    light = Environment.load("sunset")
    np.testing.assert_array_equal(light.turned_about((0, 2, 0), 33.3).sh(9), light.rotated(33.3).sh(9))


def test_the_command_lights_by_the_turned_light_and_reports_it(folder, tmp_path):
    code, (found, report) = relit(folder, tmp_path / "out", "--rotate", "70:1,2,-.5")
    assert code == 0
    assert report["turned"] == {"axis": list(AXIS), "angle_deg": ANGLE_DEG} and report["angle_deg"] == 0.0
    assert report["environment"]["name"] == "studio_70_about_1,2,-0.5"
    light = Environment.load("studio").turned_about(AXIS, ANGLE_DEG)
    lighting = LightingOptions("analytic", bands=3)
    (shaded,) = Job(RelightRequest(folder, light, lighting, albedo="captured", caching="none")).shaded()
    np.testing.assert_array_equal(found, shaded.shading.radiance)
    _, (plain, _) = relit(folder, tmp_path / "plain")
    assert np.linalg.norm(found - plain) > 0.1 * np.linalg.norm(plain)


@pytest.mark.parametrize(
    "words", ["45:0,0,0", "45:nan,0,0", "45:inf,1,0", "45:1,0", "45:a,b,c", "0:90:45:1,0,0", ":1,0,0"]
)
def test_what_is_no_axis_is_refused_in_one_line(folder, tmp_path, capsys, words):
    code, _ = relit(folder, tmp_path / "out", "--rotate", words)
    said = capsys.readouterr().err
    assert code == 2 and said.count("\n") == 1 and "--rotate " in said
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError):
        angles_from(words)


@pytest.mark.parametrize("light", [["--env", "captured"], ["--sun", "2026-06-21T12:00+02:00", "--at", "48,2"]])
def test_lights_that_cannot_turn_so_are_refused_in_one_line(folder, tmp_path, capsys, light):
    code = main([str(folder), *light, "--rotate", "45:1,0,0", "-o", str(tmp_path / "out"), "-q"])
    assert code == 2 and capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_plain_words_have_no_axis():
    assert axis_from("45") is None and axis_from("0:350:10") is None
    assert axis_from("45:1,0,-2") == (1.0, 0.0, -2.0) and angles_from("405:1,0,-2") == [45.0]
