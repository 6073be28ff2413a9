"""integrations/blender: rendered by Blender as a Python module, in a process of its own.

RELIGHT_BPY names a Python that has bpy; without it, and without bpy beside the tests, this skips.
"""

import json
import os
import subprocess
import sys
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest
from lit_ball import ball_scene

from relight import Environment, Relighter
from relight.engine.nine import nine_coefficients
from relight.output.lamps_glb import ShownLight
from relight.output.live_glb import write_live_glb
from relight.output.preview import Preview, default_camera
from splat2mesh.scene.color import srgb_from_linear

ROOT = Path(__file__).parents[2]
ADDON = ROOT / "integrations" / "blender"
WIDTH, HEIGHT, EXPOSURE, ANGLES_DEG = 160, 120, 0.25, (30.0, 200.0)


def addon():
    spec = spec_from_file_location("relight_light", ADDON / "relight_light.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    scene, albedo = ball_scene()
    light = Environment.load("studio")
    relighter = Relighter(scene)
    grey, tint = nine_coefficients(relighter, albedo)
    path = tmp_path_factory.mktemp("blender") / "live.glb"
    write_live_glb(path, scene, albedo, (grey, tint), ShownLight(light.rotated(ANGLES_DEG[0]), EXPOSURE))
    return path, scene, albedo, grey, tint, light, relighter


def test_the_file_is_read_and_the_light_turns(written):
    path, scene, albedo, grey, tint, light, _ = written
    reader = addon()
    live, parts = reader.read(path)
    assert live["light"]["angle_deg"] == ANGLES_DEG[0]
    x, y, z = np.vstack([part["positions"] for part in parts]).T
    np.testing.assert_array_equal(np.stack([x, z, -y], axis=1), scene.vertices)
    np.testing.assert_array_equal(np.vstack([part["albedo"] for part in parts]), albedo)
    transfer = np.vstack([part["transfer"] for part in parts])
    np.testing.assert_allclose(transfer, np.hstack([grey, tint]), atol=2e-5)
    np.testing.assert_allclose(reader.turned(live["light"]["sh"], 77.0), light.rotated(77.0).sh(3), atol=1e-9)


def test_a_drivers_expression_is_the_turned_coefficient(written):
    reader = addon()
    sh = written[5].sh(3)
    factors = reader.waves(sh)
    names = {"cos": np.cos, "sin": np.sin, "radians": np.radians}
    for angle in (0.0, 41.0, 250.0):
        found = [[eval(reader.expression(factors[:, j, c]), names | {"a": angle}) for c in range(3)] for j in range(9)]
        np.testing.assert_allclose(found, reader.turned(sh, angle), atol=1e-5)


def test_another_file_is_refused_in_one_line(tmp_path):
    (tmp_path / "a.glb").write_bytes(b"not a glTF file at all")
    with pytest.raises(ValueError, match="not a binary glTF"):
        addon().read(tmp_path / "a.glb")


def test_blender_renders_what_the_preview_shows_under_two_angles(written, tmp_path):
    python = os.environ.get("RELIGHT_BPY") or (sys.executable if find_spec("bpy") else None)
    if python is None:
        pytest.skip("Blender as a module is not installed (bpy; RELIGHT_BPY names a Python that has it)")
    path, scene, albedo, grey, tint, light, relighter = written
    camera = default_camera(scene, WIDTH / HEIGHT)
    preview = Preview(scene, camera, WIDTH, HEIGHT, 16)
    backward = np.array(camera["eye"]) - camera["target"]
    backward /= np.linalg.norm(backward)
    right = np.cross([0.0, 1.0, 0.0], backward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(backward, right), backward, camera["eye"]], axis=1)
    upright = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    shots = [[angle, EXPOSURE, str(tmp_path / f"{angle}.npy")] for angle in ANGLES_DEG]
    job = {"glb": str(path), "width": WIDTH, "height": HEIGHT, "shots": shots}
    job["camera"] = {"world_from_camera": (upright @ pose).tolist(), "fov_deg": camera["fov_deg"]}
    script = ROOT / "tests" / "support" / "blender_render.py"
    done = subprocess.run([python, script, ADDON, json.dumps(job)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-1000:]
    black = Environment(np.zeros((2, 4, 3)))
    pictures = []
    for angle, _, file in shots:
        rendered = np.load(file)
        turned = light.rotated(angle)
        same = albedo * tint * np.maximum(grey @ turned.sh(3).astype(np.float32), 0.0)
        full = relighter.shade(turned, albedo)
        inside = rendered[..., 3] > 0.999  # edges are sampled at other places
        found = srgb_from_linear(np.clip(rendered[..., :3], 0.0, 1.0))[inside]
        for radiance, least in ((same, 40.0), (full, 30.0)):
            expected = preview.render(radiance.astype(np.float32), black, EXPOSURE)[inside] / 255.0
            assert -10.0 * np.log10(np.square(found - expected).mean()) > least
        pictures.append(found)
    assert np.abs(pictures[0] - pictures[1]).mean() > 0.02
