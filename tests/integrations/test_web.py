"""integrations/web, three: their kernels in node against Python, and a splat that is not the bundle's is refused."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from live_bundles import gain, make_bundle, reader, soft_suns

from relight import Environment

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "tests" / "support" / "web_kernels.mjs"

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")


def ran(*arguments):
    command = ["node", SCRIPT, ROOT / "integrations", *arguments]
    return subprocess.run([str(each) for each in command], capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize(("weights", "light", "angle"), [(2, 0, 0.0), (6, 1, 30.0), (14, 1, 200.0)])
def test_the_change_of_light_is_that_of_the_documented_reader(tmp_path, weights, light, angle):
    meta, _, kinds = make_bundle(tmp_path, weights=weights)
    done = ran("bundle", tmp_path, "splat.compressed.ply", light, angle)
    assert done.returncode == 0, done.stderr
    found, names = json.loads(done.stdout), reader()
    bundle = names["read"](tmp_path, "splat.compressed.ply")
    expected = names["change"](bundle, soft_suns(meta["lights"][light]), np.radians(angle))
    np.testing.assert_allclose(
        np.reshape(found["changes"], (-1, 3)), expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max()
    )
    np.testing.assert_array_equal(found["kinds"], kinds)


@pytest.mark.parametrize("light", [0, 1])
def test_lamps_and_captured_light_are_added_as_documented(tmp_path, light):
    meta, _, kinds = make_bundle(tmp_path, lamps=True)
    done = ran("bundle", tmp_path, "splat.ply", light, 0.0)
    assert done.returncode == 0, done.stderr
    found, names, lit = json.loads(done.stdout), reader(), kinds == 1
    bundle, chosen = names["read"](tmp_path), meta["lights"][light]
    expected = names["change"](bundle, chosen)
    assert found["names"] == ["Lamp 1", "Lamp 2"]
    np.testing.assert_allclose(np.reshape(found["changes"], (-1, 3))[lit], expected[lit], rtol=1e-4, atol=1e-5)
    alone = names["table"](bundle, chosen)[bundle[1]]
    alone = alone[:, 0] + np.einsum("nw,nwx->nx", bundle[2], alone[:, 1:])
    added, packed = np.reshape(found["added"], (-1, 3)), np.array(found["packed"], np.uint32)
    np.testing.assert_allclose(added[lit], 2.0 * (expected - alone)[lit], rtol=1e-4, atol=1e-5)
    shown = (packed[:, None] >> np.uint32([0, 9, 18]) & 511) * 2.0 ** ((packed[:, None] >> 27) - 24.0)
    assert (np.abs(shown - added) <= added.max(axis=1, keepdims=True) / 500).all()
    sky = added[kinds == 2]
    assert len(sky) and (sky == (0.0 if light == 0 else np.float32(0.3))).all()
    first = 0.5 * np.array([0.0, 2.0, 0.0]) * bundle[5][1] + 0.5 * 0.3
    np.testing.assert_allclose(np.reshape(found["other"], (-1, 3))[lit], first[lit], rtol=1e-4)


def test_a_display_value_changes_as_documented_and_the_sky_is_read(tmp_path):
    make_bundle(tmp_path)
    found = json.loads(ran("bundle", tmp_path, "splat.ply", 0, 0).stdout)
    color, k = np.array([-0.1, 0.02, 0.3, 0.7, 0.95, 1.2])[:, None], np.array([0.01, 0.5, 1.0, 3.0])
    np.testing.assert_allclose(found["relit"], gain(color, k) * (color + 0.055) - 0.055, atol=1e-6)
    packed = np.fromfile(tmp_path / "lights" / "0.rgbe", np.uint8).reshape(-1, 4)[:100]
    np.testing.assert_allclose(np.reshape(found["sky"], (-1, 4))[:, :3], (packed[:, :3] + 0.5) / 256.0, rtol=1e-6)


def test_under_no_change_no_colour_changes(tmp_path):
    make_bundle(tmp_path)
    found = json.loads(ran("bundle", tmp_path, "splat.ply", 0, 0).stdout)
    np.testing.assert_allclose(np.array(found["relit"])[:, 2], [-0.1, 0.02, 0.3, 0.7, 0.95, 1.2], atol=1e-12)


@pytest.mark.parametrize("change", ["byte", "count", "version", "format"])
def test_what_is_not_of_the_bundle_is_refused_in_one_line(tmp_path, change):
    meta, *_ = make_bundle(tmp_path)
    if change == "byte":
        data = bytearray((tmp_path / "splat.ply").read_bytes())
        data[-1] ^= 1
        (tmp_path / "splat.ply").write_bytes(data)
    if change == "count":
        meta["count"] += 1
    if change == "version":
        meta["version"] = 3
    if change == "format":
        meta["format"] = "other"
    (tmp_path / "live.json").write_text(json.dumps(meta))
    done = ran("bundle", tmp_path, "splat.ply", 0, 0)
    assert done.returncode == 2 and done.stdout == "" and done.stderr.count("\n") == 1
    expected = {"version": "version 3", "format": "not a bundle"}
    assert expected.get(change, "is not the splat of this bundle (its SHA-256 or count differs)") in done.stderr


def test_the_light_of_a_mesh_turns_and_shines_as_in_python(tmp_path):
    rng = np.random.default_rng(3)
    light = Environment(rng.uniform(0, 2, (16, 32, 3)))
    albedo, transfer = rng.uniform(0, 1, (5, 3)), rng.uniform(-0.3, 0.5, (5, 12))
    given = {"sh": light.sh(3).tolist(), "angle": 70.0, "albedo": albedo.tolist(), "transfer": transfer.tolist()}
    given |= {"pixels": light.radiance.reshape(-1, 3).tolist(), "width": 32, "height": 16}
    (tmp_path / "given.json").write_text(json.dumps(given))
    done = ran("mesh", tmp_path / "given.json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    np.testing.assert_allclose(found["turned"], light.rotated(70.0).sh(3), atol=1e-6)
    expected = albedo * transfer[:, 9:] * np.maximum(transfer[:, :9] @ light.sh(3), 0.0)
    np.testing.assert_allclose(found["radiance"], expected, atol=1e-9)
    # Texels are points here and areas there.
    np.testing.assert_allclose(found["projected"], light.sh(3), atol=0.01 * np.abs(light.sh(3)).max())
    assert [text.split(":")[0] for text in found["refused"]] == [
        "this glTF has no live light",
        "live light of version 99, this loader reads 1",
        "live light must have 9 coefficients",
    ]
