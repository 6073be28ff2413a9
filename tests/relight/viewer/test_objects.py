"""Objects in a session: moved by hand, with their shadow at once and exactly at rest."""

import time

import numpy as np
import pytest
import trimesh

pytest.importorskip("pyvista")

from inline_worker import InlineWorker
from viewer_scenes import SIZE, Clock, ball_on_plate

from relight import LightingOptions, RelightRequest
from relight.jobs.job import Job
from relight.jobs.session import session_of
from relight.viewer.session import Session
from relight.viewer.window import Window
from splat2mesh.base.errors import InputError

pytestmark = pytest.mark.usefixtures("vtk_is_silent")

TOP = -1.2  # of the plate
WORDS = "{} at={},{},{} albedo=.3"


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    path = tmp_path_factory.mktemp("objects") / "box.obj"
    path.write_text(trimesh.exchange.obj.export_obj(trimesh.creation.box((0.3, 0.3, 0.3))))
    return path


@pytest.fixture(scope="module")
def scene():
    return ball_on_plate()


def job_of(scene, box, at):
    options = LightingOptions(tolerance=0.05)
    inserted = [WORDS.format(box, *at)]
    return Job(RelightRequest(scene, "noon", options, inserted=inserted, caching="none"))


def open_session(scene, box, at, clock=None):
    return Session(session_of(job_of(scene, box, at)), InlineWorker, clock or Clock())


@pytest.fixture
def session(scene, box):
    session = open_session(scene, box, (1.1, TOP + 0.15, 1.1))
    session.finish()
    yield session
    session.close()


def wait_for(session, there, seconds=60.0):
    end = time.perf_counter() + seconds
    while not there():
        session.poll()
        assert time.perf_counter() < end
        time.sleep(0.005)


@pytest.mark.slow
def test_at_rest_the_light_is_that_of_a_relight_wherever_the_object_was_moved(scene, box, session):
    for at in ((1.1, TOP + 0.15, 1.1), (-1.1, TOP + 0.15, 0.4)):
        session.objects.put(0, at)
        session.finish()
        shaded = next(iter(job_of(scene, box, at).shaded()))
        np.testing.assert_array_equal(session.inserted.direct, shaded.inserted.direct)
        np.testing.assert_allclose(session.inserted.light, shaded.inserted.light, rtol=1e-5, atol=1e-6)


def test_the_shadow_follows_before_the_hand_rests(session):
    """A glimpse has the shadow at its new place and none at its old one."""
    vertices, before = session.scene.vertices, session.inserted.ratio.copy()
    session._objects_moved = session._moved = 0.0  # no time passes: the hand never rests
    session.objects.put(0, (-1.1, TOP + 0.15, 1.1))
    wait_for(session, lambda: not session.objects.shown.exact)
    assert not session.settled
    flat = abs(vertices[:, 1] - TOP) < 1e-3
    old, new = (flat & (np.linalg.norm(vertices[:, [0, 2]] - [x, 1.1], axis=1) < 0.3) for x in (1.1, -1.1))
    assert before[old].min() < 0.9 and session.inserted.ratio[new].min() < 0.9
    np.testing.assert_allclose(session.inserted.ratio[old], 1.0, atol=0.05)
    radiance = session.radiance()
    np.testing.assert_array_equal(radiance, session.plain_radiance() * session.inserted.ratio)


@pytest.mark.slow
def test_reset_and_bad_numbers(session):
    start = session.inserted.ratio.copy()
    with pytest.raises(InputError, match="object 3"):
        session.objects.put(3, (0.0, 0.0, 0.0))
    session.objects.put(0, (0.9, 0.0, -1.0), 30.0)
    session.finish()
    assert (session.inserted.ratio != start).any()
    session.reset()
    session.finish()
    np.testing.assert_array_equal(session.inserted.ratio, start)


@pytest.mark.slow
def test_undo_takes_moves_back_one_by_one_and_gives_the_light_back_to_the_bit(session):
    places = [session.objects.placed[0].at]
    lights = [session.inserted.ratio.copy()]
    for at in ((0.9, 0.0, -1.0), (-1.1, TOP + 0.15, 0.4)):
        session.objects.put(0, at)
        places.append(at)
    session.finish()
    lights.append(session.inserted.ratio.copy())
    assert session.timeline.undo() and session.objects.placed[0].at == places[1]
    assert session.timeline.undo() and session.objects.placed[0].at == places[0]
    session.finish()
    np.testing.assert_array_equal(session.inserted.ratio, lights[0])
    assert not session.timeline.undo()
    assert session.timeline.redo() and session.timeline.redo() and not session.timeline.redo()
    session.finish()
    np.testing.assert_array_equal(session.inserted.ratio, lights[1])
    session.reset()
    assert session.objects.placed[0].at == places[0]
    assert session.timeline.undo() and session.objects.placed[0].at == places[2]
    session.timeline.undo()
    session.objects.put(0, (1.0, 0.0, 1.0))
    assert not session.timeline.redo()  # another way was taken


def mouse(window, *steps):
    for event, x, y in steps:
        window._interactor.SetEventInformation(int(x), int(y), 0, 0, "\0", 0, None)
        window._interactor.InvokeEvent(f"{event}Event")


@pytest.mark.slow
def test_a_drag_takes_the_object_along_over_its_level_and_keys_turn_it(scene, box):
    window = Window(open_session(scene, box, (1.1, TOP + 0.15, 1.1)), SIZE, off_screen=True)
    session = window.session
    try:
        session.finish()
        window.tick()
        without = window.picture(panel=False).astype(int)
        tool = window.mouse.lamps
        start = tool._seen_at(np.array([1.1, TOP + 0.3, 1.1]))
        orbit = window.orbit
        mouse(
            window, ("LeftButtonPress", *start), ("MouseMove", start[0] + 30, start[1]), ("LeftButtonRelease", *start)
        )
        assert window.orbit != orbit  # the camera, as long as objects are not moved
        window.look(orbit)
        window.press_key("6")
        end = tool._seen_at(np.array([0.3, TOP + 0.3, 1.1]))
        mouse(window, ("LeftButtonPress", *start), ("MouseMove", *end), ("LeftButtonRelease", *end))
        assert window.orbit == orbit
        np.testing.assert_allclose(session.objects.placed[0].at, [0.3, TOP + 0.15, 1.1], atol=0.04)  # two pixels
        assert "--insert box.obj --at 0." in window.note
        window.press_key("8")
        assert session.objects.placed[0].turn_deg == 5.0
        session.finish()
        moved = window.picture(panel=False).astype(int)
        x, y = (round(each) for each in start)
        assert abs(moved[SIZE[1] - y + 12, x] - without[SIZE[1] - y + 12, x]).max() > 10  # where it stood is the plate
    finally:
        window.close()
