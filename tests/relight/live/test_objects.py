"""Inserted objects in the bundle and on the page: what they do to splats, and that they are seen where they stand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from browser import Browser, chromium
from insert_places import disc, floor_place
from live_scene import live_scene

from relight import RelightRequest
from relight.folders import relight_files
from relight.live.objects import FILE, MESH, UNIT, objects_of
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.splats import SH_C0, Splats

pytestmark = pytest.mark.filterwarnings("ignore:the light of the capture is unknown")


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
    """The results of a disc that hovers over a grey floor of splats, as captured."""
    folder = tmp_path_factory.mktemp("objects")
    place = floor_place(folder)
    inserted = (f"{disc(folder)} at=0,0.4,0 albedo=.8,.4,.2",)
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


@pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
def test_the_page_shows_the_object_and_its_shadow_in_their_own_light_alone(written):
    frames = (
        "() => new Promise((done) => { let n = 0; const f = () => ++n > 4 ? done() : requestAnimationFrame(f); f(); })"
    )
    with Browser(f"file://{written}/relit.html#renderer=webgl&noui&nopanel&sky=0", (320, 240)) as page:
        page.wait("window.relight && relight.drawn")

        def shown(**state):
            before = page.run("relight.drawn")
            page.run(f"relight.set({json.dumps(state)})")
            page.wait(f"relight.drawn > {before}")
            page.run(f"({frames})()")
            return page.picture() / 255.0

        own = shown()
        assert page.said == []
        orange = own[..., 0] - own[..., 2] > 0.1
        assert orange.sum() > 50
        others = {"another": shown(light=1), "captured": shown(light=0, view="captured")}
        for name, picture in others.items():
            assert not (picture[..., 0] - picture[..., 2] > 0.1).any(), name
        darker = (others["captured"] - own).mean(axis=2)[~orange] > 0.03
        assert darker.sum() > 50  # the shadow
        again = shown(view="relit", light=0)
        np.testing.assert_allclose(again, own, atol=2 / 255)
        brighter = shown(exposure=1.0)
        middle, twice = (linear_from_srgb(np.median(each[orange], axis=0)) for each in (own, brighter))
        np.testing.assert_allclose(twice[2], 2 * middle[2], rtol=0.05)  # 8 bits of a dark blue
