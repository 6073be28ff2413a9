"""relight.lamps.gltf_lights: what is written is read back, and as others read it."""

import math

import numpy as np
import pygltflib as gltf
import pytest
from gltf_check import validator_issues

from relight.lamps.asked import LampScale, resolve
from relight.lamps.gltf_lights import PUNCTUAL, khr_lights
from relight.lamps.photometry import axis_intensity, flux
from relight.lamps.shapes import MeshLamp, ProfileLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp
from relight.lamps.spec import read_lamps
from splat2mesh.base.sphere import fibonacci_sphere

ONE = LampScale(1.0, 1.0, 1.0)
"""In which a candela is a unit of the picture."""

LIGHT = (70.0, 55.0, 38.0)


def profile(vertical_deg, column):
    table = np.repeat(np.array(column, float)[:, None], 2, axis=1)
    angles = np.array(vertical_deg, float), np.array([0.0, 360.0])
    return ProfileLamp((0.0, 2.0, 0.0), (1.0, 0.0, 0.0), LIGHT, *angles, table)


POINT = SphereLamp((1.0, 2.0, 3.0), intensity=LIGHT)
BALL = SphereLamp((1.5, 1.5, -1.5), 0.1, LIGHT)
SPOT = SpotLamp((-1.5, 2.4, 0.5), (-1.0, 0.0, -0.5), LIGHT, 25.0, 20.0)
SOFT_SPOT = SpotLamp((0.0, 1.0, 0.0), (0.0, 1.0, 5.0), LIGHT, 70.0, 0.0, 0.05)
PANEL = RectangleLamp((0.0, 2.0, 0.0), (1.0, 0.0, 0.2), (0.3, 0.0, 2.0), LIGHT)
TUBE = TubeLamp((-1.0, 2.0, 0.5), (1.0, 2.5, 0.0), 0.02, LIGHT)
SIGN = MeshLamp(np.eye(3), np.array([[0, 1, 2]]), np.array(LIGHT))
TWO_SIDED_SIGN = MeshLamp(np.eye(3), np.array([[0, 2, 1]]), np.array([LIGHT]), True)
DARK = SphereLamp((0.0, 0.0, 0.0), 0.1, (0.0, 0.0, 0.0))


def glb(tmp_path, lamps, names=None):
    extension, nodes = khr_lights(lamps, names)
    document = gltf.GLTF2(asset=gltf.Asset(version="2.0"), extensionsUsed=[PUNCTUAL])
    document.extensions = {PUNCTUAL: extension}
    document.nodes = [gltf.Node(**node) for node in nodes]
    document.scenes, document.scene = [gltf.Scene(nodes=list(range(len(nodes))))], 0
    path = tmp_path / "lamps.gltf"
    path.write_text(document.to_json())
    return path


def through_gltf(tmp_path, lamps, names=None):
    return [resolve(asked, ONE) for asked in read_lamps(glb(tmp_path, lamps, names))]


def fields(lamp):
    """Every number of a lamp but where a spot's target is along its axis."""
    found = dict(vars(lamp))
    if "target" in found:
        ahead = np.subtract(found["target"], found["position"])
        found["target"] = ahead / np.linalg.norm(ahead)
    return {name: np.asarray(value, float) for name, value in found.items() if value is not None}


def alike(found, lamp, relative):
    assert type(found) is type(lamp)
    found, expected = fields(found), fields(lamp)
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert np.allclose(found[name], value, rtol=relative, atol=relative * 10.0), name


@pytest.mark.parametrize("lamp", [POINT, BALL, SPOT, SOFT_SPOT, DARK])
def test_points_and_spots_come_back_from_gltf(tmp_path, lamp):
    alike(through_gltf(tmp_path, [lamp])[0], lamp, 1e-9)


def test_a_hard_spot_gets_the_least_of_a_rim(tmp_path):
    (found,) = through_gltf(tmp_path, [SpotLamp((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), LIGHT, 30.0, 30.0)])
    assert 0.0 < found.cutoff_deg - found.beam_deg < 1e-4
    (wide,) = through_gltf(tmp_path, [SpotLamp((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), LIGHT, 150.0, 120.0)])
    assert wide.cutoff_deg == pytest.approx(90.0) and wide.beam_deg < wide.cutoff_deg


@pytest.mark.parametrize("seed", range(20))
def test_spots_of_every_direction_come_back(tmp_path, seed):
    ahead = fibonacci_sphere(18).tolist()[seed] if seed < 18 else [0.0, 0.0, 1.0 if seed == 18 else -1.0]
    lamp = SpotLamp((1.0, 2.0, 3.0), tuple(np.add((1.0, 2.0, 3.0), ahead).tolist()), LIGHT, 25.0, 20.0)
    alike(through_gltf(tmp_path, [lamp])[0], lamp, 1e-9)


def test_pygltflib_and_the_specification_agree(tmp_path):
    path = glb(tmp_path, [POINT, SPOT, PANEL, TUBE], ["bulb", "", "panel", "tube"])
    document = gltf.GLTF2().load(str(path))
    lights = document.extensions[PUNCTUAL]["lights"]
    assert [light["type"] for light in lights] == ["point", "spot", "spot", "point"]
    assert [light["name"] for light in lights] == ["bulb", "Lamp 2", "panel", "tube"]
    for light, node in zip(lights, document.nodes, strict=True):
        assert max(light["color"]) == 1.0 and min(light["color"]) >= 0.0
        assert lights[node.extensions[PUNCTUAL]["light"]] is light
        if light["type"] == "spot":
            assert 0.0 <= light["spot"]["innerConeAngle"] < light["spot"]["outerConeAngle"] <= math.pi / 2.0
            assert np.linalg.norm(node.rotation) == pytest.approx(1.0)
    assert lights[0]["intensity"] * np.array(lights[0]["color"]) == pytest.approx(LIGHT)
    issues = validator_issues(path)
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


def test_areas_are_spots_and_points_as_bright(tmp_path):
    panel, tube, sign, two_sided = through_gltf(tmp_path, [PANEL, TUBE, SIGN, TWO_SIDED_SIGN])
    assert isinstance(panel, SpotLamp) and panel.position == PANEL.center and panel.cutoff_deg == pytest.approx(90.0)
    normal = np.cross(PANEL.edge_u, PANEL.edge_v)
    assert fields(panel)["target"] == pytest.approx(normal / np.linalg.norm(normal))
    assert axis_intensity(panel) == pytest.approx(axis_intensity(PANEL))
    assert isinstance(tube, SphereLamp) and tube.position == pytest.approx((0.0, 2.25, 0.25))
    assert flux(tube) == pytest.approx(flux(TUBE))
    assert isinstance(sign, SpotLamp) and sign.position == pytest.approx((1 / 3, 1 / 3, 1 / 3))
    assert fields(sign)["target"] == pytest.approx([3**-0.5] * 3)
    assert axis_intensity(sign) == pytest.approx(axis_intensity(SIGN))
    assert isinstance(two_sided, SphereLamp) and flux(two_sided) == pytest.approx(flux(TWO_SIDED_SIGN))


def test_profiles_are_spots_of_their_flux_or_points(tmp_path):
    narrow = profile([0.0, 20.0, 40.0], [1.0, 0.5, 0.0])
    wide = profile([0.0, 180.0], [1.0, 1.0])
    spot, point = through_gltf(tmp_path, [narrow, wide])
    assert isinstance(spot, SpotLamp) and flux(spot) == pytest.approx(flux(narrow))
    assert (spot.beam_deg, spot.cutoff_deg) == pytest.approx((20.0, 36.0), abs=0.2)
    assert isinstance(point, SphereLamp) and flux(point) == pytest.approx(flux(wide))


def test_no_lamps_leave_no_node():
    assert khr_lights([]) == ({"lights": []}, [])
