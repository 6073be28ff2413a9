"""Gloss in the bundle and on the page, against what relight's own reflections are made of."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, chromium
from glossy_scene import BULB, OWN, glossy_scene, glossy_scene_with_lamps
from live_bundles import reader
from live_scene import SETTINGS, TILT, live_scene

from relight import Environment
from relight.gloss.ggx import fresnel_rise, zonal_factors
from relight.live.bundle import write_bundle
from relight.live.lights import light_of
from relight.live.live import LiveScene, live_of
from relight.live.page import write_page
from relight.live.shine import ROW
from relight.sh import harmonics
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.color import linear_from_srgb, luminance, srgb_from_linear
from splat2mesh.splats.splats import SH_C0, Splats

ROOT = Path(__file__).parents[3]
WEB = ROOT / "relight/live/web"
FRAMES = "new Promise((done) => { let n = 0; const f = () => ++n > 4 ? done() : requestAnimationFrame(f); f(); })"

EYE = [0.6, 1.4, 3.0]

in_node = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
in_browser = pytest.mark.skipif(chromium() is None, reason="chromium is not installed")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("glossy")
    write_bundle(path, glossy_scene()[-1])
    return path


@pytest.fixture(scope="module")
def by_lamps(tmp_path_factory):
    """The bundle of the same beside two lamps."""
    path = tmp_path_factory.mktemp("lamps")
    write_bundle(path, glossy_scene_with_lamps()[0])
    return path


def changes(folder, **wish):
    script = ROOT / "tests/support/gloss_change.mjs"
    asked = json.dumps({"light": 0, "eye": EYE} | wish)
    command = ["node", script, WEB, folder]
    done = subprocess.run(command, input=asked, capture_output=True, text=True, check=True, timeout=60)
    found = json.loads(done.stdout)
    return np.array(found["change"]), *(np.reshape(found[name], (-1, 3)) for name in ("places", "normals"))


def material_of_splats(live):
    """(N,) number of the material, 0 for none."""
    number = np.zeros(len(live.splats), int)
    rows = np.concatenate([np.arange(first, first + count) for first, count in live.gloss.runs.astype(int)])
    number[rows] = live.gloss.rows[:, 0]
    return number


def test_a_matt_scene_has_the_bytes_that_it_had(tmp_path):
    """Nothing glossy under the light of the capture, and no gloss asked for: the same files."""
    relighter, look, splats, live = live_scene()
    gloss = glossy_scene()[3]
    matt = gloss._replace(reflectance=np.zeros_like(gloss.reflectance))
    lights = [light_of(Environment.load(name), 0.7) for name in ("overcast", "noon")]
    look = look._replace(environment=Environment.load(OWN))
    again = live_of(LiveScene(relighter, look, splats, gloss=matt), lights, SETTINGS)
    for name, each in {"a": live, "b": again}.items():
        (tmp_path / name).mkdir()
        write_bundle(tmp_path / name, each)
        write_page(tmp_path / name, each)
    names = [path.relative_to(tmp_path / "a") for path in sorted((tmp_path / "a").rglob("*")) if path.is_file()]
    assert not (tmp_path / "b/gloss.bin").exists()
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_glossy_splats_take_a_few_bytes_and_others_none(folder):
    live, meta = glossy_scene()[-1], json.loads((folder / "live.json").read_text("utf-8"))["gloss"]
    number = material_of_splats(live)
    high = (live.splats.means @ TILT[:3, :3].T + TILT[:3, 3])[:, 1] > 0.25
    assert (number > 0)[high].mean() > 0.97 and not (number > 0)[~high].any()
    assert (folder / "gloss.bin").stat().st_size == 8 * meta["runs"] + ROW * meta["rows"]
    assert [material["metal"] for material in meta["materials"]] == [False, True]
    np.testing.assert_allclose(meta["materials"][1]["reflectance"], [0.5, 0.4, 0.2], rtol=1e-6)
    for level, alpha in zip(meta["levels"], (0.15, 0.3), strict=True):  # sharper lobes are blurred to .15
        np.testing.assert_allclose(level["factors"], zonal_factors(alpha, 10), rtol=1e-6)


def test_a_reader_that_knows_no_gloss_reads_the_bundle(folder):
    assert reader()["read"](folder)[0]["version"] == 1


@in_node
def test_the_captured_light_gives_back_what_is_taken_out(folder):
    change = changes(folder, light=2)[0]  # that of the capture
    assert np.abs(change).max() == 0.0


@in_node
@pytest.mark.parametrize(("light", "angle_deg"), [(0, 0.0), (1, 140.0)])
def test_changes_are_the_lobes_of_relights_own_pixels(folder, light, angle_deg):
    """`Reflections.relit`, written out for the places of splats: reflectance times the light about the mirrored
    direction, blurred by the lobe. The top of the ball sees all of the light."""
    live, ratio = glossy_scene()[-1], 1.7
    change, places, normals = changes(folder, light=light, angle=np.radians(angle_deg), ratio=[ratio] * 3)
    number = material_of_splats(live)
    toward = np.array(EYE) - places
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", normals, toward)
    rows = (number > 0) & (cosine > 0.1) & (normals[:, 1] > 0.3)
    mirrored = (2 * cosine[:, None] * normals - toward)[rows]
    degree, _ = harmonics.degrees_and_orders(10)
    basis = harmonics.evaluate(mirrored, 10)
    new = Environment.load(("overcast", "noon")[light]).rotated(angle_deg).sh(10) * live.lights[light].exposure
    expected = np.zeros((rows.sum(), 3))
    for kind, (alpha, reflectance) in enumerate([(0.15, [0.05] * 3), (0.3, [0.5, 0.4, 0.2])]):
        strength = np.minimum(reflectance * fresnel_rise(cosine[rows], np.full(rows.sum(), bool(kind)))[:, None], 1.0)
        factors = zonal_factors(alpha, 10)[degree][:, None]
        come, gone = (np.maximum(basis @ (factors * each), 0) for each in (new, Environment.load(OWN).sh(10)))
        mine = number[rows] == kind + 1
        expected[mine] = (strength * (come - ratio * gone))[mine]
    # Texels of 5.6 degrees, normals of a degree, and what stands around where a mirrored direction is low.
    high = mirrored[:, 1] > 0.2
    mean = np.abs(expected[high]).mean()
    assert high.sum() >= 40
    assert np.abs(change[rows] - expected)[high].mean() < 0.04 * mean
    assert not change[number == 0].any()


@in_node
def test_a_bulb_shines_as_ggx_says(by_lamps):
    """Light of a small ball on what faces it, radiance x pi sin^2, times D G / 4 n.v, widened by half of its angle."""
    live, color, eye = glossy_scene_with_lamps()[0], np.array(BULB.radiance), np.array([1.2, 2.0, 3.0])
    tint = color / luminance(color)
    bare = {"eye": list(eye), "ratio": [0.0] * 3}
    lit, places, normals = changes(by_lamps, factors=[[0, 0, 0], list(tint), [0, 0, 0]], **bare)
    dark = changes(by_lamps, factors=[[0, 0, 0]] * 3, **bare)[0]
    number = material_of_splats(live)
    way, toward = np.array(BULB.position) - places, eye - places
    far = np.linalg.norm(way, axis=1, keepdims=True)
    way, toward = way / far, toward / np.linalg.norm(toward, axis=1, keepdims=True)
    half = way + toward
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    facing, seen, cosine = (np.einsum("ij,ij->i", normals, each) for each in (way, toward, half))
    alpha = np.where(number == 1, 0.15, 0.3) + BULB.radius / (2 * far[:, 0])
    square = np.minimum(alpha, 1.0) ** 2
    density = square / np.pi / (cosine**2 * (square - 1) + 1) ** 2
    masks = [2 * x / (x + np.sqrt(square + (1 - square) * x**2)) for x in (facing, seen)]
    reflectance = np.where((number == 1)[:, None], [0.05] * 3, [0.5, 0.4, 0.2])
    rise = fresnel_rise(seen, number == 2)
    arriving = np.pi * (BULB.radius / far[:, 0]) ** 2
    expected = np.minimum(reflectance * rise[:, None], 1) * color
    expected *= (density * masks[0] * masks[1] / (4 * np.maximum(seen, 1e-3)) * arriving)[:, None]
    rows = (number > 0) & (facing > 0.2) & (seen > 0.2)
    assert rows.sum() > 60 and expected[rows].max() > 0.05
    # Bytes of light are 1.7% wide each way; a splat takes it from the corners of its face.
    np.testing.assert_allclose((lit - dark)[rows], expected[rows], rtol=0.04, atol=1e-3 * expected[rows].max())
    assert np.abs((lit - dark)[(number > 0) & (facing < -0.3) & (seen > 0.05)]).max() < 1e-9
    assert not (lit - dark)[number == 0].any()


@in_node
def test_what_is_hidden_mirrors_what_hides_it(folder):
    """The underside of the ball mirrors the plate: brighter with the plate, whatever the sky does."""
    live = glossy_scene()[-1]
    eye = {"eye": [0.3, 0.15, 2.5]}
    dark, normals = (changes(folder, **eye, hidden=[0.0] * 3)[each] for each in (0, 2))
    bright = changes(folder, **eye, hidden=[2.0] * 3)[0]
    under = (material_of_splats(live) == 2) & (normals[:, 1] < -0.4)
    over = (material_of_splats(live) > 0) & (normals[:, 1] > 0.8)
    assert np.median((bright - dark)[under], axis=0).min() > 0.0
    assert (bright - dark)[under].mean() > 10 * np.abs((bright - dark)[over]).mean()


@in_browser
def test_the_page_shows_the_lobes_as_the_eye_sees_them(by_lamps, tmp_path):
    """Its picture, against the splats drawn here in colours of the same gains and of `glossChange`."""
    live = glossy_scene_with_lamps()[0]
    write_page(tmp_path, live)
    with Browser(f"file://{tmp_path}/relit.html#renderer=webgl&noui&nopanel&sky=0", (240, 240)) as page:
        page.wait("window.relight && relight.drawn")
        pictures = {}
        for name, script in (("glossy", "0"), ("matt", "relight.bundle.gloss = null; 0")):
            before = page.run(f"{script}; relight.drawn")
            page.run("relight.set({ light: 1, turn: 140 })")
            page.wait(f"relight.drawn > {before}")
            page.run(FRAMES)
            pictures[name] = page.picture() / 255.0
        camera, most = page.run("relight.stage.camera"), np.array(page.run("relight.most"))
        gains = np.array(page.run("Array.from(relight.gains)")).reshape(-1, 4)[:, :3] / 1024.0
        light = "relight.lights[1], 140 * Math.PI / 180, relight.lights[1].exposure"
        hidden = page.run(f"relight.live.meanChange(relight.bundle, {light})")
        factors = page.run("relight.live.factorsOf(relight.bundle, relight.lights[1])")
        assert page.said == []
    back = np.linalg.inv(TILT)
    eye, target = (back[:3, :3] @ camera[key] + back[:3, 3] for key in ("position", "target"))
    view = View.look_at(eye, target, back[:3, 1], camera["fov"], 240, 240)
    ratio = gains**2.4
    size = {"light": 1, "angle": np.radians(140), "eye": list(camera["position"]), "hidden": hidden}
    size |= {"factor": factors[0], "factors": factors}
    plain = SH_C0 * live.splats.sh[:, 0] + 0.5
    lit = gains * (plain + 0.055) - 0.055
    lit += (live.splats.colors_toward(eye) - plain) * np.minimum(gains, most)
    before = linear_from_srgb(np.maximum(lit, 0.0))
    change = changes(by_lamps, **size, ratios=ratio.tolist())[0]
    shiny = np.minimum(srgb_from_linear(np.maximum(before + change, 0.02 * before)), np.maximum(lit, 1.0))
    shiny = np.where(material_of_splats(live)[:, None] > 0, shiny, lit)
    errors = {}
    for name, colors in (("glossy", shiny), ("matt", lit)):
        flat = ((colors - 0.5) / SH_C0)[:, None].astype(np.float32)
        s = live.splats
        drawn = rasterize(Splats(s.means, s.scales, s.quats_wxyz, s.opacities, flat), view)
        expected = np.clip(drawn.color + (1 - drawn.alpha[..., None]) * [0.13, 0.13, 0.14], 0, 1)
        errors[name] = np.mean((pictures[name] - expected) ** 2)
    shows = np.mean((pictures["glossy"] - pictures["matt"]) ** 2)
    assert shows > 3e-4
    # What is left is what the page's drawing differs from ours without gloss, too; the shader adds bytes and texels.
    assert errors["glossy"] < 1.2 * errors["matt"] and errors["glossy"] < shows / 4
