"""integrations/unity: compiled by Mono against stubs and run on a bundle; shaders compiled; ONNX by onnxruntime."""

import json
import subprocess

import numpy as np
import pytest
from engine_shaders import compiled_hlsl, kernel_values
from lit_ball import ball_scene
from live_bundles import gain, make_bundle, reader, soft_suns
from mono import UNITY, compiled, ran, rows
from probe_lights import LOBE_ERROR, lobe, lobe_irradiance, picture, write_probes_in

from relight import Environment
from relight.output.lamps_glb import ShownLight
from relight.output.live_glb import write_live_glb
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.splats.splats import SH_C0


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return compiled(tmp_path_factory.mktemp("unity"))


def test_the_buffers_hold_the_splat_in_the_new_light(program, tmp_path):
    meta, splats, kinds = make_bundle(tmp_path)
    done = ran(program, tmp_path, 1, 30.0, 0.5, 3)
    assert done.returncode == 0, done.stderr
    colors, harmonics = done.stdout.strip().split("\n")
    colors, harmonics = rows(colors, 4), rows(harmonics, 3).reshape(-1, 3, 3)
    names = reader()
    light = soft_suns(meta["lights"][1])
    light |= {key: light[key] * 2**0.5 for key in ("exposure", "lamps")}
    change = names["change"](names["read"](tmp_path), light, np.radians(30.0))
    number = np.arange(len(splats))
    dc = np.stack([0.01 * number, -0.01 * number, np.full(len(splats), 0.5)], axis=1)  # as the stub's asset has them
    gains = gain(SH_C0 * dc + 0.5, change)
    expected = np.where((kinds == 1)[:, None], (gains * (SH_C0 * dc + 0.555) - 0.555) / SH_C0, dc)
    np.testing.assert_allclose(colors[:, :3], expected, atol=2e-3 * np.abs(expected).max())
    assert (colors[:, 3] == 0.25).all()
    whole = names["turned"](light["whole"], np.radians(30.0)) * light["exposure"]
    whole = np.concatenate([whole, np.full((1, 3), light["lamps"])])
    most = np.maximum(np.einsum("kc,kc->c", meta["mean"], whole), 1.0) ** (1 / 2.4)
    factor = np.where((kinds == 1)[:, None], np.minimum(gains, most), 1.0)
    expected = np.repeat(factor[:, None] * [0.1, 0.2, 0.3], 3, axis=1)
    np.testing.assert_allclose(harmonics, expected, rtol=5e-3)


def test_the_buffers_hold_the_light_of_lamps(program, tmp_path):
    meta, splats, kinds = make_bundle(tmp_path, lamps=True)
    done = ran(program, tmp_path, 1, 30.0, 0.5, 3, 0.0, 1.5)
    assert done.returncode == 0, done.stderr
    found, harmonics = (rows(line, width) for line, width in zip(done.stdout.strip().split("\n"), (4, 3), strict=True))
    names, light, lit = reader(), meta["lights"][1], kinds == 1
    light |= {"exposure": light["exposure"] * 2**0.5, "unit": light["unit"] * 2**0.5}
    strengths = np.array([0.3, 1.0, 2**1.5])
    change = names["change"](names["read"](tmp_path), light, np.radians(30.0), strengths)
    number = np.arange(len(splats))
    dc = np.stack([0.01 * number, -0.01 * number, np.full(len(splats), 0.5)], axis=1)
    gains = gain(SH_C0 * dc + 0.5, change)
    expected = (gains * (SH_C0 * dc + 0.555) - 0.555) / SH_C0
    np.testing.assert_allclose(found[lit, :3], expected[lit], atol=2e-3 * np.abs(expected).max())
    mean = [light["unit"] * s * np.array(t["color"]) * t["mean"] for s, t in zip(strengths, meta["terms"], strict=True)]
    factor = np.minimum(gains, np.maximum(np.sum(mean, axis=0), 1.0) ** (1 / 2.4))
    np.testing.assert_allclose(harmonics.reshape(-1, 3, 3)[lit, 0], (factor * [0.1, 0.2, 0.3])[lit], rtol=5e-3)


@pytest.mark.parametrize("change", ["byte", "count"])
def test_a_splat_that_is_not_the_bundles_is_refused_in_one_line(program, tmp_path, change):
    meta, *_ = make_bundle(tmp_path)
    if change == "byte":
        with open(tmp_path / "splat.ply", "ab") as file:
            file.write(b"\0")
    else:
        meta["count"] += 1
        (tmp_path / "live.json").write_text(json.dumps(meta))
    done = ran(program, tmp_path, 0, 0, 0, 0)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "splat.ply is not the splat of this bundle (its SHA-256 or count differs)" in done.stderr


def test_the_mesh_is_read_and_mirrored(program, tmp_path):
    scene, albedo = ball_scene(6)
    rng = np.random.default_rng(1)
    grey, tint = rng.uniform(-0.5, 0.5, (len(albedo), 9)), rng.uniform(0, 1, (len(albedo), 3))
    light = Environment.load("sunset").rotated(20.0)
    nine = grey.astype(np.float32), tint.astype(np.float32)
    write_live_glb(tmp_path / "live.glb", scene, albedo, nine, ShownLight(light, 0.5))
    done = ran(program, "mesh", tmp_path, "live.glb", 20.0)
    assert done.returncode == 0, done.stderr
    vertices, faces, *channels, turned = done.stdout.strip().split("\n")
    np.testing.assert_allclose(rows(vertices, 3), scene.vertices * [-1, 1, 1], atol=1e-6)
    np.testing.assert_array_equal(rows(faces, 3), scene.faces[:, [0, 2, 1]])
    transfer = np.hstack([rows(each, 4) for each in channels[:3]])
    np.testing.assert_allclose(transfer, np.hstack([grey, tint]), atol=2e-5)
    np.testing.assert_allclose(rows(channels[3], 4)[:, :3], albedo, atol=1e-6)
    np.testing.assert_allclose(rows(turned, 3), light.sh(3), atol=1e-6)
    (tmp_path / "other.glb").write_bytes(b"no glTF at all, but long enough")
    done = ran(program, "mesh", tmp_path, "other.glb", 0)
    assert done.returncode == 2 and done.stderr == "Relight: other.glb: not a binary glTF\n"


def shade_sh9(sh, normals):
    """Unity's own shading by a probe, of UnityCG.cginc, with the packing of SphericalHarmonicsL2 [rgb, 9] into
    unity_SHAr to unity_SHC (Sloan, "Stupid Spherical Harmonics Tricks", appendix A10)."""
    x, y, z = normals.T
    a = np.stack([sh[:, 3], sh[:, 1], sh[:, 2], sh[:, 0] - sh[:, 6]], axis=1)
    b = np.stack([sh[:, 4], sh[:, 5], 3 * sh[:, 6], sh[:, 7]], axis=1)
    first = a @ np.stack([x, y, z, np.ones_like(x)])
    return (first + b @ np.stack([x * y, y * z, z * z, z * x]) + sh[:, 8:] * (x * x - y * y)).T


def test_unity_shades_by_the_probes_as_the_closed_form(program, tmp_path):
    even = np.full((16, 32, 3), 0.7, np.float32)
    write_probes_in(tmp_path / "probes.json", [picture(lobe), even], [(1, 2, 3), (5, 2, 3)])
    normals = fibonacci_sphere(100)
    mirrored = normals * [-1, 1, 1]  # of the scene into Unity
    for at, known, atol in (((-1, 2, 3), lobe_irradiance(normals), LOBE_ERROR), ((-5, 2, 3), 0.7, 1e-5)):
        done = ran(program, "probes", tmp_path, "probes.json", 1, *at)
        assert done.returncode == 0, done.stderr
        lit, baked = (rows(line, 9) for line in done.stdout.strip().split("\n"))
        np.testing.assert_allclose(shade_sh9(lit, mirrored), known * np.ones((100, 3)), atol=atol)
        np.testing.assert_array_equal(lit, baked)
    done = ran(program, "probes", tmp_path, "probes.json", 3, -3, 2, 3)  # halfway, three times as bright
    lit = rows(done.stdout.split("\n")[0], 9)
    known = 1.5 * (lobe_irradiance(normals) + 0.7)
    np.testing.assert_allclose(shade_sh9(lit, mirrored), known, atol=1.5 * LOBE_ERROR)


def test_between_many_probes_the_nearest_count(program, tmp_path):
    rng = np.random.default_rng(3)
    positions, values = rng.uniform(-2, 2, (30, 3)), rng.uniform(0, 1, 30)
    write_probes_in(tmp_path / "probes.json", [np.full((4, 8, 3), v, np.float32) for v in values], positions)
    for place in (np.zeros(3), positions[4]):
        done = ran(program, "probes", tmp_path, "probes.json", 1, *(place * [-1, 1, 1]))
        distance = np.maximum(np.sort(np.linalg.norm(positions - place, axis=1)), 1e-6)
        order = np.argsort(np.linalg.norm(positions - place, axis=1))
        weights = (1 / distance[:8] - 1 / distance[8]) ** 2
        known = weights @ values[order[:8]] / weights.sum()
        assert rows(done.stdout.split("\n")[0], 9)[0, 0] == pytest.approx(known, abs=1e-4)  # positions are float32


@pytest.mark.parametrize("text", ["{}", "[1]", '{"format": "relight-live", "version": 1}', '{"format": 3}', "no"])
def test_a_file_that_holds_no_probes_is_refused_in_one_line(program, tmp_path, text):
    (tmp_path / "probes.json").write_text(text)
    done = ran(program, "probes", tmp_path, "probes.json", 1, 0, 0, 0)
    assert done.returncode == 2 and done.stderr.startswith("Relight: probes.json: ") and done.stderr.count("\n") == 1
    newer = '{"format": "relight-probes", "version": 2, "probes": []}'
    (tmp_path / "probes.json").write_text(newer)
    assert "version 2, this loader reads 1" in ran(program, "probes", tmp_path, "probes.json", 1, 0, 0, 0).stderr


def test_the_shaders_compile_and_their_kernel_is_ours(tmp_path):
    compiled_hlsl(tmp_path, UNITY, "RelightMesh.shader")
    compiled_hlsl(tmp_path, UNITY, "RelightColor.shader")
    found, expected = kernel_values(tmp_path, (UNITY / "RelightMesh.hlsl").read_text(encoding="utf-8"), "Relight")
    np.testing.assert_allclose(found, expected, rtol=2e-5, atol=1e-6)


def test_the_onnx_model_computes_the_same(tmp_path):
    onnxruntime = pytest.importorskip("onnxruntime")
    meta, splats, _ = make_bundle(tmp_path)
    names = reader()
    bundle = names["read"](tmp_path)
    light = meta["lights"][0]
    session = onnxruntime.InferenceSession(UNITY / "relight_splat.onnx", providers=["CPUExecutionProvider"])
    given = {
        "cluster": bundle[1].astype(np.int32),
        "weights": bundle[2].astype(np.float32),
        "table": names["table"](bundle, light).astype(np.float32),
        "dc": splats.sh[:, 0],
    }
    (found,) = session.run(None, given)
    gains = gain(SH_C0 * splats.sh[:, 0] + 0.5, names["change"](bundle, light))
    expected = (gains * (SH_C0 * splats.sh[:, 0] + 0.555) - 0.555) / SH_C0
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_the_onnx_file_is_what_its_script_makes(tmp_path):
    pytest.importorskip("onnx")
    import sys

    subprocess.run([sys.executable, UNITY / "make_onnx.py", tmp_path / "made.onnx"], check=True)
    assert (tmp_path / "made.onnx").read_bytes() == (UNITY / "relight_splat.onnx").read_bytes()
