"""The interactive session off screen: what each control does to the pixels, mouse, panel, pictures and films."""

import os
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest

pytest.importorskip("pyvista")

from inline_worker import InlineWorker
from viewer_scenes import SIZE, as_scene, ball_on_plate, bare, session_of

from relight import Environment
from relight.light.projections import texel_directions
from relight.output.preview import Preview
from relight.viewer.controls import CONTROLS, MOUSE, SLIDERS, key_name
from relight.viewer.panel import Panel
from relight.viewer.request import SessionRequest
from relight.viewer.session import Session
from relight.viewer.stage import BACKDROP
from relight.viewer.window import Window

pytestmark = pytest.mark.usefixtures("vtk_is_silent")


@pytest.fixture(scope="module")
def scene():
    return ball_on_plate()


def parts_of(window):
    """Masks of the picture: where surely surface is, and where surely none is, two pixels from every edge."""
    window.session.change(mode="albedo", albedo="white", split=False)
    white = (bare(window) == 255).all(axis=2)
    window.reset()

    def shrunk(mask):
        near = [np.roll(np.roll(mask, dx, 1), dy, 0) for dx in range(-2, 3) for dy in range(-2, 3)]
        return np.logical_and.reduce(near)

    return shrunk(white), shrunk(~white)


def place_of(window, direction):
    """Column and row where something infinitely far away in a direction (3,) appears."""
    right, up, backward = window.orbit.axes
    width, height = window.size
    focal = 0.5 * width / np.tan(np.radians(window.orbit.fov_deg) / 2)
    ahead = -(direction @ backward)
    assert ahead > 0
    return width / 2 + focal * (direction @ right) / ahead, height / 2 - focal * (direction @ up) / ahead


# Pixels


def test_every_control_changes_the_pixels_it_should_and_no_others(window):
    window._home = window.orbit = window.orbit.dragged(0.0, (window.orbit.elevation_deg - 3.0) / 180.0)  # the horizon
    surface, sky = parts_of(window)
    assert surface.mean() > 0.05 and sky.mean() > 0.3
    left = np.arange(SIZE[0])[None, :] < SIZE[0] * 0.5 - 6
    right = np.arange(SIZE[0])[None, :] > SIZE[0] * 0.5 + 6
    band = np.abs(np.arange(SIZE[0])[None, :] - SIZE[0] * 0.525) < SIZE[0] * 0.025 - 6
    everything, nothing = np.ones_like(surface), np.zeros_like(surface)
    expected = {  # what changes, of the picture without the panel; the rest of surface and sky keeps every bit
        **{key: surface for key in "suoam"},
        **{key: everything for key in ("Left", "Right", "Up", "Down", "e", "w", "2", "3")},
        "1": nothing,
        "b": surface & left,
        "k": sky,
        "minus": surface,
        "equal": surface,
        "space": nothing,
        "x": nothing,
        "r": nothing,
        "h": nothing,
        **{key: nothing for key in "gl"},  # no splats and no lamps here
        **{key: nothing for key in "678"},  # no objects either
        **{key: nothing for key in ("9", "0", "apostrophe", "slash")},  # whose captured light cannot be set
        **{key: nothing for key in ("5", "Return")},  # no splats to part
        **{key: nothing for key in "tcdzyj"},  # whose lamps cannot be changed
    }
    assert set(expected) == {control.key for control in CONTROLS} - {"p", "v", "q"}
    window.session.change(tolerance=0.01)  # which calls for every effect
    window.session.start = window.session.state
    before = bare(window)
    assert window.session.answers.called_for == window.session.answers.available - {"volume"}  # nothing grows here
    for key, area in expected.items():
        window.press_key(key)
        if key == "space":
            window.session.change(turning=False)
        changed = (bare(window) != before).any(axis=2)
        for part in (surface, sky):
            inside = area & part
            assert not changed[part & ~area].any() if key != "b" else not changed[part & right].any(), key
            assert not inside.any() or changed[inside].mean() > 0.1, key
        window.reset()
        assert window.session.state == window.session.start and window.orbit == window._home
        # Rays that another wish has called for meanwhile serve this one too, so that it may come out a little better.
        again = bare(window)
        assert np.abs(again - before).mean() < 0.5, key
        before = again
    window.press_key("b")
    before = bare(window)
    window.session.change(split_at=0.55)
    changed = (bare(window) != before).any(axis=2)
    assert changed[surface & band].mean() > 0.2 and not changed[(surface | sky) & left].any()
    assert not changed[surface & (np.arange(SIZE[0])[None, :] > SIZE[0] * 0.55 + 6)].any()


def test_left_of_the_split_are_the_captured_colours_right_the_relit_ones(window):
    surface, _ = parts_of(window)
    relit = bare(window)
    window.session.change(mode="albedo")  # of the albedo "captured": the same colours
    captured = bare(window)
    window.session.change(mode="relit", split=True, split_at=0.4)
    both, columns = bare(window), np.arange(SIZE[0])[None, :]
    left, right = surface & (columns < 0.4 * SIZE[0] - 6), surface & (columns > 0.4 * SIZE[0] + 6)
    # Captured bytes become linear albedo and bytes again: one in the last place.
    assert left.sum() > 1000 and np.abs(both - captured)[left].max() <= 1
    assert right.sum() > 1000 and np.array_equal(both[right], relit[right])


def test_the_picture_is_that_of_rays(scene, window):
    window.session.change(angle_deg=70.0)
    found = bare(window)
    camera = {"eye": window.orbit.eye, "target": window.orbit.target, "up": [0, 1, 0], "fov_deg": window.orbit.fov_deg}
    light = Environment.load("noon").rotated(70.0)
    cast = Preview(scene, camera, *SIZE, 4).render(window.session.radiance(), light, window.session.exposure())
    off = np.abs(found - cast)
    # Bytes are mixed across a face here, radiance there; at edges the samples of a pixel lie elsewhere.
    assert np.median(off) <= 1 and off.mean() < 1.5 and (off <= 8).mean() > 0.97


@pytest.mark.parametrize("split", [False, True])
def test_what_moves_is_the_picture_at_rest_without_smooth_edges(window, split):
    window.session.change(split=split, split_at=0.45, angle_deg=33.0)
    window.session.finish()
    window._draw_now(panel=False)
    stage, size = window._stage, window.size
    for sky in (True, False):
        window.session.change(sky=sky)
        smooth = window.picture(panel=False).astype(int)
        moving = stage.drawn(window.session, window.orbit, size, False).astype(int)
        off = np.abs(smooth - moving).max(axis=2)
        off[:, int(0.45 * size[0]) - 6 : int(0.45 * size[0]) + 7] = 0  # the line itself
        assert (off <= 2).mean() > 0.95, "all but edges"


def test_from_within_nothing_near_the_eye_is_lost(window):
    """The eye inside the ball: every pixel is surface, though faces reach behind the eye."""
    window.session.change(mode="albedo", albedo="white", sky=False)
    inside = window.orbit.nearer(-100)
    window.look(type(inside)((0.0, 0.1, 0.0), 0.5, 20.0, 10.0, 100.0, inside.diagonal))
    window._draw_now()
    assert (window._stage.drawn(window.session, window.orbit, window.size, False) == 255).all()


@pytest.mark.parametrize("angle", [0.0, 37.0, 230.0])
def test_a_bright_texel_stands_where_its_light_comes_from(angle):
    """One lit pixel, in the sky behind a ball and on the ball."""
    height, width, row, column = 64, 128, 22, 41
    image = np.zeros((height, width, 3), np.float32)
    image[row, column] = 500.0
    toward = texel_directions(height, width)[row, column]
    radians = np.radians(angle)
    turn = np.array([[np.cos(radians), 0, np.sin(radians)], [0, 1, 0], [-np.sin(radians), 0, np.cos(radians)]])
    toward = turn @ toward
    ball = as_scene(o3d.geometry.TriangleMesh.create_sphere(1.0, 40), 255)
    session = session_of(ball, Environment(image, "one"), albedos={"white": None}, effects="none")
    window = Window(session, SIZE, off_screen=True)
    session.change(angle_deg=angle)
    session.finish()
    # The brightest vertex faces the light, within the distance between vertices of the ball.
    brightest = ball.normals[session.radiance()[:, 0].argmax()]
    assert np.degrees(np.arccos(np.clip(brightest @ toward, -1, 1))) < 5.0
    # Look about at it, away from the ball.
    elevation = np.degrees(np.arcsin(-toward[1])) + 8.0
    azimuth = np.degrees(np.arctan2(-toward[0], -toward[2])) + 5.0
    window.look(type(window.orbit)(tuple(9.0 * toward), 1.0, azimuth, elevation, 60.0, 2.0))
    expected = place_of(window, toward)
    for picture in (bare(window), window._stage.drawn(session, window.orbit, window.size, False).astype(int)):
        lit = picture.sum(axis=2)
        rows, columns = np.nonzero(lit > 0)
        assert len(rows) > 20  # a texel of 2.8 degrees, of a picture of 60
        center = 0.5 + np.average([columns, rows], axis=1, weights=lit[rows, columns])
        assert np.linalg.norm(np.subtract(center, expected)) < 2.0  # pixels; the texel is 22 wide
    window.close()


def test_before_the_first_light_the_captured_colours_show(scene):
    class Silent(InlineWorker):
        def poll(self):
            return []

    window = Window(session_of(scene, worker=Silent), SIZE, off_screen=True)
    window.tick()
    picture = window.picture(panel=False)
    window.session.change(mode="albedo")
    assert np.abs(picture.astype(int) - window.picture(panel=False)).max() <= 1
    assert window.session.radiance() is None
    corner = BACKDROP[1]
    assert np.abs(picture[2, 2] - corner).max() <= 3
    window.close()


# Mouse


def mouse(window, *steps):
    """Events of the mouse: ("LeftButtonPress", x, y) ... with the origin in the lower left corner."""
    for event, x, y in steps:
        window._interactor.SetEventInformation(int(x), int(y), 0, 0, "\0", 0, None)
        window._interactor.InvokeEvent(f"{event}Event")


def drag(window, start, end, button="Left"):
    middle = np.mean([start, end], axis=0)
    mouse(window, (f"{button}ButtonPress", *start), ("MouseMove", *middle), ("MouseMove", *end))
    mouse(window, (f"{button}ButtonRelease", *end))


def hot(window, name):
    return next(hot for hot in window.panel.hot if hot.name == name)


def test_the_mouse_looks_around_turns_the_light_and_moves_what_is_there_to_move(window):
    window.tick()
    state, orbit = window.session.state, window.orbit
    drag(window, (240, 200), (300, 220))
    assert window.session.state == state
    assert (window.orbit.azimuth_deg - orbit.azimuth_deg) % 360.0 == pytest.approx(360.0 - 180.0 * 60 / 360)
    assert window.orbit.elevation_deg - orbit.elevation_deg == pytest.approx(-180.0 * 20 / 360)
    orbit = window.orbit
    drag(window, (240, 200), (330, 200), "Right")
    assert window.session.state.angle_deg == pytest.approx(45.0) and window.orbit == orbit
    before = place_of(window, np.subtract(orbit.target, window.orbit.eye))
    drag(window, (240, 200), (250, 212), "Middle")
    after = place_of(window, np.subtract(orbit.target, window.orbit.eye))
    assert np.subtract(after, before) == pytest.approx([10.0, -12.0], abs=0.5)  # what was there follows the mouse
    mouse(window, ("MouseWheelForward", 240, 200))
    assert window.orbit.distance < orbit.distance
    mouse(window, ("MouseMove", 10, 300))
    assert window.session.state.angle_deg == pytest.approx(45.0)  # no button, no drag


def test_sliders_and_the_split_line_follow_the_mouse(window):
    window.press_key("b")
    window.tick()
    sliders = [slider for slider in SLIDERS if slider.there(window.session)]
    for slider, share in zip(sliders, (0.25, 0.75, 0.5), strict=True):
        left, bottom, width, height = hot(window, slider.field).box
        left, width = left + 3.5, width - 7.0  # from the middle of the handle at one end to that at the other
        start, end = (left + 0.6 * width, bottom + height / 2), (left + share * width, bottom + height / 2)
        drag(window, start, end)
    state = window.session.state
    # The mouse stands on whole pixels, of which a slider has 140.
    assert state.angle_deg == pytest.approx(90.0, abs=3.0) and state.exposure_ev == pytest.approx(3.0, abs=0.1)
    assert state.tolerance == pytest.approx(np.sqrt(0.003 * 0.1), rel=0.05)  # half way of a logarithmic scale
    window.tick()
    left, bottom, width, height = hot(window, "split_at").box
    drag(window, (left + width / 2, bottom + height / 2), (120, bottom + height / 2))
    assert window.session.state.split_at == pytest.approx(0.25, abs=0.01)
    assert window.orbit == window._home


def test_every_button_does_what_its_key_does(window):
    for control in CONTROLS:
        if not (control.chip and control.there(window.session)):
            continue
        window.reset()
        window.tick()
        left, bottom, width, height = hot(window, control.key).box
        press = left + width / 2, bottom + height / 2
        mouse(window, ("LeftButtonPress", *press), ("LeftButtonRelease", *press))
        clicked = window.session.state
        window.reset()
        window.press_key(control.key)
        assert clicked == window.session.state, control.key
        assert clicked != window.session.start or control.key == "1"


# Panel


@pytest.mark.parametrize("size", [(960, 720), (1600, 1000), (1280, 800)])
def test_nothing_written_overlaps_or_leaves_the_window(scene, size):
    names = ["a very long name of a light from a folder.0001", "noon"]
    session = Session(SessionRequest.of(scene, {name: "noon" for name in names}, tolerance=0.05), InlineWorker)
    window = Window(session, (64, 48), off_screen=True)
    panel = Panel()
    states = [
        {},
        {"help": True},
        {"split": True},
        {"split_at": 0.98, "split": True},
    ]
    for changes in states:
        window.reset()
        session.change(**changes)
        for settled in (False, True):
            if settled:
                session.finish()
            session.answers.progress = ("bounce rays", 0.45)
            panel.draw(session, size)
            boxes = list(panel.boxes.items())
            for index, ((text, *_), (left, bottom, width, height)) in enumerate(boxes):
                assert left >= 0 and bottom >= 0 and left + width <= size[0] and bottom + height <= size[1], text
                for (other, *_), box in boxes[index + 1 :]:
                    apart = left + width <= box[0] or box[0] + box[2] <= left
                    apart |= bottom + height <= box[1] or box[1] + box[3] <= bottom
                    assert apart, f"{text!r} and {other!r} overlap after {changes}"
    window.close()


def test_the_help_lists_every_key(window):
    window.press_key("h")
    window.finish()
    written = {text for text, *_ in window.panel.boxes}
    for control in CONTROLS:
        assert ({key_name(control), control.text} <= written) == control.there(window.session)
    assert {text for pair in MOUSE for text in pair} <= written


def test_the_panel_shows_error_times_and_what_is_missing(window):
    window.tick()
    window.session.finish()
    window.picture()
    written = " ".join(text for text, *_ in window.panel.boxes)
    assert f"error {100 * window.session.answers.error:.2g} %" in written and " ms" in written and " suns" in written
    window.session.change(angle_deg=40.0)
    window.picture()
    assert any("on the way" in text for text, *_ in window.panel.boxes)


def test_the_curve_says_what_tolerances_cost_and_a_click_takes_one(window):
    window.session.finish()
    window.picture()
    lit = window.session.answers.lit
    assert len(lit.curve) > 1 and f"planned {lit.planned:.2g} s" in {text for text, *_ in window.panel.boxes}
    slider, curve = (hot.box for hot in window.panel.hot if hot.name == "tolerance")
    assert slider[1] < curve[1]
    press = curve[0] + 0.97 * curve[2], curve[1] + curve[3] / 2
    mouse(window, ("LeftButtonPress", *press), ("LeftButtonRelease", *press))
    assert window.session.state.tolerance == pytest.approx(0.1, rel=0.1)


# Endurance


@pytest.mark.slow
def test_a_thousand_random_actions_leave_no_error_and_no_memory(scene, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    session = Session(SessionRequest.of(scene, "noon", tolerance=0.05))
    window = Window(session, (240, 180), off_screen=True)
    rng = np.random.default_rng(7)
    controls = [control for control in CONTROLS if control.key not in ("q", "v", "p")]

    def act():
        kind = rng.random()
        if kind < 0.5:
            window.press_key(controls[rng.integers(len(controls))].key)
        elif kind < 0.8:
            places = rng.random((2, 2)) * window.size
            drag(window, *places, ["Left", "Middle", "Right"][rng.integers(3)])
        elif kind < 0.95:
            mouse(window, (f"MouseWheel{['Forward', 'Backward'][rng.integers(2)]}", *rng.random(2) * window.size))
        else:
            window.picture(panel=bool(rng.integers(2)))
        window.tick()
        assert session.failure == ""

    def resident(process):
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20

    for _ in range(400):
        act()
    watched = Path("/proc/self/statm").exists()
    before = resident("self") if watched else 0.0
    for _ in range(1000):
        act()
    after = resident("self") if watched else 0.0
    # One picture is 0.13 MB and a light of this scene 7 kB: a leak of either for every action would be 7 or 130.
    assert after - before < 6.0
    window.reset()
    window.finish()
    assert session.complete and session.answers.error < 0.05
    assert watched is False or resident(session.answers._worker._process.pid) < 1000.0
    window.close()


# Files
