"""Lamps under mouse and keys of the session's window, off screen."""

import json

import numpy as np
import pytest

pytest.importorskip("pyvista")

from lamp_sessions import open_session, relit, warm
from viewer_scenes import SIZE, ball_on_plate, bare

from relight.lamps.asked import parse_color
from relight.viewer.controls import CONTROLS, SLIDERS
from relight.viewer.lamp_tool import COLORS, OFF_M
from relight.viewer.lamps import place_of
from relight.viewer.panel import Panel
from relight.viewer.window import Window

pytestmark = pytest.mark.usefixtures("vtk_is_silent")

TOP = -1.2  # of the plate


@pytest.fixture(scope="module")
def scene():
    return ball_on_plate()


@pytest.fixture
def window(scene, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    window = Window(open_session(scene, captured=0.2), SIZE, off_screen=True)
    window.session.finish()
    window.press_key("t")
    warm(window.session)
    window.tick()
    yield window
    window.close()


def mouse(window, *steps):
    for event, x, y in steps:
        window._interactor.SetEventInformation(int(x), int(y), 0, 0, "\0", 0, None)
        window._interactor.InvokeEvent(f"{event}Event")


def click(window, x, y):
    mouse(window, ("LeftButtonPress", x, y), ("LeftButtonRelease", x, y))
    window.tick()


def drag(window, start, end, steps=4):
    places = np.linspace(start, end, steps + 1)
    mouse(window, ("LeftButtonPress", *start), *(("MouseMove", *place) for place in places[1:]))
    mouse(window, ("LeftButtonRelease", *end))
    window.tick()


def seen(window, place):
    """The pixel of a position, from the lower left."""
    right, up, backward = window.orbit.axes @ (np.asarray(place) - window.orbit.eye)
    focal = 0.5 * window.size[0] / np.tan(np.radians(window.orbit.fov_deg) / 2.0)
    return window.size[0] / 2 - focal * right / backward, window.size[1] / 2 - focal * up / backward


def bulb(window, x=1.2, z=1.2):
    """Click on the plate."""
    click(window, *np.round(seen(window, (x, TOP, z))))
    return window.session.lamps.state.lamps[-1].number


def place(window, number):
    return np.array(place_of(window.session.lamps.asked(number)))


def test_a_click_puts_a_bulb_off_the_surface_that_is_seen_there(window):
    session = window.session
    before = bare(window)
    number = bulb(window)
    found = place(window, number)
    # The pixel is rounded; over the plate an object's diagonal is a metre, of which the ball takes none there.
    assert found[1] == pytest.approx(TOP + OFF_M * session.scene.diagonal, rel=1e-4)
    assert found[[0, 2]] == pytest.approx([1.2, 1.2], abs=0.03)
    asked = session.lamps.asked(number)
    assert asked.color == parse_color("warm") and (asked.brightness.value, asked.brightness.unit) == (2.0, "EV")
    assert session.lamps.selected == number and session.timeline._at == 1
    assert (bare(window) != before).any(axis=2).mean() > 0.05
    window.press_key("z")
    assert np.array_equal(bare(window), before)


def test_between_two_surfaces_a_bulb_stands_in_the_middle(window):
    """Under the ball there is less room than a bulb takes elsewhere."""
    low = 0.1 - 0.8  # of the ball
    found = place(window, bulb(window, 0.0, 0.35))
    under = 0.1 - np.sqrt(0.8**2 - 0.35**2)
    assert TOP < found[1] < low and found[1] == pytest.approx((TOP + under) / 2.0, abs=0.04)


def test_without_a_surface_there_is_no_lamp(window):
    click(window, 3, SIZE[1] - 60)
    assert window.session.timeline._at == 0 and "no surface" in window.note


def test_a_drag_without_a_lamp_looks_around_and_puts_none_in(window):
    orbit = window.orbit
    drag(window, (240, 200), (300, 220))
    assert window.orbit != orbit and window.session.timeline._at == 0
    window.press_key("t")
    click(window, *np.round(seen(window, (1.2, TOP, 1.2))))
    assert window.session.timeline._at == 0  # clicks put none in any more


def test_a_lamp_is_dragged_along_the_surface_and_undone_in_one(window):
    number = bulb(window)
    window.session.lamps.move(number, (1.2, TOP + 0.3, 1.2))  # the plate is nearest
    window.session.finish()
    window.tick()
    before, radiance = place(window, number), window.session.radiance()
    start = seen(window, before)
    base = np.array([before[0], TOP, before[2]])
    shift = np.array([-0.3, 0.0, -0.2])
    goal = base + shift
    end = np.add(start, np.subtract(seen(window, goal), seen(window, base)))
    drag(window, np.round(start), np.round(end))
    after = place(window, number)
    # Whole pixels, and the directions in which the surface around a lamp is looked for.
    assert after == pytest.approx(before + shift, abs=0.06)
    assert after[1] == pytest.approx(before[1], abs=0.01)
    assert window.session.timeline._at == 3
    window.session.finish()
    assert not np.array_equal(window.session.radiance(), radiance)
    window.press_key("z")
    assert np.array_equal(window.session.radiance(), radiance)
    window.press_key("y")
    assert np.array_equal(place(window, number), after)


def test_beyond_the_scene_a_lamp_follows_the_mouse_at_its_depth(window):
    number = bulb(window)
    before = place(window, number)
    start = np.round(seen(window, before))
    drag(window, start, (20, SIZE[1] - 60), steps=1)
    after = place(window, number)
    assert seen(window, after) == pytest.approx((20, SIZE[1] - 60), abs=2.0)
    depth = [(window.orbit.eye - point) @ window.orbit.axes[2] for point in (before, after)]
    assert depth[0] == pytest.approx(depth[1], rel=1e-6)
    window.finish()
    assert np.isfinite(window.session.radiance()).all()


def test_marks_are_where_lamps_are_and_take_the_mouse(window):
    numbers = [bulb(window, x) for x in (1.2, -1.2)]
    assert [mark.number for mark in window.mouse.lamps.marks()] == numbers
    assert [mark.selected for mark in window.mouse.lamps.marks()] == [False, True]
    for mark, number in zip(window.mouse.lamps.marks(), numbers, strict=True):
        assert (mark.x, mark.y) == pytest.approx(seen(window, place(window, number)))
        assert window.picture()[SIZE[1] - 1 - round(mark.y), round(mark.x)] == pytest.approx(mark.color, abs=2)
    click(window, *seen(window, place(window, numbers[0])))
    assert window.session.lamps.selected == numbers[0] and window.session.timeline._at == 2
    window.press_key("t")
    window.tick()
    assert window.mouse.lamps.marks() == [] and not any(hot.lamp for hot in window.panel.hot)


def test_keys_change_the_lamp_that_is_selected(window):
    number = bulb(window)
    session = window.session

    def lamp():
        return session.lamps.asked(number)

    seen_colors = []
    for _ in COLORS:
        window.press_key("c")
        seen_colors.append(lamp().color)
    assert set(seen_colors) == {parse_color(name) for name in COLORS} and seen_colors[-1] == parse_color("warm")
    window.press_key("d")
    assert session.lamps.state.lamps == () and session.lamps.selected is None
    window.press_key("c")
    assert "no lamp is selected" in window.note
    while session.timeline._at:
        window.press_key("z")
    window.press_key("z")
    assert window.note == "nothing to undo"
    for key in "cd":
        window.press_key(key)
    assert session.timeline._at == 0


def test_sliders_set_captured_light_and_the_lamp(window):
    number = bulb(window)
    window.tick()
    undoable = window.session.timeline._at
    for field, share in (("captured", 0.5), ("lamp_ev", 0.25)):
        hot = next(hot for hot in window.panel.hot if hot.name == field)
        left, bottom, width, height = hot.box
        start = left + 10, bottom + height / 2
        drag(window, start, (left + share * width, bottom + height / 2))
    assert window.session.lamps.state.captured == pytest.approx(0.5, abs=0.03)
    assert window.session.lamps.asked(number).brightness.value == pytest.approx(-4.0 + 0.25 * 14.0, abs=0.4)
    assert window.session.timeline._at == undoable + 2
    assert [slider.field for slider in SLIDERS if slider.there(window.session)][-2:] == ["captured", "lamp_ev"]


def test_reset_is_a_change_that_can_be_undone(window):
    bulb(window)
    now = window.session.lamps.state
    window.press_key("r")
    assert window.session.lamps.state == window.session.lamps.start and not window.session.uses("lamps")
    window.press_key("z")
    assert window.session.lamps.state is now


def test_lamps_are_saved_by_a_key_and_on_leaving(window, scene, tmp_path):
    (tmp_path / "lamps.json").write_text("of somebody else")
    window.press_key("j")
    assert "no lamps" in window.note
    bulb(window)
    window.press_key("j")
    assert window.note == f"saved {tmp_path / 'lamps_0001.json'}"
    assert (tmp_path / "lamps.json").read_text() == "of somebody else"
    written = (tmp_path / "lamps_0001.json").read_bytes()
    window.press_key("c")
    window.press_key("j")  # over its own
    assert (tmp_path / "lamps_0001.json").read_bytes() != written
    bulb(window, -1.2)
    window.finish()
    shown = window.session.radiance()
    window.close()
    assert len(json.loads((tmp_path / "lamps_0001.json").read_text())["lamps"]) == 2
    assert np.array_equal(relit(scene, "captured", tmp_path / "lamps_0001.json", 0.2), shown)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lamps.json", "lamps_0001.json"]


def test_nothing_is_saved_that_nobody_changed(window, tmp_path):
    window.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_hundreds_of_random_actions_end_with_the_light_of_their_lamps(window, scene, tmp_path):
    rng, session = np.random.default_rng(11), window.session
    keys = [control.key for control in CONTROLS if control.key not in ("q", "v", "p", "j", "5", "minus", "equal", "r")]
    for _ in range(400):
        kind = rng.random()
        if kind < 0.35:
            window.press_key(keys[rng.integers(len(keys))])
        elif kind < 0.55:
            click(window, *(rng.random(2) * window.size))
        elif kind < 0.85:
            marks = window.mouse.lamps.marks()
            start = rng.random(2) * window.size
            if marks and rng.random() < 0.8:
                mark = marks[rng.integers(len(marks))]
                start = mark.x, mark.y
            drag(window, start, rng.random(2) * window.size)
        elif kind < 0.95:
            session.clock.now += 1.0  # the hand rests
        else:
            window.press_key("z")
        if len(session.lamps.state.lamps) > 4:
            session.lamps.remove(session.lamps.state.lamps[0].number)
        window.tick()
        assert session.failure == ""
        shown = session.radiance()
        assert np.isfinite(shown).all()
    session.change(**{name: getattr(session.start, name) for name in ("mode", "albedo", "environment", "effects")})
    session.lamps.add("1.2,0.5,1.2")
    window.finish()
    assert session.complete and session.settled
    session.lamps.save(tmp_path / "lamps.json")
    expected = relit(scene, "captured", tmp_path / "lamps.json", session.lamps.state.captured)
    assert np.array_equal(session.radiance(), expected)


@pytest.mark.parametrize("size", [(960, 720), (1600, 1000)])
def test_nothing_written_about_lamps_overlaps_or_leaves_the_window(window, size):
    session = window.session
    bulb(window)
    panel = Panel()
    for changes in ({}, {"help": True}, {"split": True}):
        session.change(help=False, split=False)
        session.change(**changes)
        panel.draw(session, size)
        boxes = list(panel.boxes.items())
        assert any(text == "Captured" for (text, *_), _ in boxes) and any(text == "Lamp" for (text, *_), _ in boxes)
        for index, ((text, *_), (left, bottom, width, height)) in enumerate(boxes):
            assert left >= 0 and bottom >= 0 and left + width <= size[0] and bottom + height <= size[1], text
            for (other, *_), box in boxes[index + 1 :]:
                apart = left + width <= box[0] or box[0] + box[2] <= left
                apart |= bottom + height <= box[1] or box[1] + box[3] <= bottom
                assert apart, f"{text!r} and {other!r} overlap after {changes}"
