"""What a person says of the captured light on the command line: to which sun a place belongs, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from viewer_scenes import ball_on_plate

from relight import Environment
from relight.arguments import parser
from relight.cli import main, request_of
from relight.light.captured_light import NAME, LikelyLight, offer, read_lights, write_lights
from relight.light.daylight import captured_sun
from relight.request import RelightRequest
from splat2mesh.base.errors import InputError

TIME, PARIS, SYDNEY = "2026-06-21T15:00+02:00", "48.85,2.35", "-33.9,151.2"
SUNRISE = "2026-06-21T08:30+10:00"  # in Sydney


def understood(*words):
    return request_of(parser().parse_args(["scene", *words]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A saved scene that stands for one made of a splat, with two likely lights."""
    path = tmp_path_factory.mktemp("words") / "ball"
    ball_on_plate().save(path)
    offer_two(path)
    return path


def offer_two(path):
    lights = [(LikelyLight(name, 0.5, None, ""), Environment.load(name)) for name in ("noon", "overcast")]
    offer(path, lights)


def tree(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_place_belongs_to_the_sun_before_it():
    asked = understood("--sun", TIME, "--at", PARIS, "--captured-sun", SUNRISE, "--at", SYDNEY, "--north", "20")
    assert asked.at == PARIS and asked.env.latitude_deg == 48.85
    assert asked.north_deg == 20.0  # the scene has one north
    assert asked.lighting.captured_sun == captured_sun(f"{SUNRISE} at={SYDNEY} north=20")
    turned = understood("--captured-sun", SUNRISE, "--at", SYDNEY, "--north", "20", "--sun", TIME, "--at", PARIS)
    assert (turned.at, turned.lighting.captured_sun) == (PARIS, asked.lighting.captured_sun)


def test_two_suns_of_one_place_need_it_once():
    expected = captured_sun(f"{TIME} at={PARIS} north=7")
    place = "--at", PARIS, "--north", "7"
    for words in (
        ("--sun", TIME, *place, "--captured-sun", TIME),
        ("--captured-sun", TIME, *place, "--sun", TIME),
        (*place, "--captured-sun", TIME, "--sun", TIME),
    ):
        asked = understood(*words)
        assert (asked.lighting.captured_sun, asked.at, asked.north_deg) == (expected, PARIS, 7.0)
    alone = understood(*place, "--captured-sun", TIME)
    assert (alone.lighting.captured_sun, alone.at, alone.env) == (expected, "", "studio")
    asked = understood("--sun", TIME, *place, "--captured-sun", "-150,35")  # angles need no place, but the north
    assert asked.lighting.captured_sun == captured_sun("-150,35 north=7")


def test_a_place_of_an_object_or_a_probe_stays_theirs():
    asked = understood("--captured-sun", TIME, "--at", PARIS, "--insert", "x.glb", "--at", "1,2,3", "--on", "floor")
    assert asked.inserted == ("x.glb at=1,2,3 on=floor",) and asked.at == ""
    asked = understood("--captured-sun", TIME, "--at", PARIS, "--format", "probe", "--at", "1,2,3")
    assert asked.probe_at == ((1.0, 2.0, 3.0),)


def test_sky_and_light_are_kept():
    asked = understood("--captured-sky", "Overcast", "--captured-light", "2").lighting
    assert (asked.captured_sky, asked.captured_light) == ("overcast", 2)
    assert understood("--captured-light", "auto").lighting.said == ()
    assert RelightRequest.of("scene", captured_sky="shade").lighting.captured_sky == "shade"


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--captured-sun", "noon"], "--captured-sun noon: expected a time with its zone and a place"),
        (
            ["--captured-sun", TIME],
            "--captured-sun 2026-06-21T15:00+02:00: give the latitude and longitude too, as --at",
        ),
        (["--captured-sun", "2026-06-21T15:00", "--at", PARIS], "has no zone"),
        (["--captured-sun", TIME, "--at", "98,2"], "a latitude must be from -90 to 90"),
        (["--captured-sun", "2026-06-21T01:00+02:00", "--at", PARIS], "below the horizon"),
        (["--captured-sun", "210,-5"], "expected a height above the horizon"),
        (["--captured-sun", "210,35", "--at", PARIS], "need no --at"),
        (["--at", PARIS, "--captured-sun", "210,35"], "--at: it belongs to the --sun of a date"),
        (["--captured-sky", "cler"], "--captured-sky cler: expected one of clear hazy overcast shade night; did you"),
        (["--captured-sky", "no.exr"], "--captured-sky no.exr: expected clear"),
        (["--captured-light", "3"], "--captured-light 3: "),
        (["--captured-light", "0"], "--captured-light 0: expected the number"),
        (["--captured-light", "no.json"], "--captured-light no.json: no such file"),
        (
            ["--captured-light", "1", "--capture-env", "noon"],
            "--captured-light: it is a known light as --capture-env is",
        ),
        (["--captured-light", "1", "--albedo", "white"], "--captured-light: it needs an estimated albedo"),
    ],
)
def test_bad_words_are_one_line_and_nothing_is_written(words, problem, folder, tmp_path, capsys):
    before = tree(folder)
    out = tmp_path / "out"
    assert main([str(folder), "--format", "npy", "--env", "noon", "-o", str(out), "-q", *words]) == 2
    error = capsys.readouterr().err
    assert problem in error and error.count("\n") == 1
    assert tree(folder) == before and not out.exists()


def test_the_chosen_light_is_used_and_results_know_it(folder, tmp_path, capsys):
    quick = [str(folder), "--format", "npy", "--env", "sunset", "--tolerance", ".1", "--no-cache", "-q"]
    results = {}
    first, _ = read_lights(folder / NAME).candidates
    for name, chosen, words in (
        ("estimated", None, []),
        ("given", None, ["--capture-env", "noon"]),
        ("number", None, ["--captured-light", "1"]),
        ("chosen", first, []),
        ("ignored", first, ["--captured-light", "auto"]),
    ):
        offer_two(folder)  # an estimate offers its own
        write_lights(folder, replace(read_lights(folder / NAME), chosen=chosen))
        assert main([*quick, "-o", str(tmp_path / name), *words]) == 0
        results[name] = np.load(tmp_path / name / "radiance.npy")
    same = [name for name in results if np.array_equal(results[name], results["given"])]
    assert same == ["given", "number", "chosen"]
    np.testing.assert_array_equal(results["ignored"], results["estimated"])
    report = json.loads((tmp_path / "chosen" / "report.json").read_text())
    assert report["settings"]["captured_light"]["name"] == "noon"
    capsys.readouterr()
    assert main([*quick, "-o", str(tmp_path / "estimated")]) == 2  # whose light was estimated
    write_lights(folder, replace(read_lights(folder / NAME), chosen=None))
    assert "--captured-light not given, now noon" in capsys.readouterr().err


def test_a_damaged_choice_is_one_line(tmp_path, capsys):
    ball_on_plate().save(tmp_path / "ball")
    (tmp_path / "ball" / NAME).write_text("{")
    words = [str(tmp_path / "ball"), "--format", "npy", "--env", "noon", "-o", str(tmp_path / "out"), "-q"]
    assert main(words) == 2
    assert "or ignore it with --captured-light auto" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_a_known_light_is_said_once():
    with pytest.raises(InputError, match="`captured_light`: it is a known light"):
        RelightRequest.of("scene", capture_env="noon", captured_light=1)
