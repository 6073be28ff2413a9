"""relight.lamps.spec: JSON, and which reader takes which file."""

import json

import numpy as np
import pytest
from attacks import damaged
from typed_lamps import parse_lamp

from relight.lamps.asked import Brightness, LampScale, resolve
from relight.lamps.photometry import axis_intensity
from relight.lamps.shapes import MeshLamp, ProfileLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp
from relight.lamps.spec import LAMP_SUFFIXES, parse_lamps, read_lamps
from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import MOST_NODES

SCALE = LampScale(1.0, 2.0)
EVEN_IES = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 2 1 1 2 0 0 0\n1 1 60\n0 180\n0\n100 100\n"
SPHERE = {"type": "sphere", "position": [1.5, 1.5, -1.5], "radius": 0.1, "radiance": [70, 55, 38]}
LAMPS = [
    SPHERE,
    {
        "type": "spot",
        "position": [-1.5, 2.4, 0.5],
        "target": [-1.0, 0, -0.5],
        "intensity": [9, 9, 9],
        "cutoff_deg": 25,
        "beam_deg": 20,
        "name": "over the table",
    },
    {"type": "rectangle", "center": [0, 2, 0], "edge_u": [1, 0, 0], "edge_v": [0, 0, 2], "radiance": 3, "color": "red"},
    {"type": "tube", "start": [0, 0, 0], "end": [1, 0, 0], "radius": 0.02, "brightness": "+1EV"},
    {"type": "mesh", "vertices": np.eye(3).tolist(), "faces": [[0, 1, 2]], "radiance": [[1, 2, 3]], "two_sided": True},
    {"type": "profile", "file": "even.ies", "position": [0, 2, 0], "target": [0, 0, 0], "brightness": "0EV"},
]


def saved(tmp_path, content, name="lamps.json"):
    (tmp_path / "even.ies").write_text(EVEN_IES)
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_a_lamp_of_each_kind(tmp_path):
    asked = read_lamps(saved(tmp_path, LAMPS))
    sphere, spot, rectangle, tube, mesh, profile = (resolve(each, SCALE) for each in asked)
    assert isinstance(sphere, SphereLamp) and sphere.radius == 0.1 and sphere.position == (1.5, 1.5, -1.5)
    assert sphere.radiance == pytest.approx((70.0, 55.0, 38.0))
    assert isinstance(spot, SpotLamp) and (spot.cutoff_deg, spot.beam_deg, spot.radius) == (25.0, 20.0, 0.0)
    assert spot.intensity == pytest.approx((9.0, 9.0, 9.0)) and asked[1].name == "over the table"
    assert isinstance(rectangle, RectangleLamp) and rectangle.radiance == pytest.approx((3.0 / 0.2126, 0.0, 0.0))
    assert isinstance(tube, TubeLamp) and asked[3].brightness == Brightness(1.0)
    assert isinstance(mesh, MeshLamp) and mesh.two_sided and mesh.radiance.tolist() == [[1.0, 2.0, 3.0]]
    assert isinstance(profile, ProfileLamp) and axis_intensity(profile) @ [0.2126, 0.7152, 0.0722] == pytest.approx(2.0)


def test_lists_and_objects_that_hold_one_say_the_same(tmp_path):
    bare = read_lamps(saved(tmp_path, [SPHERE]))
    held = read_lamps(saved(tmp_path, {"about": "a room", "lamps": [SPHERE]}, "held.json"))
    assert bare[0].shape == held[0].shape and bare[0].brightness == held[0].brightness


def test_json_and_the_command_line_say_the_same(tmp_path):
    typed = "1.5,1.5,-1.5 radius=.1 radiance=70,55,38"
    assert resolve(read_lamps(saved(tmp_path, [SPHERE]))[0], SCALE) == resolve(parse_lamp(typed), SCALE)


def test_files_on_the_command_line(tmp_path):
    path = saved(tmp_path, LAMPS)
    assert len(parse_lamps(str(path))) == len(LAMPS)
    for before, after in zip(
        parse_lamps(str(path)), parse_lamps(f"{path} at=1,0,0 brightness=0EV color=#8080ff name=x"), strict=True
    ):
        assert after.brightness == Brightness(0.0) and after.name == "x"
        light = axis_intensity(resolve(after, SCALE))
        assert light @ [0.2126, 0.7152, 0.0722] == pytest.approx(2.0) and light[2] > light[0] > 0.0
        for name in ("position", "center", "start"):
            if hasattr(after.shape, name):
                assert np.subtract(getattr(after.shape, name), getattr(before.shape, name)).tolist() == [1.0, 0.0, 0.0]
    tinted = parse_lamps(f"{path} color=white")[0]
    lum = np.array([0.2126, 0.7152, 0.0722])
    assert resolve(tinted, SCALE).radiance == pytest.approx([float(lum @ [70, 55, 38])] * 3)


BAD = {
    "no JSON": ("[{", "not valid JSON"),
    "no list": ("3", "expected a list of lamps"),
    "an object": ("{}", "expected a list of lamps"),
    "no objects": ("[3]", "expected a list of lamps"),
    "none": ("[]", "has 0 lamps"),
    "of another kind": ({"cases": {}}, "expected a list of lamps"),
    "more beside": ({"lamps": [SPHERE], "env_scale": 0}, 'env_scale: expected nothing beside "lamps"'),
    "no type": ([{"position": [0, 0, 0]}], "lamp 1: type: missing"),
    "unknown type": ([SPHERE, {"type": "shpere"}], "lamp 2: shpere: not a kind of lamp; did you mean sphere?"),
    "unknown field": ([SPHERE | {"postion": 1}], "postion: a sphere has no such field; did you mean position?"),
    "null": ([SPHERE | {"radius": None}], "radius None"),
    "not a number": ('[{"type": "sphere", "position": [0, NaN, 0]}]', "expected three numbers"),
    "a text": ([SPHERE | {"position": {"x": 1}}], "expected three numbers"),
    "twice": ('[{"type": "sphere", "type": "spot"}]', "type: given twice"),
    "out of the folder": ([{"type": "mesh", "file": "../x.glb"}], "outside its folder"),
    "no such file": ([{"type": "mesh", "file": "x.glb"}], "no such file"),
    "faces": ([{"type": "mesh", "vertices": [[0, 0, 0]], "faces": [[0, 1, 2]]}], "vertices that do not exist"),
    "ragged": ([{"type": "mesh", "vertices": [[0, 0, 0], [1]], "faces": [[0, 1, 2]]}], "expected a list of numbers"),
    "huge": ([{"type": "mesh", "vertices": [[0, 0, 0]], "faces": [[10**40, 1, 2]]}], "expected a list of numbers"),
    "deep": ("[" * 100_000, "nested too deeply"),
    "too many": ("[" + "{}," * MOST_NODES + "{}]", "expected 1 to 100,000"),
}


@pytest.mark.parametrize("case", BAD)
def test_json_that_is_no_list_of_lamps_is_refused_in_one_line(tmp_path, case):
    content, says = BAD[case]
    path = saved(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read_lamps(path)
    assert says in str(caught.value) and "\n" not in str(caught.value) and str(path) in str(caught.value)


@pytest.mark.parametrize("suffix", [*LAMP_SUFFIXES, ".txt", ""])
def test_missing_empty_and_foreign_files(tmp_path, suffix):
    for number, content in enumerate([None, b"", b"\x89PNG\r\n\x1a\n" + bytes(64)]):
        path = tmp_path / f"{number}{suffix}"
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(InputError) as caught:
            read_lamps(path)
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError):
        read_lamps(tmp_path)


def test_damage_of_all_sorts(tmp_path):
    rng = np.random.default_rng(5)
    whole = json.dumps(LAMPS).encode()
    for _ in range(100):
        content, _ = damaged(whole, rng)
        path = saved(tmp_path, "")
        path.write_bytes(content)
        try:
            assert len(read_lamps(path)) > 0
        except InputError as error:
            assert "\n" not in str(error)
