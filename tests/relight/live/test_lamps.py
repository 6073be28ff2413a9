"""Placed lamps and captured light in what is live: the documented reader finds what a relit splat shows."""

import json
import runpy
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, chromium
from lit_rooms import room
from live_scene import TILT, scene_and_splats

from relight import LightingOptions
from relight.jobs.job import Job
from relight.jobs.writer import Writer
from relight.lamps.shapes import SphereLamp, SpotLamp
from relight.lamps.spec import read_lamps
from relight.light.loading import CapturedLight
from relight.live.terms import Source, as_white, sources_of, term_of
from relight.request import RelightRequest
from relight.splats import Binding
from relight.splats.light_ratio import CURVE_POWER
from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import describe
from splat2mesh.splats.formats import read_splats, write_splats
from splat2mesh.splats.splats import SH_C0, Splats

ROOT = Path(__file__).parents[3]

CAPTURED = 0.2


def in_splat(point):
    """A place of the scene in the frame of the splat."""
    return tuple(float(each) for each in (np.linalg.inv(TILT) @ [*point, 1.0])[:3])


BULB = SphereLamp(in_splat((1.0, 0.9, 0.6)), 0.05, radiance=(600.0, 250.0, 100.0))
SPOT = SpotLamp(in_splat((-1.0, 2.0, 0.0)), in_splat((-0.7, 0.0, 0.3)), (0.0, 9.0, 12.0), 25.0, 15.0)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A scene whose splat is beside it."""
    path = tmp_path_factory.mktemp("scene")
    scene, splats = scene_and_splats()
    write_splats(path / "plate.ply", splats)
    return replace(scene, source=describe(path / "plate.ply"))


def job_of(scene, *lamps, env="captured", captured=CAPTURED, **more):
    lighting = LightingOptions(tolerance=0.05, placed=lamps, captured=captured, **more)
    return Job(RelightRequest(scene, env, lighting, albedo="captured", formats=("live", "web"), caching="none"))


@pytest.fixture(scope="module")
def reader():
    return runpy.run_path(str(ROOT / "examples/read_bundle.py"))


@pytest.fixture(scope="module")
def written(scene, tmp_path_factory):
    """The folder of a bundle with both lamps."""
    job, path = job_of(scene, BULB, SPOT), tmp_path_factory.mktemp("lamps") / "out"
    Writer(job).write(next(iter(job.shaded())), path)
    return path


def expected_change(job, splats):
    """The change of light of a relit splat by the same binding, without its fit in views."""
    shaded, look = next(iter(job.shaded())), job.known.appearance
    binding = Binding(splats, job.known.scene, views=())
    relit = binding.relit(look.irradiance, shaded.shading.received, shaded.exposure)
    color = 0.5 + SH_C0 * splats.sh[:, 0]
    return ((0.5 + SH_C0 * relit.sh[:, 0] + 0.055) / (color + 0.055)) ** CURVE_POWER


def apart(found, expected):
    """The relative root mean square of what is apart, where nothing is so bright that it runs into white."""
    shown = expected < 1.0
    assert shown.mean() > 0.7
    return np.sqrt(np.mean((found - expected)[shown] ** 2) / np.mean(expected[shown] ** 2))


def reader_means(written):
    """Where the splats of the bundle are, row by row."""
    return read_splats(written / "live/splat.ply").means


@pytest.mark.parametrize(
    ("lamps", "strengths"),
    [
        ((BULB, SPOT), None),
        ((SPOT,), (CAPTURED, 0.0, 1.0)),
        ((BULB,), (CAPTURED, 1.0, 0.0)),
        ((), (CAPTURED, 0.0, 0.0)),
    ],
    ids=["both", "bulb off", "spot off", "captured light alone"],
)
def test_the_bundle_has_the_light_of_the_relit_splat_lamp_by_lamp(reader, scene, written, lamps, strengths):
    bundle = reader["read"](written / "live")
    light = bundle[0]["lights"][0]
    order = np.lexsort(reader_means(written).T)
    splats = scene_and_splats()[1]
    expected = expected_change(job_of(scene, *lamps), splats)[np.lexsort(splats.means.astype(np.float32).T)]
    found = reader["change"](bundle, light, strengths=strengths)[order]
    stated = max(term["error"] for term in bundle[0]["terms"])
    assert apart(found, expected) < stated + 0.02  # relit splats blend logarithms between vertices


def with_splats(found, folder):
    """(Scene, Splats): a room with a splat at every other vertex, beside it on disk."""
    places = found.vertices[::2]
    sh = ((found.colors_srgb[::2, None] / 255.0 - 0.5) / SH_C0).astype(np.float32)
    quats, size = np.tile([1.0, 0.0, 0.0, 0.0], (len(places), 1)), np.full((len(places), 3), 0.03)
    splats = Splats(places, size, quats, np.full(len(places), 0.8), sh)
    write_splats(folder / "room.ply", splats)
    return replace(found, source=describe(folder / "room.ply")), splats


def grey_room():
    """The closed box in grey: its light cannot be estimated."""
    found = room()[0]
    grey = np.full_like(found.colors_srgb, 120)
    return Scene([Mesh(found.vertices, found.normals, found.faces, grey)], capture=found.capture)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("grey", "env", "more"),
    [
        (False, "sunset", {}),
        (False, "sunset", {"lamps": "off"}),
        (False, "noon", {"lamps": 0.5, "env_scale": 0.4}),
        (False, "sunset", {"lamps": {1: 0.3}}),
        (False, "captured", {"lamps": 0.7}),
        (True, "sunset", {}),
    ],
    ids=["lamps on", "lamps off", "dimmed", "one dimmed", "other light first", "unknown light"],
)
@pytest.mark.filterwarnings("ignore:this is a closed room")
@pytest.mark.filterwarnings("ignore:.lamps.. found no lamp")
def test_what_is_assumed_of_a_room_that_lets_no_light_in_is_live_too(reader, tmp_path, grey, env, more):
    """Every light of the bundle, as the relit splat under it; but for the lamp itself, which none of them changes."""
    scene, splats = with_splats(grey_room() if grey else room()[0], tmp_path)
    lighting = LightingOptions(tolerance=0.05, **more)
    asked = RelightRequest(scene, env, lighting, albedo="estimated", formats=("live",))
    job = Job(replace(asked, caching="none"))
    Writer(job).write(next(iter(job.shaded())), tmp_path / "out")
    bundle = reader["read"](tmp_path / "out/live")
    there = np.lexsort(reader_means(tmp_path / "out").T)
    order = np.lexsort(splats.means.T)
    names = {light["name"]: light for light in bundle[0]["lights"]}
    known = job.known.appearance.room
    dull = np.ones(len(splats), bool) if known is None else ~known.glow.any(axis=1)[::2]
    for name in (env, "overcast"):
        change = reader["change"](bundle, names[name])[there]
        expected = expected_change(job.under(name), splats)
        shown = ((expected * linear_from_srgb(room_colors(splats)) < 0.75) & dull[:, None])[order]
        off = (change - expected[order])[shown]
        # Of what the bytes may add, and of the lamp's neighbours, whose splats blend with it.
        assert shown.mean() > 0.6 and np.sqrt(np.mean(off**2)) < 0.03 * np.sqrt(np.mean(expected[order][shown] ** 2))


def room_colors(splats):
    """Display colours (N, 3) of splats without harmonics."""
    return np.clip(0.5 + SH_C0 * splats.sh[:, 0], 0.0, 1.0).astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env", "captured", "more"),
    [
        ("captured", 0.3, {}),
        ("captured", 1.0, {"lamps": 0.2}),
        ("noon", None, {"lamps": 0.5}),
    ],
    ids=["as captured", "own lamp dimmed", "no sky gets in"],
)
@pytest.mark.filterwarnings("ignore:this is a closed room")
def test_lamps_in_a_closed_room(reader, tmp_path, env, captured, more):
    found = room()[0]
    scene, splats = with_splats(found, tmp_path)
    bulb = SphereLamp(tuple(scene.bounds.mean(axis=0).tolist()), 0.1, radiance=(60.0, 30.0, 15.0))
    # As near as the 64 bounce rays of the bundle.
    lighting = LightingOptions(tolerance=0.03, placed=(bulb,), captured=captured, **more)
    job = Job(RelightRequest(scene, env, lighting, albedo="estimated", formats=("live",), caching="none"))
    Writer(job).write(next(iter(job.shaded())), tmp_path / "out")
    bundle = reader["read"](tmp_path / "out/live")
    change = reader["change"](bundle, bundle[0]["lights"][0])[np.lexsort(reader_means(tmp_path / "out").T)]
    order = np.lexsort(splats.means.T)
    expected = expected_change(job, splats)[order]
    shown = expected * linear_from_srgb(found.colors_srgb[::2] / np.float32(255.0))[order] < 0.75
    assert shown.mean() > 0.6 and (bundle[4][:, 7] & 3 == 1).all()
    off = (change - expected)[shown]
    assert np.sqrt(np.mean(off**2)) < 0.025 * np.sqrt(np.mean(expected[shown] ** 2))


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
@pytest.mark.parametrize("light", [0, 1])
def test_the_code_of_the_page_adds_them_as_the_reader_does(reader, written, tmp_path, light):
    bundle = reader["read"](written / "live")
    found = lit(written / "live", tmp_path, light=light, sun=0)
    expected = reader["change"](bundle, bundle[0]["lights"][light])
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)
    red = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    alone = lit(written / "live", tmp_path, light=0, sun=0, factors=red)
    np.testing.assert_allclose(alone, [2.0, 0.0, 0.0] * bundle[5][1], rtol=1e-4, atol=1e-6)


def lit(folder, tmp_path, **wish):
    """The change of light (N, 3) by the code of the page, in node."""
    wish["change"] = str(tmp_path / "k")
    command = ["node", ROOT / "tests/support/live_light.mjs", ROOT / "relight/live/web", folder, json.dumps(wish)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert "error" not in json.loads(done.stdout), done.stdout
    return np.fromfile(tmp_path / "k", np.float32).reshape(-1, 3)


def test_a_lamp_is_stored_where_it_shines_alone():
    """A wall of 1,000 vertices, of which a lamp reaches the first hundred and, after ten dark ones, ten more."""
    light, captured = np.zeros((1000, 3), np.float32), np.full((1000, 3), 0.5, np.float32)
    light[:100], light[110:120] = 0.5, [0.25, 1e-3, 0.0]
    before, source = np.full((1000, 3), 1e3, np.float32), Source("lamp", "x", np.ones(3), 1e3 * light)
    term = term_of(source, captured, before, np.where(light.any(axis=1), 1e-9, 1.0), lambda values: values)
    np.testing.assert_array_equal(term.runs, [[0, 100], [110, 10]])
    assert len(term.tobytes()) == 2 * 8 + 110 * 3
    np.testing.assert_allclose(term.values(1000), light / 1.01, rtol=0.04, atol=1e-5)
    dark = term_of(source._replace(received=0 * light), captured, before, np.ones(1000), lambda values: values)
    assert not len(dark.runs) and not dark.values(1000).any() and dark.error == 0.0


def test_a_lamp_in_white_is_the_same_lamp_without_its_colour():
    direct = np.random.default_rng(0).uniform(0.0, 2.0, (50, 1)).astype(np.float32)
    for color in ([4.0, 1.0, 0.2], [3.0, 0.0, 0.0]):
        white, tint = as_white(direct * np.float32(color), np.array(color))
        np.testing.assert_allclose(white * tint, direct * color, rtol=1e-5)
        assert tint @ [0.2126, 0.7152, 0.0722] == pytest.approx(1.0)
    sign = np.where(np.arange(50)[:, None] < 25, direct * [2.0, 0.0, 0.0], direct * [0.0, 0.0, 2.0])
    white, tint = as_white(sign.astype(np.float32), np.array([2.0, 0.0, 2.0]), mixed=True)
    np.testing.assert_allclose(white * tint, sign, rtol=1e-5)


def test_a_bundle_without_lamps_says_nothing_of_them(scene, tmp_path):
    job = Job(RelightRequest(scene, "overcast", albedo="captured", formats=("live",), caching="none"))
    Writer(job).write(next(iter(job.shaded())), tmp_path / "out")
    meta = json.loads((tmp_path / "out/live/live.json").read_text())
    assert meta["version"] == 1 and "terms" not in meta and not (tmp_path / "out/live/terms.bin").exists()
    assert not {"captured", "unit", "sky"} & set(meta["lights"][0])


@pytest.fixture(scope="module")
def page(written):
    with Browser(f"file://{written}/relit.html#renderer=webgl&noui&sky=0", (480, 360)) as browser:
        browser.wait("window.relight && relight.drawn")
        yield browser


FRAMES = "() => new Promise((done) => { let n = 0; const f = () => ++n > 4 ? done() : requestAnimationFrame(f); f(); })"


def moved(page, script):
    """The picture, (H, W, 3) in 0..1, after a control of the panel was used."""
    before = page.run("relight.drawn")
    page.run(script)
    page.wait(f"relight.drawn > {before}")
    page.run(f"({FRAMES})()")
    return page.picture()[:, 260:] / 255.0


def slide(row, value):
    slider = f"document.querySelectorAll('#r-terms input[type=range]')[{row}]"
    return f"(() => {{ {slider}.value = {value}; {slider}.dispatchEvent(new Event('input')); }})()"


@pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
def test_sliders_of_the_page_dim_and_colour_lamp_by_lamp(page):
    first = moved(page, "relight.set({})")
    names = "[...document.querySelectorAll('#r-terms label span')].map((each) => each.textContent)"
    assert page.run(names) == ["Captured light", "Lamp 1", "Lamp 2"]
    assert page.run("document.querySelector('#r-terms output').textContent") == "x 0.20"
    brighter = moved(page, slide(1, 2))
    assert (brighter - first).mean() > 0.01
    again = moved(page, slide(1, 0))
    np.testing.assert_allclose(again, first, atol=0.01)
    picker = "document.querySelectorAll('#r-terms input[type=color]')[0]"
    green = moved(page, f"(() => {{ {picker}.value = '#00ff00'; {picker}.dispatchEvent(new Event('input')); }})()")
    assert (first - green)[..., 0].mean() > 0.005 and (green - first)[..., 1].mean() > 0.0
    off = moved(page, "document.querySelectorAll('#r-terms input[type=checkbox]')[1].click()")
    assert (green - off)[..., 1].mean() > 0.005
    night = moved(page, slide(0, 0))
    assert (off - night).mean() > 0.01
    assert page.said == []


def test_engines_get_the_lamps_in_the_frame_of_the_scene_and_as_bright_as_they_are_shown(scene):
    (bulb,) = job_of(scene, BULB).lamps_shown(CapturedLight(), 1.0).lamps
    assert bulb.position == pytest.approx((1.0, 0.9, 0.6)) and bulb.radiance == BULB.radiance
    lighting = LightingOptions(placed=(BULB,))
    request = RelightRequest(scene, "captured", lighting, albedo="captured", exposure_ev=1.0, caching="none")
    (bulb,) = Job(request).lamps_shown(CapturedLight(), 2.0).lamps
    assert bulb.radiance == pytest.approx(np.multiply(2.0, BULB.radiance))


def test_of_many_lamps_the_last_share_a_term(scene):
    lamps = [replace(BULB, position=in_splat((0.02 * number, 0.5, 1.2))) for number in range(40)]
    job = job_of(scene, *lamps)
    sources = sources_of(job.mix)
    assert [each.name for each in sources[1:]] == [*(f"Lamp {n + 1}" for n in range(31)), "9 more lamps"]
    together = sum(source.color * source.received for source in sources[1:])
    everything = job.mix.lamp_light.placed.received
    assert np.sqrt(np.mean((together - everything) ** 2)) < 0.02 * np.sqrt(np.mean(everything**2))


def test_a_live_mesh_says_that_lamps_are_not_on_it(scene, tmp_path):
    request = RelightRequest(
        scene, "captured", LightingOptions(placed=(BULB,)), albedo="captured", formats=("glb",), live_mesh=True
    )
    job = Job(request)
    with pytest.warns(DataWarning, match="live.glb shows the light of an environment alone"):
        Writer(job).write(next(iter(job.shaded())), tmp_path / "out")
    for name in ("live.glb", "relit.glb"):
        assert len(read_lamps(tmp_path / "out" / name)) == 1
