"""The page's own code, run by node, against Python."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from live_scene import live_scene

from relight import Environment
from relight.live.bundle import write_bundle
from relight.live.compression import Compressed
from relight.live.lights import light_of
from relight.live.parts import LivePart, LiveParts
from relight.live.response import about_y, light_vector, turned
from relight.sh import harmonics

ROOT = Path(__file__).parents[3]
WEB = ROOT / "relight/live/web"

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("live")
    write_bundle(path, live_scene()[3], exact=False)
    return path


def lit(folder, **wish):
    script = ROOT / "tests/support/live_light.mjs"
    done = subprocess.run(
        ["node", script, WEB, folder, json.dumps(wish)], capture_output=True, text=True, check=True, timeout=60
    )
    return json.loads(done.stdout)


def expected_change(live, number, angle_deg):
    """By the arrays themselves, without files."""
    light = live.lights[number]
    rest, whole = (light.exposure * turned(each, angle_deg) for each in (light.rest, light.whole))
    vector = light_vector(rest, whole, light.lamps)
    basis = live.basis
    directions = basis.directions * basis.direction_scales[:, None, None]
    means = directions[0] + np.einsum("cd,dkx->ckx", basis.means * basis.scales[:, :1], directions[1:])
    components = np.einsum("cwd,dkx->cwkx", basis.components * basis.scales[:, 1:, None], directions[1:])
    cluster = live.transfer[:, :2].copy().view("<u2")[:, 0]
    weights = live.transfer[:, 2:].view(np.int8)
    table = np.einsum("ckx,kx->cx", means, vector), np.einsum("cwkx,kx->cwx", components, vector)
    return table[0][cluster] + np.einsum("nw,nwx->nx", weights, table[1][cluster])


@pytest.mark.parametrize(("number", "angle_deg"), [(0, 0.0), (1, 200.0)])
def test_changes_are_those_of_python(folder, tmp_path, number, angle_deg):
    live = live_scene()[3]
    lit(folder, light=number, angle=np.radians(angle_deg), sun=0, change=str(tmp_path / "k"))
    found = np.fromfile(tmp_path / "k", np.float32).reshape(-1, 3)
    np.testing.assert_allclose(found, expected_change(live, number, angle_deg), rtol=1e-4, atol=1e-4)


def test_gains_follow_the_curve_and_roll_off(folder, tmp_path):
    live = live_scene()[3]
    lit(folder, light=1, change=str(tmp_path / "k"), gains=str(tmp_path / "g"), angle=0.4)
    ratio = np.fromfile(tmp_path / "k", np.float32).reshape(-1, 3)
    gains = np.fromfile(tmp_path / "g", np.uint16).reshape(-1, 4)[:, :3] / 1024
    shown = np.clip(0.5 + 0.28209479 * live.splats.sh[:, 0], 0, 1)
    linear = np.maximum(np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4), 1e-4)
    start = np.maximum(0.8, linear)
    room = np.maximum(1 - start, 1e-3)
    rolled = start - room * np.expm1(-np.maximum(ratio * linear - start, 0) / room)
    ratio = np.where(ratio * linear > start, rolled / linear, ratio)
    expected = np.clip(ratio, 2.0**-14, 1e4) ** (1 / 2.4)
    assert (ratio * linear > start).any() or (ratio * linear).max() > 0.5
    np.testing.assert_allclose(gains, expected, rtol=0.01, atol=2e-3)  # colours are bytes in the compressed file


def test_shadows_of_suns_are_those_that_rays_find(folder, tmp_path):
    live = live_scene()[3]
    with_sun, without = (str(tmp_path / name) for name in "ab")
    lit(folder, light=1, change=with_sun)
    lit(folder, light=1, change=without, sun=0)
    found = (np.fromfile(with_sun, np.float32) - np.fromfile(without, np.float32)).reshape(-1, 3)[:, 1]
    sun = live.lights[1].suns
    assert len(sun) == 1
    direction = sun.directions[0]
    frame = np.array(live.facts["frame"]["scene_from_splat"])
    moved = live.splats.means @ frame[:3, :3].T + frame[:3, 3]
    plate = (np.abs(moved[:, 1]) < 1e-3) & (np.abs(moved[:, [0, 2]]) < 1.35).all(axis=1)
    # The ball hides the sun where the ray passes within its radius.
    apart = np.linalg.norm(np.cross(moved - [0, 0.8, 0], direction), axis=1)
    full = sun.weights[0, 1] * 0.7 / np.pi * direction[1] / 1.01  # own = S / (S^2 + e^2), e = .1
    inside, outside = plate & (apart < 0.42), plate & (apart > 0.58)
    assert inside.sum() > 20 and outside.sum() > 200
    assert np.abs(found[inside]).max() < 1e-3
    np.testing.assert_allclose(found[outside], full, rtol=0.05)


def test_leaves_take_a_sun_by_their_harmonics(folder, tmp_path):
    live = live_scene()[3]
    shutil.copytree(folder, tmp_path / "b")
    surface = live.surfaces.packed.copy()
    surface[::2, 7] |= 63 << 2  # every second splat is leaves, through and through
    (tmp_path / "b/surface.bin").write_bytes(surface.tobytes())
    names = "with sun", "without"
    for name, sun in zip(names, (1, 0), strict=True):
        lit(tmp_path / "b", light=1, angle=0.7, sun=sun, change=str(tmp_path / name))
    both, without = (np.fromfile(tmp_path / name, np.float32).reshape(-1, 3) for name in names)
    suns = live.lights[1].suns
    alone = live.lights[1]._replace(rest=about_y(suns.sh(10)), whole=np.zeros((16, 3)), lamps=0.0)
    expected = np.maximum(expected_change(live._replace(lights=[alone]), 0, np.degrees(0.7)), 0.0)
    assert expected.max() > 0.5
    np.testing.assert_allclose((both - without)[::2], expected[::2], rtol=1e-3, atol=1e-4)


def write_hdr(path, image, runs=True):
    """A Radiance file of (H, W, 3): run-length encoded, or plain."""
    from relight.live.lights import rgbe

    packed = rgbe(image)
    height, width = image.shape[:2]
    rows = b""
    for row in packed:
        if not runs:
            rows += row.tobytes()
            continue
        rows += bytes([2, 2, width >> 8, width & 255])
        for channel in row.T:
            start = 0
            while start < width:
                same = 1
                while start + same < width and same < 127 and channel[start + same] == channel[start]:
                    same += 1
                if same > 2:
                    rows += bytes([128 + same, channel[start]])
                else:
                    same = 1
                    rows += bytes([1, channel[start]])
                start += same
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width) + rows)


@pytest.mark.parametrize("runs", [True, False])
@pytest.mark.parametrize("size", [(64, 128), (100, 200)])
def test_a_dropped_hdr_is_the_light_that_python_reads(folder, tmp_path, runs, size):
    rng = np.random.default_rng(3)
    down, right = np.meshgrid(np.arange(size[0]) / size[0], np.arange(size[1]) / size[1], indexing="ij")
    image = (1.5 + np.sin(6.28 * right + 3 * down))[..., None] * [1.0, 0.8, 0.5] + rng.uniform(0, 0.2, (*size, 3))
    write_hdr(tmp_path / "sky.hdr", image, runs)
    read = Environment.load(tmp_path / "sky.hdr")
    result = lit(folder, hdr=str(tmp_path / "sky.hdr"))
    expected = about_y(read.sh(10))
    np.testing.assert_allclose(np.reshape(result["rest"], (100, 3)), expected, atol=0.01 * np.abs(expected).max())
    assert result["mean"] == pytest.approx(read.mean_luminance, rel=5e-3) and result["suns"] == []


def test_the_sun_of_a_dropped_hdr_is_found_where_it_is(folder, tmp_path):
    write_hdr(tmp_path / "noon.hdr", np.asarray(Environment.load("noon").radiance))
    result, own = lit(folder, hdr=str(tmp_path / "noon.hdr")), light_of(Environment.load("noon"), 1.0)
    (sun,) = result["suns"]
    assert np.dot(sun["direction"], own.suns.directions[0]) > np.cos(np.radians(2.0))
    assert sun["weight"] == pytest.approx(own.suns.weights[0], rel=0.05)
    basis = harmonics.evaluate(np.array([sun["direction"]]) @ np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]).T, 4)
    whole = np.reshape(result["rest"], (100, 3))[:16] + basis.T @ np.array([sun["weight"]])
    np.testing.assert_allclose(whole, np.reshape(result["whole"], (16, 3)), atol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89PNG", "not a Radiance"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_luv\n\n-Y 1 +X 1\n0000", "luv"),
        (b"#?RADIANCE\n\n-Y 64 +X 128\n\2\2\0\x80abc", "cut short"),
        (b"#?RADIANCE\n\n+X 128 -Y 64\n", "rows do not run"),
        (b"#?RADIANCE\n", "rows do not run"),
    ],
)
def test_a_broken_hdr_is_refused_in_one_line(folder, tmp_path, content, message):
    (tmp_path / "x.hdr").write_bytes(content)
    result = lit(folder, hdr=str(tmp_path / "x.hdr"))["error"]
    assert message in result and "\n" not in result


def test_the_saved_ply_is_the_relit_splat(folder, tmp_path):
    from splat2mesh.splats.formats import read_splats

    live = live_scene()[3]
    lit(folder, light=1, ply=str(tmp_path / "x.ply"), gains=str(tmp_path / "g"))
    saved, packed = read_splats(tmp_path / "x.ply"), read_splats(folder / "splat.compressed.ply")
    for name in ("means", "scales", "opacities"):
        np.testing.assert_allclose(getattr(saved, name), getattr(packed, name), rtol=1e-4, atol=1e-5)
    agree = np.abs((saved.quats_wxyz * packed.quats_wxyz).sum(axis=1))
    np.testing.assert_allclose(agree, 1.0, atol=1e-5)
    gains = np.fromfile(tmp_path / "g", np.uint16).reshape(-1, 4)[:, :3] / 1024
    c = 0.28209479
    np.testing.assert_allclose(0.555 + c * saved.sh[:, 0], gains * (0.555 + c * packed.sh[:, 0]), atol=2e-3)
    most = np.maximum(1.0, gains.max())
    ratio = saved.sh[:, 1:] / np.where(packed.sh[:, 1:] == 0, 1, packed.sh[:, 1:])
    assert (ratio <= np.minimum(gains[:, None], most) + 1e-3).all() and len(live.splats) == len(saved)


def test_another_splat_is_refused_in_one_line(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "b")
    path = tmp_path / "b" / "splat.compressed.ply"
    path.write_bytes(path.read_bytes()[:-1] + b"\1")
    result = lit(tmp_path / "b")["error"]
    assert "SHA-256 differs" in result and "\n" not in result


def test_rows_come_back_from_clusters_as_they_went_in():
    rng = np.random.default_rng(0)
    from relight.live.compression import compress, near_clusters

    centers, axes = rng.normal(size=(4, 12)) * 10, rng.normal(size=(4, 2, 12))
    of = rng.integers(0, 4, 3000)
    rows = centers[of] + np.einsum("nw,nwd->nd", rng.normal(size=(3000, 2)), axes[of])
    rows, counts = rows.astype(np.float32), np.ones(3000, np.float32)
    found: Compressed = compress(rows, counts, 2, near_clusters(rows))
    error = np.sqrt(np.mean((found.rows() - rows) ** 2)) / rows.std()
    assert error < 0.01  # a byte of each weight


PAINT = """
const [web] = process.argv.slice(1);
const { lookUp, texelDirection, toneMap, paintSky } = await import(`${web}/light.js`);
const [height, width] = [104, 208], out = new Uint8Array(4 * height * width), color = [0, 0, 0];
const image = Float32Array.from({ length: 64 * 128 * 3 }, (_, i) => 2 ** (6 * Math.sin(i * 12.9898) - 3));
let most = 0;
for (const angle of [0, 1.2, -9]) {
  paintSky(image, angle, 0.7, height, width, out);
  for (let row = 0, to = 0; row < height; row++) for (let column = 0; column < width; column++, to += 4) {
    lookUp(image, ...texelDirection(row, column, height, width), angle, 0.7, color);
    toneMap(color);
    for (let k = 0; k < 3; k++) most = Math.max(most, Math.abs(out[to + k] - 255 * color[k]));
  }
}
console.log(most);
"""


def test_a_painted_sky_is_the_light_looked_up_and_tone_mapped():
    """To the byte: rounding, and steps of a 65,536th of linear light."""
    command = ["node", "--input-type=module", "-e", PAINT, WEB]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert float(done.stdout) < 0.56


def test_parts_are_lit_apart_and_blended_at_their_rim(folder, tmp_path):
    live, rng = live_scene()[3], np.random.default_rng(0)
    count = len(live.splats)
    shares = rng.choice(np.float32([0, 0, 1, 0.4]), (2, count))
    kept = [
        LivePart("door", shares[0], 1.0, (1.0, 1.0, 1.0), {"name": "door"}),
        LivePart("lamp", shares[1], 0.0, (2.0, 0.7, 1.0), {}),
    ]
    order = rng.permutation(count)
    parts = LiveParts.of(kept, order)
    write_bundle(tmp_path, live._replace(parts=parts), exact=False)
    meta = json.loads((tmp_path / "live.json").read_text())
    assert [each["name"] for each in meta["parts"]] == ["door", "lamp"] and meta["parts"][0]["exposure"] == 1.0
    lights = [
        {"on": True, "factor": [1, 1, 1]},
        {"on": True, "factor": [2, 1, 0.5]},
        {"on": False, "factor": [1, 1, 1]},
    ]
    whole, found = tmp_path / "whole", tmp_path / "found"
    lit(folder, sun=0, change=str(whole))
    lit(tmp_path, sun=0, change=str(found), apart=lights)
    k, apart = (np.fromfile(path, np.float32).reshape(-1, 3) for path in (whole, found))
    own = [k, k * [2, 1, 0.5], np.ones_like(k)]
    number = np.where(shares[1] > 0, 2, (shares[0] > 0).astype(int))[order]
    share = np.where(number == 2, shares[1][order], shares[0][order])[:, None]
    second = np.choose(number[:, None], own)
    np.testing.assert_allclose(apart, k + share * (second - k), rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(apart[number == 0], k[number == 0])
    (tmp_path / "parts.bin").write_bytes(b"short")
    assert "parts.bin holds 5 bytes" in lit(tmp_path)["error"]


def test_without_parts_a_bundle_has_none():
    assert LiveParts.of([], np.arange(4)) is None
