"""Lamps that are saved are read back as the same light."""

import json

import numpy as np
import pytest

from relight.lamps.asked import AskedLamp, Brightness, LampScale, parse_color, resolve
from relight.lamps.photometry import flux
from relight.lamps.shapes import MeshLamp, ProfileLamp, SphereLamp, TubeLamp
from relight.lamps.spec import asked_lamps, color_text, fields_of, read_lamps, write_lamps
from splat2mesh.base.errors import InputError

SCALE = LampScale(1.3, 0.7, 0.01)

TEXTS = (
    "1.5,1.5,-1.5",
    "1.5,1.5,-1.5 radius=.1 color=3000K brightness=+1EV name=by the door",
    "1,2,3 radius=0 color=red brightness=50cd",
    "1,2,3 radius=.2 radiance=70,55,38",
    "1,2,3 intensity=9,8,7",
    "1,2,3 radius=.1 brightness=0lm",
    "spot:0,2.4,0 target=0,0,0 cutoff=25 beam=20 radius=.03 brightness=800lm",
    "rectangle:0,2.4,0 target=0,0,0 width=1.2 height=.6 two_sided=yes color=#ffcc88",
    "tube:-1,2.4,0 to=1,2.4,0",
    "tube:-1,2.4,0 to=1,2.4,0 radius=.02 radiance=3",
)

ANGLES = np.array([0.0, 45.0, 90.0])
TRIANGLE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[0, 1, 2]])


def same(found, expected):
    assert type(found) is type(expected)
    for name, value in vars(expected).items():
        other = getattr(found, name)
        assert (other is None) == (value is None)
        if value is not None:
            # A colour is brought to luminance 1 once more.
            assert np.allclose(np.asarray(other, float), np.asarray(value, float), rtol=4e-16 * 8, atol=0.0), name


def test_every_lamp_is_read_back_as_the_same_light(tmp_path):
    shapes = (
        AskedLamp(SphereLamp((0.0, 1.0, 0.0), 0.1, radiance=(3.0, 2.0, 1.0)), Brightness(1.0, "EV"), (0.5, 1.0, 2.0)),
        AskedLamp(SphereLamp((0.0, 1.0, 0.0), 0.2, (1.0, 1.0, 1.0)), radius_in_metres=True),
        AskedLamp(TubeLamp((0.0, 1.0, 0.0), (1.0, 1.0, 0.0), 0.2, (1.0, 1.0, 1.0)), radius_in_metres=True),
        MeshLamp(*TRIANGLE, np.array([3.0, 2.0, 1.0]), True),
        MeshLamp(*TRIANGLE, np.array([[3.0, 2.0, 1.0]])),
        AskedLamp(MeshLamp(*TRIANGLE, np.array([[3.0, 2.0, 1.0]])), Brightness(-1.0)),
        ProfileLamp((0.0, 2.0, 0.0), (0.0, 0.0, 0.0), (5.0, 4.0, 3.0), ANGLES, np.array([0.0]), np.ones((3, 1)), 30.0),
    )
    lamps = asked_lamps([*TEXTS, *shapes])
    write_lamps(tmp_path / "lamps.json", lamps, SCALE, "a line")
    found = read_lamps(tmp_path / "lamps.json")
    assert [each.name for each in found] == [each.name for each in lamps]
    for each, lamp in zip(found, lamps, strict=True):
        same(resolve(each, SCALE), resolve(lamp, SCALE))
    assert json.loads((tmp_path / "lamps.json").read_text())["about"] == "a line"
    assert np.asarray([flux(resolve(each, SCALE)).sum() > 0.0 for each in found]).sum() == len(found) - 1


@pytest.mark.parametrize("text", TEXTS)
def test_a_lamp_of_words_is_read_back(text, tmp_path):
    (asked,) = asked_lamps([text])
    write_lamps(tmp_path / "lamps.json", [asked])
    (again,) = read_lamps(tmp_path / "lamps.json")
    same(resolve(again, SCALE), resolve(asked, SCALE))


def test_colours_are_read_back():
    rng = np.random.default_rng(3)
    colors = [parse_color(rng.random(3)) for _ in range(200)]
    assert all(parse_color(color_text(color)) == pytest.approx(color, rel=1e-15) for color in colors)
    assert color_text(parse_color("warm")) == "warm" and color_text(parse_color("#ffa500")) == "orange"


def test_a_file_that_cannot_be_written_or_recognised_is_refused(tmp_path):
    with pytest.raises(InputError, match="no lamps"):
        write_lamps(tmp_path / "lamps.json", [])
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        write_lamps(tmp_path / "file" / "lamps.json", asked_lamps(["0,0,0"]))
    mesh = AskedLamp(MeshLamp(*TRIANGLE, np.array([[3.0, 2.0, 1.0]])), Brightness(-1.0))
    with pytest.raises(InputError, match="scale"):
        fields_of(mesh)
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]
