"""Inserted objects in the bundle and on the page: what they do to splats, and that they are seen where they stand."""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, chromium
from disc_scenes import form_factor
from insert_places import card, disc, floor_place
from live_scene import live_scene

from relight import RelightRequest
from relight.jobs.folders import relight_files
from relight.live.objects import FILE, MESH, MOVABLE_FILE, UNIT, objects_of
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.splats import SH_C0, Splats

pytestmark = [
    pytest.mark.filterwarnings("ignore:the light of the capture is unknown"),
    pytest.mark.filterwarnings("ignore:.*could not be separated"),
]

FRAMES = "() => new Promise((done) => { let n = 0; const f = () => ++n > 4 ? done() : requestAnimationFrame(f); f(); })"

ROOT = Path(__file__).parents[3]


def darkened(splats, rows, gains):
    """Splats some of whose display colours, with .055 added, are multiplied."""
    sh = splats.sh.astype(np.float64)
    sh[rows, 0] = (gains * (SH_C0 * sh[rows, 0] + 0.555) - 0.555) / SH_C0
    return replace(splats, sh=sh.astype(np.float32))


def test_gains_are_those_of_the_colours_and_only_changed_rows_are_stored():
    splats = live_scene()[3].splats
    rows = np.array([2, 5, 11])
    gains = np.random.default_rng(1).uniform(0.2, 1.4, (3, 3))
    found = objects_of(splats, darkened(splats, rows, gains), b"", 30.0)
    np.testing.assert_array_equal(found.rows, rows)
    np.testing.assert_allclose(found.gains / UNIT, gains, atol=1 / UNIT)  # half a step, and float32
    assert found.described() == {"file": FILE, "rows": 3, "unit": UNIT, "light": 0, "angle_deg": 30.0}
    assert len(found.tobytes()) == 3 * 10
    assert len(objects_of(splats, splats, b"", 0.0).rows) == 0


def test_rows_follow_the_order_of_the_bundle():
    splats = live_scene()[3].splats
    found = objects_of(splats, darkened(splats, np.array([1, 4]), np.array([[0.5], [0.25]])), b"x", 0.0)
    order = np.array([4, 0, 1, 3])  # of which row 2 is gone
    moved = found.in_order(order)
    np.testing.assert_array_equal(moved.rows, [0, 2])
    np.testing.assert_array_equal(moved.gains[:, 0], found.gains[[1, 0], 0])
    assert moved.described()["mesh"] == MESH
    np.testing.assert_array_equal(found.in_order(np.array([0, 1])).rows, [1])


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The results of a disc that hovers over a grey floor of splats, and of a blue card of splats beside it, as
    captured."""
    folder = tmp_path_factory.mktemp("objects")
    place, (blue, _) = floor_place(folder), card(folder, (0.1, 0.1, 0.9))
    inserted = f"{disc(folder)} at=0,0.4,0 albedo=.8,.4,.2", f"{blue} at=-1.6,0.05,.5"
    kinds = {"formats": ("web", "live", "splat"), "albedo": "captured", "output": folder / "out"}
    relight_files(RelightRequest(place, inserted=inserted, **kinds))
    return folder / "out"


@pytest.mark.slow
def test_the_bundle_has_the_shadow_that_the_relit_splat_has(written):
    meta = json.loads((written / "live" / "live.json").read_text())
    entry = meta["objects"]
    data = (written / "live" / FILE).read_bytes()
    rows = np.frombuffer(data[: 4 * entry["rows"]], "<u4")
    gains = np.frombuffer(data[4 * entry["rows"] :], "<u2").reshape(-1, 3) / entry["unit"]
    assert (np.diff(rows.astype(int)) > 0).all() and gains.min() < 0.8
    # Rows of the bundle follow another curve than those of the source: compare by place.
    captured, relit = Splats.load(written / "live" / "splat.ply"), Splats.load(written / "relit_splat.ply")
    colors = {tuple(place): sh for place, sh in zip(relit.means.tolist(), relit.sh[:, 0], strict=True)}
    shown = SH_C0 * captured.sh[rows, 0] + 0.555
    known = np.array([SH_C0 * colors[tuple(place)] + 0.555 for place in captured.means[rows].tolist()])
    np.testing.assert_allclose(gains * shown, known, atol=2 / UNIT)
    assert (written / "live" / MESH).read_bytes() == (written / MESH).read_bytes()
    sizes = [12 * (e["vertices"] + e["faces"]) + 36 * e["directions"] for e in entry["movable"]]
    assert (written / "live" / MOVABLE_FILE).stat().st_size == sum(sizes)
    added = Splats.load(written / "live" / entry["movable"][1]["splats"])
    assert len(added) == len(relit) - len(captured)


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
def test_a_moved_disc_hides_its_form_factor_wherever_it_is_moved_and_however_turned():
    # A disc of radius .5 above a level floor in an even light; it sends back nothing.
    radius, height, offset = 0.5, 0.3, [0.7, 0.2, -1.1]
    edge = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    rim = np.stack([radius * np.cos(edge), np.full(64, height), radius * np.sin(edge)], axis=1)
    faces = [[64, i, (i + 1) % 64] for i in range(64)]
    distance = np.array([1e-6, 0.2, 0.4, 0.6, 0.8, 1.2])
    floor = np.stack([distance, 0 * distance, 0 * distance], axis=1)
    directions = fibonacci_sphere(1024)
    wish = {
        "positions": np.vstack([rim, [[0.0, height, 0.0]]]).ravel().tolist(),
        "indices": np.ravel(faces).tolist(),
        "directions": directions.ravel().tolist(),
        "light": [4.0 * np.pi / 1024] * 3072,
        "sent": [0.0] * 3072,
        "even": 1024,
        "move": [*offset, 0.8],
        "places": [floor.ravel().tolist(), (floor + offset).ravel().tolist()],
    }
    script = ROOT / "tests/support/moved_object.mjs"
    command = ["node", script, ROOT / "relight/live/web/objects.js"]
    done = subprocess.run(command, input=json.dumps(wish), capture_output=True, text=True, check=True, timeout=60)
    before, after = (np.array(each).reshape(-1, 3) ** 2.4 for each in json.loads(done.stdout))
    factor = form_factor(distance, height, radius)
    # 1,024 directions give 2% of the light each way, and the map's offset moves the edge by 2% of the disc.
    np.testing.assert_allclose(before, np.maximum(1.0 - factor, 0.03)[:, None] * [1, 1, 1], atol=0.03)
    np.testing.assert_allclose(after, before, atol=0.03)


@pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
def test_the_page_shows_the_object_and_its_shadow_in_their_own_light_alone(written):
    with Browser(f"file://{written}/relit.html#renderer=webgl&noui&nopanel&sky=0", (320, 240)) as page:
        page.wait("window.relight && relight.drawn")

        def shown(**state):
            before = page.run("relight.drawn")
            page.run(f"relight.set({json.dumps(state)})")
            page.wait(f"relight.drawn > {before}")
            page.run(f"({FRAMES})()")
            return page.picture() / 255.0

        own = shown()
        assert page.said == []
        blue = own[..., 2] - own[..., 0] > 0.1
        assert blue.sum() > 50  # the inserted splats
        orange = own[..., 0] - own[..., 2] > 0.1
        assert orange.sum() > 50
        others = {"another": shown(light=1), "captured": shown(light=0, view="captured")}
        for name, picture in others.items():
            assert not (np.abs(picture[..., 0] - picture[..., 2]) > 0.1).any(), name
        darker = (others["captured"] - own).mean(axis=2)[~(orange | blue)] > 0.03
        assert darker.sum() > 50  # the shadow
        again = shown(view="relit", light=0)
        np.testing.assert_allclose(again, own, atol=2 / 255)
        brighter = shown(exposure=1.0)
        middle, twice = (linear_from_srgb(np.median(each[orange], axis=0)) for each in (own, brighter))
        np.testing.assert_allclose(twice[2], 2 * middle[2], rtol=0.05)  # 8 bits of a dark blue
        shown(exposure=0.0)
        _check_moved(page, own, orange, blue)


def _check_moved(page, own, orange, blue):
    """A drag moves the disc with its shadow, a double click puts it back."""

    def mouse(kind, x, y, clicks=1):
        page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=clicks)

    rows, columns = np.nonzero(orange)
    x, y = float(columns.mean()), float(rows.mean())
    for kind, to in (("mousePressed", 0), ("mouseMoved", 20), ("mouseMoved", 50), ("mouseReleased", 50)):
        before = page.run("relight.drawn")
        mouse(kind, x + to, y)
        if kind == "mouseMoved":
            page.wait(f"relight.drawn > {before}")
    page.run(f"({FRAMES})()")
    moved = page.picture() / 255.0
    there = moved[..., 0] - moved[..., 2] > 0.1
    assert there.sum() > 0.7 * orange.sum()
    assert np.nonzero(there)[1].mean() - x > 30
    # The other object stays; its rims let the floor through.
    np.testing.assert_allclose(moved[blue], own[blue], atol=6 / 255)
    brighter, floor = (moved - own).mean(axis=2), ~(orange | there | blue)
    assert (brighter[floor] > 0.03).sum() > 50  # the old shadow is gone
    assert (brighter[floor] < -0.03).sum() > 50  # a new one is there
    before = page.run("relight.drawn")
    for clicks in (1, 2):
        mouse("mousePressed", x + 50, y, clicks)
        mouse("mouseReleased", x + 50, y, clicks)
    page.wait(f"relight.drawn > {before}")
    page.run(f"({FRAMES})()")
    np.testing.assert_allclose(page.picture() / 255.0, own, atol=2 / 255)
    assert page.said == []
