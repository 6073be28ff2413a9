"""relight.output.live_glb and proxy: read by a parser of the tests, and as the Khronos validator sees them."""

import json
import struct

import numpy as np
import pytest
from gltf_check import validator_issues
from lit_ball import TILT, ball_scene

from relight import Environment, Relighter
from relight.engine.nine import nine_coefficients
from relight.lamps.asked import LampScale, resolve
from relight.lamps.photometry import flux
from relight.lamps.shapes import SphereLamp, SpotLamp
from relight.lamps.spec import read_lamps
from relight.output.lamps_glb import PlacedLamps, ShownLight
from relight.output.live_glb import KEY, PLAYCANVAS_FROM_SPLAT, SNORM, write_live_glb, write_proxy_glb
from relight.output.mesh_files import write_glb

TYPES = {5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


def read(path):
    """The document of a GLB, and of every primitive a dict of arrays, normalised integers as floats."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def array(index):
        accessor = document["accessors"][index]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        start = document["bufferViews"][accessor["bufferView"]].get("byteOffset", 0)
        kind = TYPES[accessor["componentType"]]
        values = np.frombuffer(binary, kind, accessor["count"] * width, start).reshape(-1, width)
        return np.maximum(values / SNORM, -1.0) if accessor.get("normalized") else values

    primitives = []
    for mesh in document["meshes"]:
        (primitive,) = mesh["primitives"]
        arrays = {name: array(index) for name, index in primitive["attributes"].items()}
        primitives.append(arrays | {"indices": array(primitive["indices"]), "accessors": primitive["attributes"]})
    return document, primitives


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    scene, albedo = ball_scene()
    relighter = Relighter(scene)
    light = Environment.load("sunset").rotated(40.0)
    grey, tint = nine_coefficients(relighter, albedo)
    path = tmp_path_factory.mktemp("live") / "live.glb"
    write_live_glb(path, scene, albedo, (grey, tint), ShownLight(light, 0.5))
    return path, scene, albedo, relighter, light


def test_what_a_loader_reads_gives_the_light_of_three_bands(written):
    path, _, albedo, relighter, light = written
    document, primitives = read(path)
    live = document["scenes"][0]["extras"][KEY]
    start = Environment(light.radiance).rotated(live["light"]["angle_deg"])
    np.testing.assert_allclose(live["light"]["sh"], Environment(light.radiance).sh(3), atol=1e-12)
    transfer = np.vstack([np.hstack([each[f"_TRANSFER_{i}"] for i in range(3)]) for each in primitives])
    colors = np.vstack([each["COLOR_0"] for each in primitives])
    np.testing.assert_array_equal(colors, albedo)
    found = colors * transfer[:, 9:] * np.maximum(transfer[:, :9] @ start.sh(3), 0.0)
    # The tint and bounces aside, that is transfer times light; 16 bits are 3e-5 of full scale.
    grey, tint = nine_coefficients(relighter, albedo)
    truth = albedo * tint * np.maximum(grey @ light.sh(3).astype(np.float32), 0.0)
    assert np.abs(found - truth).max() < 3e-4 * truth.max()


def test_custom_attributes_are_the_same_accessors_and_the_mesh_is_the_scenes(written):
    path, scene, *_ = written
    _, primitives = read(path)
    assert len(primitives) == len(scene.chunks) > 1
    for chunk, each in zip(scene.chunks, primitives, strict=True):
        assert all(each["accessors"][f"_CUSTOM{i}"] == each["accessors"][f"_TRANSFER_{i}"] for i in range(3))
        np.testing.assert_array_equal(each["POSITION"], chunk.vertices)
        np.testing.assert_array_equal(each["indices"].reshape(-1, 3), chunk.faces)


def test_the_same_scene_gives_the_same_bytes(written, tmp_path):
    path, scene, albedo, _, light = written
    grey, tint = nine_coefficients(Relighter(scene), albedo)
    write_live_glb(tmp_path / "again.glb", scene, albedo, (grey, tint), ShownLight(light, 0.5))
    assert (tmp_path / "again.glb").read_bytes() == path.read_bytes()


def test_the_khronos_validator_has_nothing_to_say(written, tmp_path):
    path, scene, albedo, *_ = written
    assert validator_issues(path)["messages"] == []
    write_proxy_glb(tmp_path / "proxy.glb", scene, np.linalg.inv(TILT), albedo)
    write_proxy_glb(tmp_path / "bare.glb", scene, PLAYCANVAS_FROM_SPLAT @ np.linalg.inv(TILT))
    for name in ("proxy.glb", "bare.glb"):
        assert validator_issues(tmp_path / name)["messages"] == []


def test_the_proxy_stands_in_the_frame_of_the_splat(written, tmp_path):
    _, scene, albedo, *_ = written
    back = np.linalg.inv(TILT)
    write_proxy_glb(tmp_path / "proxy.glb", scene, back, albedo)
    _, (proxy,) = read(tmp_path / "proxy.glb")
    np.testing.assert_allclose(proxy["POSITION"] @ TILT[:3, :3].T + TILT[:3, 3], scene.vertices, atol=1e-6)
    np.testing.assert_allclose(proxy["NORMAL"] @ TILT[:3, :3].T, scene.normals, atol=1e-6)
    np.testing.assert_array_equal(proxy["indices"].reshape(-1, 3), scene.faces)
    write_proxy_glb(tmp_path / "bare.glb", scene, PLAYCANVAS_FROM_SPLAT @ back)
    _, (bare,) = read(tmp_path / "bare.glb")
    assert set(bare["accessors"]) == {"POSITION"}
    np.testing.assert_array_equal(bare["POSITION"], proxy["POSITION"] * np.float32([-1, -1, 1]))


def roughness_of(scene):
    """(V,): two materials, by height."""
    high = scene.vertices[:, 1] - scene.vertices[:, 1].min()
    return np.where(high > 0.5, 0.3, 1.0).astype(np.float32)


@pytest.mark.parametrize("kind", ["live", "proxy"])
def test_roughness_is_read_back_by_texture_coordinates(written, tmp_path, kind):
    """As an engine samples: bilinear between the centres of texels; roughness is green, blue the metals: none."""
    import imageio.v3 as iio

    path, scene, albedo, _, light = written
    roughness, name = roughness_of(scene), tmp_path / "glossy.glb"
    if kind == "live":
        nine = nine_coefficients(Relighter(scene), albedo)
        write_live_glb(name, scene, albedo, nine, ShownLight(light, 0.5), roughness)
    else:
        write_proxy_glb(name, scene, None, albedo, roughness)
    assert validator_issues(name)["messages"] == []
    document, primitives = read(name)
    (material,) = document["materials"]
    surface = material["pbrMetallicRoughness"]
    assert surface["metallicFactor"] == 0.0 and surface.get("roughnessFactor", 1.0) == 1.0
    (picture,) = document["images"]
    view, data = document["bufferViews"][picture["bufferView"]], name.read_bytes()
    start = 28 + struct.unpack_from("<I", data, 12)[0] + view["byteOffset"]
    image = iio.imread(data[start : start + view["byteLength"]]) / 255.0
    u, v = np.concatenate([each["TEXCOORD_0"] for each in primitives]).astype(float).T
    x = u * image.shape[1] - 0.5
    left = np.clip(x.astype(int), 0, image.shape[1] - 2)
    rough = image[0, left, 1] + (x - left) * (image[0, left + 1, 1] - image[0, left, 1])
    np.testing.assert_allclose(rough, roughness, atol=1e-5)
    assert not image[..., 2].any() and (v == 0.5).all()
    if kind == "live":
        assert read(path)[0]["materials"][0]["pbrMetallicRoughness"]["metallicFactor"] == 0.0


BULB = SphereLamp((0.5, 2.0, -1.0), 0.1, radiance=(70.0, 55.0, 38.0))
SPOT = SpotLamp((-1.0, 2.0, 0.0), (0.0, 0.0, 0.0), (9.0, 9.0, 3.0), 25.0, 20.0)


@pytest.mark.parametrize("kind", ["live", "relit"])
def test_placed_lamps_are_lights_that_the_validator_and_we_read(written, tmp_path, kind):
    _, scene, albedo, _, light = written
    placed = PlacedLamps([BULB, SPOT], ["by the door", ""])
    if kind == "live":
        grey, tint = nine_coefficients(Relighter(scene), albedo)
        write_live_glb(tmp_path / "lamps.glb", scene, albedo, (grey, tint), ShownLight(light, 0.5, placed))
        assert len(read(tmp_path / "lamps.glb")[1]) == len(scene.chunks)
    else:
        write_glb(tmp_path / "lamps.glb", scene, albedo, 1.0, placed=placed)
    assert validator_issues(tmp_path / "lamps.glb")["messages"] == []
    asked = read_lamps(tmp_path / "lamps.glb")
    assert [each.name for each in asked] == ["by the door", "Lamp 2"]
    bulb, spot = (resolve(each, LampScale(1.0, 1.0, 1.0)) for each in asked)
    assert bulb.position == pytest.approx(BULB.position) and flux(bulb) == pytest.approx(flux(BULB))
    assert spot.position == pytest.approx(SPOT.position) and spot.intensity == pytest.approx(SPOT.intensity)
