"""Parts by hand in the session: clicks grow them, a slider says how far, and commands know them by name."""

import json

import numpy as np
import pytest

pytest.importorskip("pyvista")

from ball_splats import solid_ball
from inline_worker import InlineWorker
from viewer_scenes import SIZE, Clock, ball_on_plate

from relight import LightingOptions, RelightRequest
from relight.albedo.by_hand import HandLight
from relight.cli import main
from relight.jobs.job import Job
from relight.jobs.session import session_of
from relight.splats.kept_parts import NAME, kept_parts
from relight.viewer.controls import CONTROLS
from relight.viewer.part_bench import PartMade
from relight.viewer.session import Session
from relight.viewer.window import Window
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.formats import read_splats, write_inria_ply

pytestmark = pytest.mark.usefixtures("vtk_is_silent")

LIGHT = ["--env", "noon", "--method", "analytic", "--bands", "3", "--format", "splat"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """ball.ply, red above and green below, and its scene."""
    folder = tmp_path_factory.mktemp("parts")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        write_inria_ply("ball.ply", solid_ball())
        assert main(["ball.ply", *LIGHT, "-o", "whole"]) == 0
    return folder


def session_in(folder, **changes):
    lighting = LightingOptions.of("analytic", bands=3, tolerance=0.05)
    request = RelightRequest(str(folder / "ball"), "noon", lighting, caching="none", **changes)
    return Session(session_of(Job(request)), InlineWorker, Clock())


@pytest.fixture
def window(folder):
    opened = Window(session_in(folder), SIZE, off_screen=True)
    opened.session.finish()
    opened.press_key("5")
    yield opened
    opened.close()


def click(window, x, y):
    window._interactor.SetEventPosition(round(x), round(y))
    window.mouse.press("Left")()
    window.mouse.release()


def slide(window, name, wanted):
    """Click a slider where it takes a value, to a pixel."""
    slider = next(hot for hot in window.panel.hot if hot.name == name)
    left, base, width, height = slider.box
    places = np.arange(left, left + width)
    found = [slider.value(x, base + height / 2) for x in places]
    click(window, places[np.argmin(np.abs(np.subtract(found, wanted)))], base + height / 2)


def pixel(window, above):
    """The pixel of the middle of the ball, or so far above it in units of the splat."""
    scene, orbit = window.session.scene, window.orbit
    place = np.asarray(scene.scene_from_splat) @ [0.0, -above, 0.0, 1.0]
    toward = orbit.axes @ (place[:3] - orbit.eye)
    focal = orbit.focal(SIZE)
    return SIZE[0] / 2 - focal * toward[0] / toward[2], SIZE[1] / 2 - focal * toward[1] / toward[2]


def is_red(splats):
    return splats.means[:, 1] < 0


def test_a_click_makes_the_part_of_its_colour_and_shows_it(window, folder):
    splats, bench = read_splats(folder / "ball.ply"), window.session.parts
    before = window.picture(panel=False)
    click(window, 3, SIZE[1] / 2)
    assert window.note == "no surface there: click what belongs to the part"
    click(window, *pixel(window, 1.2))
    shell = np.linalg.norm(splats.means, axis=1) > 1.9
    found = bench.splats
    assert (found == is_red(splats))[shell].mean() > 0.97
    assert f"{found.sum():,} splats in the part" in window.note
    after = window.picture(panel=False)
    x, y = (round(each) for each in pixel(window, 1.2))
    assert np.abs(after[SIZE[1] - 1 - y, x].astype(int) - before[SIZE[1] - 1 - y, x]).max() > 20
    x, y = (round(each) for each in pixel(window, -1.2))
    assert (after[SIZE[1] - 1 - y, x] == before[SIZE[1] - 1 - y, x]).all()


def test_another_click_adds_and_undo_takes_back(window):
    bench = window.session.parts
    click(window, *pixel(window, 1.2))
    red = bench.splats.sum()
    click(window, *pixel(window, -1.2))
    assert len(bench.clicks) == 2 and bench.splats.sum() > 1.8 * red
    window.press_key("z")
    assert bench.splats.sum() == red
    window.press_key("y")
    assert bench.splats.sum() > 1.8 * red
    window.press_key("r")
    assert not bench.clicks and not bench.splats.any()


def test_the_slider_says_how_far_a_part_reaches(window):
    bench = window.session.parts
    click(window, *pixel(window, 1.2))
    window.picture()
    small = bench.splats.sum()
    slide(window, "part_reach", 0.9)
    assert bench.reach > 0.8 and bench.splats.sum() > small  # into the edge of the other colour
    window.press_key("z")
    assert bench.splats.sum() == small


def test_a_part_has_a_light_of_its_own_that_is_kept_and_undone(window, folder, monkeypatch):
    monkeypatch.chdir(folder)
    bench, scene = window.session.parts, folder / "ball"
    click(window, *pixel(window, 1.2))
    colors = window.session.scene.colors_srgb
    marked = bench.tinted(colors)
    window.picture()
    slide(window, "part_exposure_ev", 2.0)
    slide(window, "part_warmth", 1.0)
    made, part = bench.made, bench.vertices
    assert made.exposure_ev == pytest.approx(2, abs=0.1) and made.warmth == pytest.approx(1, abs=0.1)
    shown = bench.tinted(colors)
    np.testing.assert_array_equal(shown[~part], colors[~part])
    before, after = (linear_from_srgb(each[part] / np.float32(255)) for each in (colors, shown))
    seen = (before.mean(axis=0) > 0.01) & (after.mean(axis=0) < 0.9)
    factors = after.mean(axis=0) / before.mean(axis=0)
    wanted = 2**made.exposure_ev * HandLight(warmth=made.warmth).tint
    np.testing.assert_allclose(factors[seen], wanted[seen], rtol=0.05)
    window.press_key("z")
    window.press_key("z")
    np.testing.assert_array_equal(bench.tinted(colors), marked)
    window.press_key("y")
    window.press_key("Return")
    name = next(reversed(kept_parts(scene)))
    assert window.note == f"kept as {name}: relight {scene} --part {name}" and bench.made == PartMade()
    assert kept_parts(scene)[name].light == {"exposure": made.exposure_ev}
    assert main(["ball", *LIGHT, "--part", name, "-o", "lit"]) == 0
    assert main(["ball", *LIGHT, "--part", f"ball/{name}.npy", f"exposure={made.exposure_ev}", "-o", "lit"]) == 0
    assert main(["ball", *LIGHT, "--part", name, "exposure=-1", "-o", "darker"]) == 0
    reports = [json.loads((folder / path / "report.json").read_text()) for path in ("lit", "darker")]
    assert [each["parts"][0]["exposure"] for each in reports] == [made.exposure_ev, -1]
    (scene / NAME).unlink()


def test_a_drag_looks_around_and_other_modes_come_first(window):
    session, orbit = window.session, window.orbit
    window._interactor.SetEventPosition(200, 200)
    window.mouse.press("Left")()
    window._interactor.SetEventPosition(260, 220)
    window.mouse.move()
    window.mouse.release()
    assert window.orbit != orbit and not session.parts.clicks
    assert session.uses("parts") and not session.shows_splats
    session.change(tool="lamps")
    assert not session.uses("parts") and not window.mouse.parts.on
    window.press_key("5")
    assert session.uses("parts")
    window.press_key("5")
    assert not session.uses("parts") and session.shows_splats


def test_what_is_kept_is_a_part_for_the_commands(window, folder, monkeypatch, capfd):
    monkeypatch.chdir(folder)
    bench, scene = window.session.parts, folder / "ball"
    window.press_key("Return")
    assert window.note == "the part has no splats"
    click(window, *pixel(window, 1.2))
    part = bench.splats
    window.press_key("Return")
    assert window.note == f"kept as part1: relight {scene} --only part1" and not bench.clicks
    np.testing.assert_array_equal(np.load(kept_parts(scene)["part1"].file), part)
    assert main(["ball.ply", *LIGHT, "--only", "part1", "-o", "named"]) == 0
    assert main(["ball", *LIGHT, "--only", "ball/part1.npy", "-o", "rows"]) == 0
    files = "named/relit_splat.ply", "rows/relit_splat.ply", "whole/relit_splat.ply", "ball.ply"
    named, rows, whole, captured = map(read_splats, files)
    np.testing.assert_array_equal(named.sh, rows.sh)
    np.testing.assert_array_equal(named.sh[part], whole.sh[part])
    assert (named.sh == captured.sh).all(axis=(1, 2)).sum() > 0.3 * len(part)
    report = json.loads((folder / "named" / "report.json").read_text())
    assert report["part"]["splats"]["part"] == part.sum()
    capfd.readouterr()
    assert main(["ball", *LIGHT, "--only", "part9"]) == 2
    assert "the name of a part made in the session" in capfd.readouterr().err
    (scene / NAME).write_text("{")
    assert main(["ball", *LIGHT, "--only", "part1"]) == 2
    assert "not valid JSON" in capfd.readouterr().err
    click(window, *pixel(window, 1.2))
    window.press_key("Return")
    assert "not valid JSON" in window.note and bench.clicks


def test_a_mesh_alone_has_no_parts():
    job = Job(RelightRequest(ball_on_plate(), "noon", albedo="captured", caching="none"))
    session = Session(session_of(job), InlineWorker, Clock())
    assert session.parts is None
    assert not {"5", "Return"} & {control.key for control in CONTROLS if control.there(session)}
    session.close()
