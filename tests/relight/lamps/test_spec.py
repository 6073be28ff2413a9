"""relight.lamps.spec and fields: what people type."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from typed_lamps import parse_lamp

from relight.lamps.asked import (
    BULB_M,
    NAMES,
    TEMPERATURES,
    TUBE_M,
    WHITE,
    AskedLamp,
    Brightness,
    LampScale,
    blackbody,
    luminance,
    parse_color,
    resolve,
)
from relight.lamps.fields import EVERY, FIELDS, SHORT, asked_lamp
from relight.lamps.photometry import axis_intensity
from relight.lamps.shapes import MeshLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp
from relight.lamps.spec import parse_lamps
from splat2mesh.base.errors import InputError

SCALE = LampScale(0.5, 2.0)


def test_a_place_alone_is_a_warm_bulb_of_two_stops():
    bulb = parse_lamp("1.5,1.5,-1.5")
    assert bulb.shape == SphereLamp((1.5, 1.5, -1.5), BULB_M, WHITE) and bulb.radius_in_metres
    assert bulb.color == blackbody(2700.0) and bulb.brightness == Brightness(2.0, "EV") and bulb.name == ""
    lamp = resolve(bulb, SCALE)
    assert lamp.radius == pytest.approx(0.025)
    # 4 times the median at 1 m, which is half a unit: pi r^2 L = 4 x 2 x 0.25.
    assert luminance(lamp.radiance) == pytest.approx(2.0 / (np.pi * 0.025**2))


def test_every_word_of_a_bulb():
    bulb = parse_lamp("1.5, 1.5, -1.5 radius=.1 color=3000K brightness=+1EV name=the lamp by the door")
    assert bulb.shape == SphereLamp((1.5, 1.5, -1.5), 0.1, WHITE) and not bulb.radius_in_metres
    assert bulb.color == blackbody(3000.0) and bulb.brightness == Brightness(1.0)
    assert bulb.name == "the lamp by the door"
    assert parse_lamp("0,0,0 brightness=800 lm").brightness == Brightness(800.0, "lumen")
    assert parse_lamp("0,0,0 brightness=50cd").brightness == Brightness(50.0, "candela")


def test_the_examples_of_the_document():
    text = (Path(__file__).parents[3] / "docs/lamps.md").read_text("utf-8")
    (lines,) = re.findall(r"```text\n(.*?)```", text, re.DOTALL)
    typed = [line for line in lines.splitlines() if not re.match(r"\w+\.(ies|glb) ", line)]
    kinds = [type(parse_lamp(line).shape) for line in typed]
    assert kinds == [SphereLamp, SphereLamp, SpotLamp, RectangleLamp, RectangleLamp, TubeLamp]
    (listed,) = re.findall(r"```json\n(.*?)```", text, re.DOTALL)
    lamps = [{name: value for name, value in lamp.items() if name != "type"} for lamp in json.loads(listed)]
    kinds = [lamp["type"] for lamp in json.loads(listed)]
    assert [type(asked_lamp(kind, lamp).shape) for kind, lamp in zip(kinds, lamps, strict=True)] == [
        *(SphereLamp, SpotLamp, RectangleLamp, TubeLamp, MeshLamp)
    ]
    assert all(f"`{name}`" in text for name in (*TEMPERATURES, *NAMES))


@pytest.mark.parametrize("text", ["-1,2,3", "sphere:-1,2,3", "at=-1,2,3", "position=-1,2,3", "  at = -1, 2, 3  "])
def test_ways_to_say_where(text):
    assert parse_lamp(text).shape.position == (-1.0, 2.0, 3.0)


def test_light_in_units_of_the_picture_is_kept():
    lamp = resolve(parse_lamp("1.5,1.5,-1.5 radius=.1 radiance=70,55,38"), SCALE)
    assert lamp.radius == 0.1 and lamp.radiance == pytest.approx((70.0, 55.0, 38.0))
    point = resolve(parse_lamp("0,0,0 intensity=9,8,7"), SCALE)
    assert point.radius == 0.0 and point.intensity == pytest.approx((9.0, 8.0, 7.0))
    ball = resolve(parse_lamp("0,0,0 radius=.1 intensity=9,8,7"), SCALE)
    assert ball.radius == 0.1 and axis_intensity(ball) == pytest.approx((9.0, 8.0, 7.0))
    one = resolve(parse_lamp("0,0,0 radius=.1 radiance=5 color=red"), SCALE)
    assert one.radiance == pytest.approx(5.0 * np.array(parse_color("red")))
    dark = resolve(parse_lamp("0,0,0 radius=.1 radiance=0,0,0"), SCALE)
    assert dark.radiance == (0.0, 0.0, 0.0)


def test_spots():
    spot = parse_lamp("spot:-1.5,2.4,.5 target=-1,0,-.5 intensity=9,9,9 cutoff=25 beam=20")
    lamp = resolve(spot, SCALE)
    assert lamp.intensity == pytest.approx((9.0, 9.0, 9.0))
    assert lamp == SpotLamp((-1.5, 2.4, 0.5), (-1.0, 0.0, -0.5), lamp.intensity, 25.0, 20.0)
    plain = parse_lamp("spot:0,2,0 target=0,0,0").shape
    assert (plain.cutoff_deg, plain.beam_deg, plain.radius) == (30.0, 22.5, 0.0)


@pytest.mark.parametrize("facing", ["target=0,0,0", "normal=0,-2,0", "normal=1,-1,.5", "normal=0,0,1 up=1,1,0"])
def test_rectangles_face_their_target_with_their_width_and_height(facing):
    lamp = parse_lamp(f"rectangle:0,2,0 {facing} width=1.2 height=.6").shape
    u, v = np.array(lamp.edge_u), np.array(lamp.edge_v)
    ahead = {"target=0,0,0": (0, -1, 0), "normal=0,-2,0": (0, -1, 0), "normal=1,-1,.5": (2 / 3, -2 / 3, 1 / 3)}
    assert np.cross(u, v) / 0.72 == pytest.approx(ahead.get(facing, (0, 0, 1)), abs=1e-12)
    assert np.linalg.norm(u) == pytest.approx(1.2) and np.linalg.norm(v) == pytest.approx(0.6)
    assert u @ v == pytest.approx(0.0, abs=1e-12)
    if "up" in facing:
        assert v / 0.6 == pytest.approx((0.5**0.5, 0.5**0.5, 0.0))


def test_rectangles_by_their_edges():
    lamp = parse_lamp("rectangle:0,2,0 edge_u=1,0,0 edge_v=0,0,2 two_sided=yes").shape
    assert lamp == RectangleLamp((0.0, 2.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 2.0), WHITE, True)


def test_tubes():
    tube = parse_lamp("tube:-1,2.4,0 to=1,2.4,0")
    assert tube.shape == TubeLamp((-1.0, 2.4, 0.0), (1.0, 2.4, 0.0), TUBE_M, WHITE) and tube.radius_in_metres
    assert parse_lamp("tube:-1,2.4,0 to=1,2.4,0 radius=.1").shape.radius == 0.1


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "missing"),
        ("1,2", "expected three numbers"),
        ("1,2,nan", "expected three numbers"),
        ("1,2,inf", "expected three numbers"),
        ("1,2,3 radius .1", "expected three numbers"),
        ("1,2,3 radus=.1", "radus: a sphere has no such field; did you mean radius?"),
        ("1,2,3 radius=nan", "radius nan"),
        ("1,2,3 radius=-1", "radius -1"),
        ("1,2,3 radius=.1 radius=.2", "radius: given twice"),
        ("1,2,3 at=1,2,3", "at: given twice"),
        ("1,2,3 position=1,2,3", "given twice"),
        ("1,2,3 brightness=5", "with its unit"),
        ("1,2,3 brightness=1EV radiance=1", "radiance: give that or brightness"),
        ("1,2,3 radiance=1 intensity=1", "radiance: give that or intensity"),
        ("1,2,3 radiance=1,2,3 color=red", "color: "),
        ("1,2,3 radiance=1,2", "expected three numbers"),
        ("1,2,3 radiance=-1", "radiance -1"),
        ("1,2,3 radiance=1e13,0,0", "expected numbers from 0"),
        ("1,2,3 radiance=1 radius=0", "give its intensity"),
        ("1,2,3 name=", "expected a line"),
        ("1,2,3 name=a\tb", "expected a line"),
        ("1,2,3 color=wram", "did you mean warm"),
        ("spto:1,2,3", "spto: not a kind of lamp; did you mean spot?"),
        ("spot", "did you mean spot?"),
        ("spot:1,2,3", "target: missing; a spot needs position and target"),
        ("spot:1,2,3 target=1,2,3", "no direction"),
        ("spot:1,2,3 target=0,0,0 beam=40 cutoff=20", "beam_deg"),
        ("spot:1,2,3 target=0,0,0 cutoff=181", "cutoff_deg"),
        ("spot:1,2,3 target=0,0,0 radiance=1", "radiance: a spot has none; give its intensity"),
        ("rectangle:1,2,3 width=1 height=1", "needs a target or a normal"),
        ("rectangle:1,2,3 width=1 height=1 target=0,0,0 normal=1,0,0", "needs a target or a normal"),
        ("rectangle:1,2,3 target=0,0,0 width=1", "height: missing"),
        ("rectangle:1,2,3 target=1,2,3 width=1 height=1", "no direction"),
        ("rectangle:1,2,3 normal=1,0,0 up=2,0,0 width=1 height=1", "up 2,0,0"),
        ("rectangle:1,2,3 edge_u=1,0,0", "edge_v: missing"),
        ("rectangle:1,2,3 edge_u=1,0,0 edge_v=2,0,0", "span no rectangle"),
        ("rectangle:1,2,3 edge_u=1,0,0 edge_v=0,1,0 width=1", "width: the edges already set it"),
        ("rectangle:1,2,3 edge_u=1,0,0 edge_v=0,1,0 two_sided=maybe", "expected yes or no"),
        ("rectangle:1,2,3 target=0,0,0 width=1 height=1 intensity=3", "intensity: a rectangle has none"),
        ("tube:1,2,3", "end: missing"),
        ("tube:1,2,3 to=1,2,3", "the tube has no length"),
        ("mesh:1,2,3", "give its file"),
        ("profile:1,2,3", "give its file"),
        ("none.ies at=0,0,0 target=0,1,0", "no such file"),
        ("none.ies", "position: missing"),
        ("none.glb", "no such file"),
        ("none.json radius=3", "radius: not a field of lamps from files"),
        ("none\0.glb", "null"),
        ("lamps.txt", "expected x,y,z"),
        ("1," * 3000, "letters, expected at most"),
    ],
)
def test_what_is_no_lamp_is_refused_in_one_line(text, says):
    with pytest.raises(InputError) as caught:
        parse_lamp(text)
    assert says in str(caught.value) and "\n" not in str(caught.value)
    assert re.fullmatch("`placed` [^`]*", str(caught.value))  # no field is taken for an option


WORDS = st.sampled_from(
    [*EVERY, *SHORT, *(name for names in FIELDS.values() for name in names), "at", "lamp", "", "sphere"]
)
VALUES = st.one_of(
    st.text(max_size=8),
    st.sampled_from(
        ["1,2,3", "0,0,0", "nan", "1e308", "1e-320", "-1", "3000K", "+1EV", "9lm", "0", "1e200,1e200,1", "yes"]
    ),
)
HEADS = st.one_of(
    st.text(max_size=12),
    st.sampled_from(["1,2,3", "x.ies", "x.glb", "x.json", "1e300,0,0", *(f"{kind}:0,0,1" for kind in FIELDS)]),
)


SCALES = SCALE, LampScale(1e-300, 1e300, 1e-300), LampScale(1e300, 1e-300)


@settings(max_examples=400, deadline=None, database=None, derandomize=True)
@given(
    HEADS, st.lists(st.tuples(WORDS, VALUES), max_size=6), st.sampled_from([SCALE, LampScale(1e-300, 1e300, 1e-300)])
)
@example("1,2,3", [("radius", "1e-320"), ("intensity", "1")], SCALE)
@example("rectangle:1e300,0,0", [("target", "-1e300,0,0"), ("width", "1"), ("height", "1e-320")], SCALE)
def test_nothing_but_input_errors(head, words, scale):
    text = " ".join([head, *(f"{name}={value}" for name, value in words)])
    try:
        found = parse_lamps(text)
        assert all(isinstance(each, AskedLamp) for each in found)
        resolve(found[0], scale)
    except InputError as error:
        assert str(error) and "\n" not in str(error)


@settings(max_examples=200, deadline=None, database=None, derandomize=True)
@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(text):
    try:
        parse_lamps(text)
    except InputError as error:
        assert "\n" not in str(error)
