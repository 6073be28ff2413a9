"""integrations/blender/relight_scene.py: lamps and HDRIs of Blender as `relight` has them; all of it run in Blender."""

import json
import math
import os
import subprocess
import sys
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from lit_ball import TILT, ball_scene

import relight.arguments
from relight import Environment
from relight.cli import request_of
from relight.lamps.asked import LampScale, resolve
from relight.lamps.photometry import axis_intensity, flux
from relight.lamps.shapes import RectangleLamp, SphereLamp, SpotLamp
from relight.lamps.spec import read_json_lamps
from relight.light.projections import texel_directions

ROOT = Path(__file__).parents[2]
ADDON = ROOT / "integrations" / "blender"


def module(name):
    spec = spec_from_file_location(name, ADDON / f"{name}.py")
    found = module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


ADD = module("relight_scene")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("blender") / "ball"
    ball_scene()[0].save(place)
    return place


def lamp(kind, **given):
    plain = {"color": (1.0, 0.5, 0.25), "energy": 100.0, "shadow_soft_size": 0.1, "shape": "SQUARE", "size": 0.5}
    return SimpleNamespace(**(plain | {"type": kind, "size_y": 0.25, "spot_size": 1.0, "spot_blend": 0.3} | given))


def turned(seed=0):
    """A pose (4, 4) of a lamp: no axis along another."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = q * np.sign(np.linalg.det(q)), (1.5, -2.0, 0.75)
    return pose


def read(tmp_path, *fields):
    (tmp_path / "lamps.json").write_text(json.dumps({"lamps": list(fields)}))
    scale = LampScale(metre=1.0, irradiance=1.0)
    return [resolve(asked, scale) for asked in read_json_lamps(tmp_path / "lamps.json")]


def scene_from(points):
    """(x, y, z) of Blender in the frame of the scene, by what its importers do with y up."""
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    return np.stack([x, z, -y], axis=-1)


def test_lamps_keep_place_direction_and_all_their_light(folder, tmp_path):
    matrix, pose = ADD.splat_from_blender(folder), turned()
    kinds = {kind: lamp(kind) for kind in ("POINT", "SPOT", "AREA")}
    kinds["DISK"] = lamp("AREA", shape="DISK")
    found = read(tmp_path, *(ADD.lamp_fields(name, each, pose, matrix) for name, each in kinds.items()))
    point, spot, area, disk = found
    assert [type(each) for each in found] == [SphereLamp, SpotLamp, RectangleLamp, RectangleLamp]
    for place in (point.position, spot.position, area.center):
        np.testing.assert_allclose(TILT[:3, :3] @ place + TILT[:3, 3], scene_from(pose[:3, 3]), atol=1e-12)
    ahead = scene_from(-pose[:3, 2])
    np.testing.assert_allclose(TILT[:3, :3] @ np.subtract(spot.target, spot.position), ahead, atol=1e-12)
    normal = np.cross(area.edge_u, area.edge_v)
    np.testing.assert_allclose(TILT[:3, :3] @ normal / np.linalg.norm(normal), ahead, atol=1e-12)
    watts = 100.0 * np.array([1.0, 0.5, 0.25])
    for each in (point, area, disk):  # Blender's watts are the flux
        np.testing.assert_allclose(flux(each), watts, rtol=1e-12)
    np.testing.assert_allclose(axis_intensity(spot), watts / (4 * math.pi), rtol=1e-12)
    assert spot.cutoff_deg == pytest.approx(math.degrees(0.5)) and 0.0 < spot.beam_deg < spot.cutoff_deg


def test_temperature_and_exposure_change_the_colour():
    warm = lamp("POINT", use_temperature=True, temperature_color=(2.0, 1.0, 0.5), exposure=1.0)
    np.testing.assert_allclose(ADD.color_of(warm), [4.0, 1.0, 0.25])


def test_suns_keep_direction_and_irradiance(tmp_path):
    rng = np.random.default_rng(1)
    for irradiance, toward in zip(rng.uniform(0.5, 5.0, (8, 3)), rng.normal(size=(8, 3)), strict=True):
        ADD.write_hdr(tmp_path / "suns.hdr", ADD.sun_picture([(irradiance, toward)], (0.0, 0.0, 0.0)))
        image = Environment.load(tmp_path / "suns.hdr").radiance
        rows, columns = np.nonzero(image.sum(axis=-1))
        assert len(rows) == 1
        direction = texel_directions(*image.shape[:2])[rows[0], columns[0]]
        # Half the diagonal of a texel.
        assert direction @ scene_from(toward / np.linalg.norm(toward)) > math.cos(math.radians(0.25))
        edges = np.cos(np.pi * np.array([rows[0], rows[0] + 1]) / image.shape[0])
        received = image[rows[0], columns[0]] * 2 * math.pi / image.shape[1] * (edges[0] - edges[1])
        np.testing.assert_allclose(received, irradiance, atol=irradiance.max() / 120)  # mantissas have 8 bits


def test_a_background_comes_from_everywhere(tmp_path):
    ADD.write_hdr(tmp_path / "suns.hdr", ADD.sun_picture([], (0.25, 0.5, 0.75)))
    image = Environment.load(tmp_path / "suns.hdr").radiance
    np.testing.assert_array_equal(image, np.broadcast_to([0.25, 0.5, 0.75], image.shape))


@pytest.mark.parametrize("mapping", [0.0, 30.0, -100.0])
def test_the_background_of_blender_is_the_turned_environment(mapping):
    """By the lookups of both in docs/conventions.md: the same texel for every direction."""
    rng = np.random.default_rng(2)
    toward = rng.normal(size=(100, 3))
    angle = math.radians(mapping)
    x = math.cos(angle) * toward[:, 0] - math.sin(angle) * toward[:, 1]
    y = math.sin(angle) * toward[:, 0] + math.cos(angle) * toward[:, 1]
    in_blender = 0.5 - np.arctan2(y, x) / (2 * math.pi)
    scene, back = scene_from(toward), -math.radians(ADD.background_angle(mapping))
    x = math.cos(back) * scene[:, 0] + math.sin(back) * scene[:, 2]
    z = -math.sin(back) * scene[:, 0] + math.cos(back) * scene[:, 2]
    here = 0.5 - np.arctan2(x, z) / (2 * math.pi)
    difference = (in_blender - here + 0.5) % 1.0 - 0.5
    np.testing.assert_allclose(difference, 0.0, atol=1e-12)


def test_the_command_line_understands_every_light(folder, tmp_path):
    fields = [ADD.lamp_fields("a lamp", lamp("POINT"), np.eye(4), ADD.splat_from_blender(folder))]
    sun = [(np.ones(3), (0.0, 0.0, 1.0))]
    for given in (
        *(ADD.light_arguments(name, "", 30.0, 0.0) for name in ADD.BUILT_IN),
        ADD.light_arguments("FILE", tmp_path / "sky.exr", 370.0, 0.0),
        ADD.light_arguments("CAPTURED", "", 0.0, 0.2),
        ADD.lamp_arguments(fields, sun, (0, 0, 0), 0.2, tmp_path),
        ADD.lamp_arguments(fields, [], (0, 0, 0), 0.0, tmp_path),
        ADD.lamp_arguments([], sun, (0.1, 0.1, 0.1), 0.0, tmp_path),
    ):
        words = [str(folder), *given, "--format", "glb", "splat", "-o", str(tmp_path / "out"), "-q"]
        assert request_of(relight.arguments.parser().parse_args(words)).scene
    with pytest.raises(ValueError, match="no visible lamp"):
        ADD.lamp_arguments([], [], (0, 0, 0), 0.0, tmp_path)


def test_a_missing_command_and_a_failed_one_are_one_line(tmp_path):
    with pytest.raises(ValueError, match="no such command"):
        ADD.commands(str(tmp_path / "relight"))
    with pytest.raises(ValueError, match=r"^relight: error: this one$"):
        ADD.finish(2, "progress\nrelight: error: this one\n")


def test_a_scene_is_known_by_its_folder_its_file_or_its_splat(tmp_path):
    (tmp_path / "garden").mkdir()
    for each in ("garden", "garden/scene.json", "garden.ply", "garden.compressed.ply"):
        assert ADD.scene_folder(tmp_path / each) == tmp_path / "garden"


def test_blender_imports_relights_and_shows(folder, tmp_path):
    python = os.environ.get("RELIGHT_BPY") or (sys.executable if find_spec("bpy") else None)
    if python is None:
        pytest.skip("Blender as a module is not installed (bpy; RELIGHT_BPY names a Python that has it)")
    command = tmp_path / "relight"
    command.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} -m relight "$@"\n')
    command.chmod(0o755)
    job = {"scene": str(folder / "scene.json"), "command": str(command), "out": str(tmp_path / "out.json")}
    script = ROOT / "tests" / "support" / "blender_relight.py"
    done = subprocess.run([python, script, ADDON, json.dumps(job)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-2000:]
    found = json.loads((tmp_path / "out.json").read_text())
    np.testing.assert_allclose(found["captured"], found["relit"], atol=1e-5)
    assert found["hidden"] == [True, False]
    # Lamp and sun stand on +x of Blender, which is +x of the scene: that side is lit, the other is black.
    assert found["lit_side"] > 0.05 and found["other_side"] < 1e-3
    assert found["rendered"] == pytest.approx(found["expected"], abs=0.02)
