"""What the session leaves behind: pictures, films, cells of notebooks, and one line where something is missing."""

import asyncio
import sys

import imageio.v3 as iio
import numpy as np
import pytest

pytest.importorskip("pyvista")

from viewer_scenes import SIZE, ball_on_plate, bare, session_of

from relight.viewer import record_turntable, view
from relight.viewer.notebook import run_loop, serve, show_widget
from relight.viewer.recording import fit_to
from relight.viewer.request import Turntable
from relight.viewer.waiting import Served
from relight.viewer.window import Window
from splat2mesh.base.errors import InputError

pytestmark = pytest.mark.usefixtures("vtk_is_silent")


@pytest.fixture(scope="module")
def scene():
    return ball_on_plate()


@pytest.mark.slow
def test_view_saves_the_picture_of_a_session(scene, tmp_path, monkeypatch):
    monkeypatch.setattr("relight.planning.unmeasured.UNMEASURED_VERTICES", 5000)  # as in the process of the worker
    path = tmp_path / "session.png"
    options = {"size": SIZE, "tolerance": 0.05, "exposure": 0.35, "state": {"split": True, "angle_deg": 20.0}}
    assert view(scene, "noon", screenshot=path, **options) is None
    saved = iio.imread(path)
    session = session_of(scene, exposure=0.35)
    session.change(split=True, angle_deg=20.0, panel=False)
    window = Window(session, SIZE, off_screen=True)
    assert saved.shape == (*SIZE[::-1], 3) and np.array_equal(saved, bare(window))
    window.close()
    assert view(scene, "noon", screenshot=path, panel=True, **options) is None
    saved = iio.imread(path)
    window = Window(session_of(scene, exposure=0.35), SIZE, off_screen=True)
    window.session.change(split=True, angle_deg=20.0)
    window.finish()
    figures = slice(SIZE[1] - 130, SIZE[1] - 48)  # milliseconds differ
    for picture in (saved, expected := window.picture()):
        picture[figures] = 0
    assert saved.shape == (*SIZE[::-1], 3) and np.array_equal(saved, expected)
    window.close()


def test_a_key_saves_pictures_without_the_panel_under_free_names(window, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    expected = bare(window)
    window.press_key("p")
    assert "relight_0001.png" in window.note
    window.press_key("p")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["relight_0001.png", "relight_0002.png"]
    assert np.array_equal(iio.imread("relight_0001.png"), expected)


def test_the_window_shows_its_picture_with_and_without_the_panel(window):
    for panel in (True, False):
        picture = window.picture(panel)
        assert np.array_equal(window.plotter.screenshot(return_img=True), picture)
    assert (window.picture() != picture).any(axis=2).mean() > 0.1


@pytest.mark.slow
def test_a_film_holds_every_angle_in_full_and_leaves_the_session_as_it_was(scene, tmp_path):
    path = tmp_path / "turn.gif"
    options = {"size": (240, 180), "tolerance": 0.05, "exposure": 0.35}
    record_turntable(path, scene, "noon", frames=4, **options)
    film = iio.imread(path, index=None)
    assert film.shape == (4, 180, 240, 3)
    window = Window(session_of(scene, exposure=0.35), (240, 180), off_screen=True)
    for index in range(4):
        window.session.change(angle_deg=90.0 * index)
        # 256 colours for each picture
        assert np.abs(film[index].astype(int) - bare(window)).mean() < 4.0
    before = window.session.state
    window.record(tmp_path / "dropped.gif")
    window.tick()
    window.press_key("v")
    assert not window.recording and not (tmp_path / "dropped.gif").exists() and window.session.state == before
    window.close()
    for name, more in (("turn.gif", {}), ("turn.avi", {}), ("no/turn.gif", {}), ("a.gif", {"frames": 1})):
        with pytest.raises(InputError):
            record_turntable(tmp_path / name, scene, "noon", **(options | more))


def test_in_a_notebook_the_loop_pushes_every_picture_until_it_is_closed(window):
    pushed = []

    def push():
        pushed.append(window.session.state.angle_deg)
        if len(pushed) == 1:
            window.press_key("Right")
        elif pushed[-1] == 5.0:
            window.quit()

    asyncio.run(run_loop(window, push))
    assert pushed[0] == 0.0 and pushed[-1] == 5.0 and not window.is_open


def test_without_trame_one_line_says_what_to_do(window, monkeypatch):
    for name in ("trame", "trame_pyvista", "trame_pyvista.ui"):
        monkeypatch.setitem(sys.modules, name, None)
    for start in (show_widget, lambda window: serve(window, Served.at(0))):
        with pytest.raises(InputError, match="pip install"):
            start(window)


def test_without_a_display_one_line_says_what_to_do(scene, monkeypatch):
    if sys.platform == "linux":
        monkeypatch.delenv("DISPLAY", raising=False)
        with pytest.raises(InputError, match="no display"):
            view(scene)


def test_a_film_goes_on_after_a_reset_and_a_resize_and_is_dropped_only_when_asked_twice(window, tmp_path):
    path = tmp_path / "turn.gif"
    window.session.change(angle_deg=10.0)
    window.record(path, Turntable(frames=4))
    recording = window._recording
    while recording._done < 2:
        window.tick()
    assert "of 4, about" in window.note and "s left" in window.note
    window.session.change(angle_deg=77.0)  # as a reset would
    window.plotter.window_size = [SIZE[0] + 40, SIZE[1] - 20]
    while recording._done < 3:
        window.tick()
    assert window.session.state.angle_deg % 360 == pytest.approx(10.0 + 180.0)  # of the third picture, not 77
    window.press_key("q")
    assert window.is_open and window.recording and "discard it" in window.note
    while window.recording:
        window.tick()
    assert iio.imread(path, index=None).shape == (4, *SIZE[::-1], 3) and str(path.absolute()) in window.note
    window.plotter.window_size = list(SIZE)
    window.record(tmp_path / "dropped.gif", Turntable(frames=40))
    window.press_key("q")
    window.press_key("q")
    assert not window.is_open
    window.close()
    assert not (tmp_path / "dropped.gif").exists()


def test_pictures_of_another_size_are_cut_and_filled_about_their_middle():
    image = np.arange(5 * 3 * 3, dtype=np.uint8).reshape(5, 3, 3)
    found = fit_to(image, (3, 5))
    assert found.shape == (3, 5, 3) and np.array_equal(found[:, 1:4], image[1:4]) and not found[:, [0, 4]].any()
    assert np.array_equal(fit_to(image, (5, 3)), image)
