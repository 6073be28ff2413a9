"""The captured light set by hand in the session: sliders, maps, two clicks, and what is kept."""

import shutil
import time

import numpy as np
import pytest
from inline_worker import InlineWorker
from viewer_scenes import Clock, ball_on_plate

from relight import LightingOptions, RelightRequest
from relight.jobs.job import Job
from relight.jobs.session import session_of
from relight.light.captured_light import NAME, LikelyLight, LikelySun, offer, read_lights
from relight.light.environment import Environment
from relight.light.projections import texel_directions
from relight.light.sun_position import toward
from relight.viewer.controls import SLIDERS
from relight.viewer.hand_tool import OFFER, SUN_MAP, place_on_map
from relight.viewer.session import Session
from relight.viewer.stage import surface_colors
from relight.viewer.state import MODES
from relight.viewer.window import Window
from splat2mesh.scene.scene import Scene

SIZE = 960, 720
SUNS = (150.0, 40.0), (300.0, 60.0)


def sunny(azimuth, height):
    directions = texel_directions(64, 128)
    image = np.full((64, 128, 3), 0.2)
    image += 60.0 * np.exp(-0.5 * (np.degrees(np.arccos(directions @ toward(azimuth, height))) / 5.0) ** 2)[..., None]
    return LikelyLight(f"sun at {azimuth:g}", 0.5, LikelySun(azimuth, height, (1.0, 1.0, 1.0)), ""), Environment(image)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A scene folder with two offered lights."""
    path = tmp_path_factory.mktemp("hand") / "scene"
    Scene(ball_on_plate(24).chunks).save(path)
    offer(path, [sunny(*each) for each in SUNS])
    return path


def request_of(folder, **options):
    lighting = LightingOptions(tolerance=0.05, **{"captured_light": 1, **options})
    return RelightRequest(str(folder), "noon", lighting, angles_deg=(0.0,), caching="none")


@pytest.fixture(scope="module")
def window(folder):
    session = Session(session_of(Job(request_of(folder))), InlineWorker, Clock())
    opened = Window(session, SIZE, off_screen=True)
    yield opened
    opened.close()


@pytest.fixture
def by_hand(window):
    """The window while the captured light is set, from the first offered one."""
    window.session.reset()
    window.press_key("9")
    finish(window.session.hand)
    window.session.hand.choose(0)
    window.tick()
    return window


def finish(bench):
    """Wait until the present light is there in full."""
    bench.prepare()
    while not (bench.settled or bench.message):
        bench.poll(True)
        time.sleep(0.001)


def at_once(session):
    """The colours before the light rests."""
    while session.hand.shown is None or session.hand.shown.state != session.hand.setting:
        session.poll()
    return surface_colors(session).astype(int)


def hot(window, name):
    window.picture()
    return next(each for each in window.panel.hot if each.name == name)


def click(window, x, y):
    window._interactor.SetEventPosition(round(x), round(y))
    window.mouse.press("Left")()
    window.mouse.release()


def test_the_view_shows_the_albedo_beside_the_capture(by_hand):
    session = by_hand.session
    assert session.uses("hand") and session.state.split
    shown = [slider.field for slider in SLIDERS if slider.there(session) and slider.of_hand]
    assert shown == [f"hand_{each}" for each in
                     ("azimuth_deg", "height_deg", "sun_share", "brightness_ev", "warmth", "green")]  # fmt: skip
    bench = session.hand
    assert [each.entry.name for each in bench.offered] == ["sun at 150", "sun at 300"]
    first = surface_colors(session).copy()
    finish(bench)
    exact = surface_colors(session).copy()
    assert np.abs(exact.astype(int) - first).mean() < 12 and bench.settled
    session.hand.change(azimuth_deg=240.0)
    brighter = at_once(session)
    assert not bench.settled and np.abs(brighter - exact).mean() > 2
    session.hand.change(brightness_ev=1.0)
    assert (at_once(session) - brighter).mean() < -10  # a brighter light leaves a darker albedo
    by_hand.press_key("2")
    assert not session.uses("hand") and session.state.mode == list(MODES)[1]


def test_sliders_and_maps_set_the_light(by_hand):
    bench = by_hand.session.hand
    slider = hot(by_hand, "hand_height_deg")
    left, base, width, height = slider.box
    click(by_hand, left + width / 2, base + height / 2)
    assert bench.hand.height_deg == pytest.approx(45.5, abs=2.0)
    box = hot(by_hand, SUN_MAP).box
    right, up = place_on_map(300.0, 30.0)
    click(by_hand, box[0] + right * box[2], box[1] + up * box[3])
    assert bench.hand.azimuth_deg == pytest.approx(300.0, abs=3.0)
    assert bench.hand.height_deg == pytest.approx(30.0, abs=3.0)
    box = hot(by_hand, f"{OFFER}1").box
    click(by_hand, box[0] + box[2] / 2, box[1] + box[3] / 2)
    assert bench.number == 1 and (bench.hand.azimuth_deg, bench.hand.height_deg) == SUNS[1]
    by_hand.press_key("apostrophe")
    assert bench.number == 0
    before = bench.hand
    by_hand._interactor.SetEventPosition(600, 400)
    by_hand.mouse.press("Right")()
    by_hand._interactor.SetEventPosition(700, 430)
    by_hand.mouse.move()
    by_hand.mouse.release()
    assert bench.hand.azimuth_deg != before.azimuth_deg and bench.hand.height_deg > before.height_deg


def test_two_clicks_find_the_sun(by_hand):
    bench, tool, orbit = by_hand.session.hand, by_hand.mouse.hand, by_hand.orbit
    by_hand.press_key("slash")
    assert tool.clicks and by_hand.note == "click the edge of a shadow"
    click(by_hand, 950, 700)  # the bar above takes no clicks, and the corner below it shows no surface
    places, pixels = [], []
    for y in range(130, 600, 10):  # left of the split line
        eye, direction = orbit.ray(430, y, SIZE)
        hits = by_hand.caster.first_hits(np.concatenate([eye, direction])[None].astype(np.float32))
        if np.isfinite(hits.distance[0]):
            places.append(eye + float(hits.distance[0]) * direction)
            pixels.append(y)
    low, high = (int(pick([place[1] for place in places])) for pick in (np.argmin, np.argmax))
    click(by_hand, 430, pixels[low])
    click(by_hand, 430, pixels[high])
    way = places[high] - places[low]
    assert way[1] > 0.1 and not tool.clicks
    np.testing.assert_allclose(bench.hand.direction, way / np.linalg.norm(way), atol=1e-6)
    by_hand.press_key("slash")
    click(by_hand, 430, pixels[high])
    click(by_hand, 430, pixels[low])  # the other way round: the sun would shine from below
    assert "below the horizon" in by_hand.note
    np.testing.assert_allclose(bench.hand.direction, way / np.linalg.norm(way), atol=1e-6)


def test_the_view_is_drawn(by_hand, tmp_path):
    finish(by_hand.session.hand)
    picture = by_hand.picture()
    by_hand.press_key("x")
    without = by_hand.picture()
    by_hand.press_key("x")
    assert np.abs(picture.astype(int) - without)[60:300, :300].mean() > 5  # maps over the scene


def test_what_is_kept_is_used_by_the_next_command(by_hand, folder):
    session, bench = by_hand.session, by_hand.session.hand
    session.hand.change(azimuth_deg=200.0, sun_share=0.4, brightness_ev=0.5)
    finish(bench)
    by_hand.press_key("0")
    assert by_hand.note == f"kept in {folder / NAME}: commands use it from now on" and bench.kept == bench.setting
    assert read_lights(folder / NAME).chosen.sun.azimuth_deg == 200.0
    job = Job(request_of(folder, captured_light=None))
    assert job.known.appearance.capture["light"] == "set by hand from sun at 150"
    session.change(split=False)
    wanted = surface_colors(session)
    again = Session(session_of(job), InlineWorker, Clock())
    again.change(mode="albedo")
    assert np.abs(surface_colors(again).astype(int) - wanted).max() <= 1
    again.close()
    (folder / NAME).write_text("{")
    by_hand.press_key("0")
    assert "not valid JSON" in by_hand.note and "\n" not in by_hand.note


def test_the_open_session_goes_on_under_what_is_kept(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns(NAME))
    offer(copy, [sunny(*each) for each in SUNS])
    session = Session(session_of(Job(request_of(copy))), InlineWorker, Clock())
    window = Window(session, SIZE, off_screen=True)
    session.change(angle_deg=70.0)
    window.press_key("9")
    finish(session.hand)
    session.hand.change(azimuth_deg=200.0, sun_share=0.4, brightness_ev=0.5)
    before = session.albedos["estimated"]
    window.press_key("0")
    deadline = time.perf_counter() + 60.0
    while window.session is session and time.perf_counter() < deadline:
        window.tick()
    assert window.note == "relit under the captured light that you kept"
    state, kept = window.session.state, window.session.albedos["estimated"]
    assert (state.angle_deg, state.tool, state.split) == (70.0, "", False)
    wanted = Job(request_of(copy, captured_light=None)).known.appearance
    assert wanted.capture["light"] == "set by hand from sun at 150"
    np.testing.assert_allclose(kept, wanted.albedo, atol=1e-6)
    assert np.abs(kept - before).mean() > 0.02
    window.close()


def test_a_session_without_an_estimate_has_no_such_view(folder):
    session = Session(session_of(Job(RelightRequest(str(folder), "noon", albedo="captured", caching="none"))),
                      InlineWorker, Clock())  # fmt: skip
    assert session.hand is None
    session.reset()
    session.close()


def test_damaged_offers_are_a_message(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / NAME).write_text("{")
    session = Session(session_of(Job(request_of(copy, captured_light=Environment(np.ones((4, 8, 3)))))), InlineWorker,
                      Clock())  # fmt: skip
    session.change(tool="hand")
    finish(session.hand)
    assert "not valid JSON" in session.hand.message
    assert (surface_colors(session) == session.scene.colors_srgb).all()
    session.close()
