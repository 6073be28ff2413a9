"""The interactive session without its window: state, light, worker, controls."""

import numpy as np
import open3d as o3d
import pytest
from inline_worker import InlineWorker
from viewer_scenes import ByHand, as_scene, ball_on_plate, constant, session_of

from relight import Environment, Relighter
from relight.light.tonemap import tone_map
from relight.transfer.occluder import Occluder
from relight.transfer.reference import reference
from relight.transfer.volume import Foliage
from relight.viewer import quick
from relight.viewer.camera import PICTURE_ASPECT, Orbit
from relight.viewer.controls import CONTROLS, SLIDERS, key_name
from relight.viewer.lighting import SessionLighting, SessionScene, _gather, keys
from relight.viewer.request import SessionRequest
from relight.viewer.session import Session
from relight.viewer.stage import surface_colors
from relight.viewer.state import RANGES, choices_of
from relight.viewer.worker import REST_SECONDS, ProcessWorker
from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Stages
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb
from splat2mesh.scene.optical_depth import OpticalDepth


@pytest.fixture(scope="module")
def scene():
    return ball_on_plate()


def relative(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


# What runs for every frame


def test_light_of_a_frame_is_the_product_it_stands_for():
    rng = np.random.default_rng(1)
    transfer, coefficients = rng.normal(size=(101, 25)).astype(np.float32), rng.normal(size=(100, 3))
    albedo, bounced = rng.random((101, 3)).astype(np.float32), rng.normal(size=(3, 101, 16)).astype(np.float32)
    direct = np.maximum(transfer.astype(float) @ coefficients[:25], 0.0)
    # Sums of 25 float32 products, in any order: 25 roundings of numbers up to about 10.
    assert np.allclose(quick.harmonic_light(transfer, coefficients), direct, atol=25 * 6e-8 * 10)
    expected = np.maximum(albedo * direct + np.einsum("cvk,kc->vc", bounced, coefficients[:16]), 0.0)
    assert np.allclose(quick.harmonic_light(transfer, coefficients, albedo, bounced), expected, atol=41 * 6e-8 * 10)


def test_bytes_of_a_frame_are_those_of_the_tone_mapper():
    rng = np.random.default_rng(2)
    radiance = np.exp(rng.normal(size=(20_000, 3)) * 2.0).astype(np.float32) - 0.2
    found, expected = quick.display_bytes(radiance, 0.3), bytes_from_unit(tone_map(radiance * np.float32(0.3)))
    assert np.abs(found.astype(int) - expected).max() <= 1  # the table's steps, a fifth of a byte where it is steepest
    assert (found == expected).mean() > 0.97


# The light of a session


def test_a_constant_sky_on_white_without_effects_gives_one(scene):
    session = session_of(scene, constant(), albedos={"white": None})
    session.change(effects=())
    session.finish()
    assert np.abs(session.radiance() - 1.0).max() < 1e-6  # A_0 / pi Y_0 times sqrt(4 pi), in float32
    assert np.abs(session.quick_radiance() - 1.0).max() < 1e-6


def test_what_settles_is_what_the_engine_gives(scene):
    session = session_of(scene)
    session.change(angle_deg=70.0)
    session.finish()
    albedo = linear_from_srgb(scene.colors_srgb / np.float32(255.0))
    light = Environment.load("noon").rotated(70.0)
    expected = Relighter(scene, tolerance=0.05).shading(light, albedo)
    assert (
        session.answers.lit.sun_count == expected.sun_count > 0
        and session.answers.lit.bounces == expected.bounces != []
    )
    assert np.array_equal(session.radiance(), expected.radiance)


def test_a_turned_light_shows_at_once_and_the_rest_follows(scene):
    session = session_of(scene)
    session.finish()
    settled = session.radiance()
    session.change(angle_deg=90.0)
    assert not session.complete and session.waiting_for
    quick_one = session.radiance()
    session.poll()  # too early: the hand may still move
    assert session.radiance() is quick_one
    session.clock.now += REST_SECONDS / 2
    session.poll()
    assert session.radiance() is quick_one
    session.finish()
    assert session.complete and not session.waiting_for
    full = session.radiance()
    # Harmonics blur the sun but keep its light: much nearer to the new light than the old one is.
    assert relative(quick_one, full) < 0.6 * relative(settled, full)
    session.change(angle_deg=0.0)
    session.finish()
    assert np.array_equal(session.radiance(), settled)


def test_under_smooth_light_what_shows_at_once_is_nearly_all(scene):
    session = session_of(scene, "overcast", tolerance=0.02)
    session.finish()
    assert session.answers.lit.sun_count == 0 and len(session.answers.lit.bounces) > 0
    # Bounced light beyond four bands, by few rays; below the tolerance in any case.
    assert relative(session.quick_radiance(), session.radiance()) < 0.015


def test_each_effect_that_is_off_is_the_engine_without_it(scene):
    session = session_of(scene)
    light, albedo = Environment.load("noon"), linear_from_srgb(scene.colors_srgb / np.float32(255.0))
    session.finish()
    errors = {"all": session.answers.error}
    relighter = Relighter(scene, tolerance=0.05)
    settings = relighter.shading(light, albedo).settings
    for effects, expected in (
        ({"shadows", "sun"}, settings._replace(bounce_rays=0, bounce_tolerance=0.0)),
        ({"shadows", "bounces"}, settings._replace(sun_tolerance=0.0)),
        ({"shadows"}, settings._replace(sun_tolerance=0.0, bounce_rays=0, bounce_tolerance=0.0)),
    ):
        session.change(effects=effects)
        session.finish()
        assert np.array_equal(session.radiance(), relighter.shading(light, albedo, expected).radiance)
        errors[" ".join(sorted(effects))] = session.answers.error
    for effects in ({"sun", "bounces"}, set()):
        session.change(effects=effects)
        assert session.effects == frozenset()
        session.finish()
        errors["none"] = session.answers.error
    assert errors["all"] == min(errors.values()) < 0.05 and errors["none"] > 0.1


def test_the_stated_error_is_the_distance_from_the_truth():
    # Convex, white, under a constant sky: every vertex sends out exactly 1.
    ball = as_scene(o3d.geometry.TriangleMesh.create_sphere(1.0, 20))
    lighting = SessionLighting(SessionScene(ball, {"constant": constant()}, {"white": None}), Stages())
    session = session_of(ball, constant(), albedos={"white": None})
    for factor in (0.9, 1.0, 1.1):
        shown = np.full((len(ball.vertices), 3), factor, np.float32)
        # The reference shines from 8192 cells: their cosines sum to pi within a thousandth.
        assert lighting._error_of(shown, shown, session.answers.wish) == pytest.approx(abs(factor - 1.0), abs=2e-3)


def test_what_the_stated_error_gathers_is_what_surrounds_a_vertex():
    hollow = o3d.geometry.TriangleMesh.create_sphere(1.0, 20)
    hollow.compute_vertex_normals()
    vertices, faces = np.asarray(hollow.vertices, np.float32), np.asarray(hollow.triangles)
    inward = Occluder(vertices, -np.asarray(hollow.vertex_normals, np.float32), faces)
    rows = np.arange(0, len(vertices), 7)
    sent = np.tile(np.float32([0.2, 0.5, 1.0]), (len(vertices), 1))
    assert np.abs(_gather(inward, rows, sent) - sent[rows]).max() < 1e-5  # a thousand float32 summed
    outward = Occluder(vertices, np.asarray(hollow.vertex_normals, np.float32), faces)
    assert _gather(outward, rows, sent).max() == 0.0  # nothing but sky before them


@pytest.mark.parametrize("per_cell", [0.0, 0.02, 0.5])
def test_what_leaves_do_not_see_of_a_white_sky_they_gather(per_cell):
    """In a white hollow under a white sky all light is 1: bounces add the part that is not direct."""
    hollow = o3d.geometry.TriangleMesh.create_sphere(1.0, 12)
    hollow.compute_vertex_normals()
    vertices, faces = np.asarray(hollow.vertices, np.float32), np.asarray(hollow.triangles)
    occluder = Occluder(vertices, -np.asarray(hollow.vertex_normals, np.float32), faces)
    cells = np.full((20, 20, 20), per_cell, np.float32)
    depth = OpticalDepth.of_levels([np.full(3, -1.0)], [0.1], [cells])
    foliage = Foliage(vertices, np.linspace(0.0, 1.0, len(vertices)), depth)
    rows = np.arange(0, len(vertices), 5)
    direct = reference(occluder, rows, constant(), foliage=foliage)
    whole = direct + _gather(occluder, rows, np.ones((len(vertices), 3), np.float32), foliage)
    # The directions of both differ: of 8192 and 1024, through a grid of cells.
    assert np.abs(whole - 1.0).max() < 0.02
    assert per_cell == 0.0 or direct[-1].max() < 0.9


def test_exposure_is_in_stops_and_does_not_breathe(scene):
    session = session_of(scene)
    session.finish()
    before = session.exposure()
    session.change(exposure_ev=2.0)
    assert session.exposure() == pytest.approx(4.0 * before, rel=1e-12)
    session.change(angle_deg=123.0, exposure_ev=0.0)
    session.finish()
    assert session.exposure() == before
    assert session_of(scene, exposure=0.25).exposure() == 0.25


def test_reset_returns_to_the_start_and_values_stay_in_range(scene):
    session = session_of(scene)
    session.change(angle_deg=-30.0, exposure_ev=99.0, tolerance=9.0, mode="normals", split_at=-1.0, effects=())
    state = session.state
    assert (state.angle_deg, state.exposure_ev, state.tolerance) == (330.0, RANGES["exposure_ev"][1], 0.1)
    assert state.split_at == RANGES["split_at"][0]
    session.reset()
    assert session.state == session.start


def test_unusable_input_is_refused(scene, tmp_path):
    for changes in ({"angle_deg": np.nan}, {"mode": "x-ray"}, {"environment": "moon"}, {"albedo": "guessed"}):
        with pytest.raises(InputError, match=next(iter(changes))):
            session_of(scene).change(**changes)
    for options in (
        {"tolerance": 0.5},
        {"albedos": {}},
        {"albedos": {"half": np.full((3, 3), 0.5)}},
        {"albedos": {"bright": np.full((len(scene.vertices), 3), 1.5)}},
        {"effects": "moonlight"},
    ):
        with pytest.raises(InputError):
            session_of(scene, **options)
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "missing", tmp_path / "empty"):
        with pytest.raises(InputError, match=str(folder)):
            choices_of("noon", folder)
    for name in ("b.exr", "a.HDR", "notes.txt"):
        (tmp_path / name).write_text("")
    assert list(choices_of("noon", tmp_path))[:3] == ["noon", "a", "b"]


@pytest.mark.parametrize("known", [True, False])
def test_captured_lamps_shine_as_they_are_set(scene, known):
    given = np.full((len(scene.vertices), 3), [0.4, 0.3, 0.1], np.float32)
    session = session_of(scene, lamps={"captured": given}, lamps_known=known)
    session.change(effects=())
    session.finish()
    lit, quick_one = session.radiance(), session.quick_radiance()
    for factor in (0.0, 0.5, 2.0):
        session.change(lamps=factor)
        assert np.allclose(session.radiance(), lit + (factor - 1.0) * given, atol=1e-5)
        assert np.allclose(session.quick_radiance(), quick_one + (factor - 1.0) * given, atol=1e-5)
    session.change(lamps=-1.0)
    assert session.state.lamps == 0.0
    session.change(albedo="white")
    assert np.array_equal(session.radiance(), session.quick_radiance())  # for which no lamps are known
    assert [control.there(session) for control in CONTROLS if "captured lamps" in control.text] == [known]
    assert [slider.there(session) for slider in SLIDERS if slider.field == "lamps"] == [known]


# Views


def test_views_show_albedo_and_normals_whatever_the_light(scene):
    session = session_of(scene)
    expected = {"albedo": scene.colors_srgb, "normals": bytes_from_unit(0.5 + 0.5 * scene.normals)}
    for name, colors in expected.items():
        session.change(mode=name, angle_deg=50.0)
        assert np.abs(surface_colors(session).astype(int) - colors).max() <= 1


# The worker


@pytest.mark.slow
def test_the_worker_answers_as_if_it_were_here_and_survives_bad_lights(scene, tmp_path, monkeypatch):
    monkeypatch.setattr("relight.planning.unmeasured.UNMEASURED_VERTICES", 5000)  # as in the process of the worker
    (tmp_path / "broken.hdr").write_bytes(b"#?RADIANCE\nnothing")
    lights = choices_of("noon", tmp_path)
    session = Session(SessionRequest.of(scene, lights, tolerance=0.05), ProcessWorker)
    try:
        session.finish()
        here = session_of(scene)
        here.finish()
        assert np.array_equal(session.radiance(), here.radiance()) and session.answers.error == here.answers.error
        session.change(environment="broken")
        with pytest.raises(InputError, match=r"broken\.hdr"):
            session.finish()
        assert "broken.hdr" in session.answers.message and session.answers.light_name == "noon"
        session.change(environment="noon", tolerance=0.003)  # seconds of work, of no use once the next wish is there
        while session.answers.progress is None and not session.settled:  # the worker has not begun
            session.poll()
        session.change(tolerance=0.05, angle_deg=10.0)
        session.finish()
        assert session.answers.message == "" and session.complete
        session.answers._worker._process.kill()
        while "ended" not in session.answers.message:
            session.poll()
        session.change(angle_deg=200.0)
        assert session.radiance() is not None and not session.complete  # by harmonics, without the worker
        with pytest.raises(InputError, match="ended"):
            session.finish()
    finally:
        session.close()


@pytest.mark.parametrize("polled", [True, False])
def test_a_light_that_is_asked_for_again_is_complete_when_it_is_answered_again(scene, polled):
    """Once answered, then left for another whose light has come in: what shows is the other's."""
    session = session_of(scene, worker=ByHand)
    worker, first = session.answers._worker, session.answers.wish
    worker.shade(first)
    worker.say("done", first)
    session.poll()
    assert session.settled and session.complete
    session.change(effects=())
    second = session.answers.wish
    assert not session.settled
    worker.shade(second)
    if polled:
        session.poll()
        assert session.complete and not session.settled
    session.reset()
    assert session.answers.wish == first and worker.asked == [first, second, first]
    session.poll()
    assert not session.complete and not session.settled
    worker.shade(first)
    session.poll()
    assert session.complete and not session.settled  # errors may follow
    worker.say("done", first)
    session.poll()
    assert session.complete and session.settled


def test_an_answer_that_was_under_way_does_not_hide_what_came_after_it(scene):
    session = session_of(scene, worker=ByHand)
    worker, first = session.answers._worker, session.answers.wish
    worker.shade(first)
    worker.say("done", first)
    session.change(effects=())
    worker.shade(session.answers.wish)
    session.reset()
    session.poll()  # takes in all of it at once
    assert session.answers.wish == first and not session.complete and not session.settled


def test_a_light_that_failed_is_tried_again(scene):
    session = session_of(scene, worker=ByHand)
    worker, first = session.answers._worker, session.answers.wish
    worker.say("failed", first, "it is dark")
    session.poll()
    assert session.failure == session.answers.message == "it is dark"
    session.change(effects=())
    assert session.failure == ""
    session.reset()
    assert session.failure == ""


def test_only_work_that_a_newer_wish_makes_pointless_ends_early(scene):
    wish = session_of(scene).answers.wish
    turned, finer = wish._replace(angle_deg=5.0), wish._replace(tolerance=0.01)
    unchanged = {kind for kind, key in keys(wish).items() if keys(turned)[kind] == key}
    assert unchanged == {"light", "unshadowed", "transfer", "bounced"}
    unchanged = {kind for kind, key in keys(wish).items() if keys(finer)[kind] == key}
    assert unchanged == {"light", "unshadowed"}


def test_a_method_lights_the_scene_and_the_plan_comes_back(scene):
    session = session_of(scene)
    session.finish()
    planned = session.answers.lit.radiance
    for method in ("neural-gash", "analytic"):
        session.change(method=method)
        session.finish()
        assert session.answers.lit.settings.startswith(method)
        assert np.abs(session.quick_radiance() - planned).max() > 0.01
    session.change(method="auto")
    session.finish()
    np.testing.assert_array_equal(session.answers.lit.radiance, planned)
    with pytest.raises(InputError, match="expected one of auto, neural-gash, analytic"):
        session.change(method="blinn-phong")
    assert session_of(scene, method="raytraced").choices["method"] == ["raytraced"]


# Controls and camera


def test_every_control_is_distinct_and_explained():
    assert len({control.key for control in CONTROLS}) == len(CONTROLS)
    assert len({control.text for control in CONTROLS}) == len(CONTROLS)
    assert len({key_name(control) for control in CONTROLS}) == len(CONTROLS)
    assert {slider.field for slider in SLIDERS} <= set(RANGES)
    assert {control.chip(None) if control.row == "" else control.row for control in CONTROLS if control.chip} <= {
        "modes",
        "choices",
        "hand",
        "both",
    }
    assert [control.key for control in CONTROLS if control.text.startswith("Normals")] == ["3"]


def test_an_orbit_looks_where_the_camera_did():
    camera = {"eye": [1.0, 2.0, 3.0], "target": [0.0, 0.5, 0.0], "up": [0.0, 1.0, 0.0], "fov_deg": 40.0}
    orbit = Orbit.of(camera, np.zeros((1, 3)), 1.0)
    toward = np.subtract(camera["target"], camera["eye"])
    assert np.allclose(-orbit.axes[2], toward / np.linalg.norm(toward))
    assert np.allclose(orbit.axes @ orbit.axes.T, np.eye(3)) and np.linalg.det(orbit.axes) > 0.99
    assert np.allclose(orbit.dragged(2.0, 0.0).eye, orbit.eye)  # twice around half the window's height is a full turn
    assert abs(orbit.dragged(0.0, -9.0).elevation_deg) == abs(orbit.dragged(0.0, 9.0).elevation_deg) == 89.0
    assert np.allclose(orbit.nearer(3).nearer(-3).eye, orbit.eye)
    right = orbit.moved(0.1, 0.0, 4 / 3)
    assert (np.subtract(right.target, orbit.target) @ orbit.axes[0]) < 0.0  # the scene follows the mouse


def test_from_within_a_scene_the_camera_turns_about_what_it_sees():
    wall = np.array([[0.0, 0.0, -4.0], [0.1, 0.0, -4.0], [0.0, 3.0, 0.0]])
    camera = {"eye": [0.0, 0.0, 0.0], "target": [0.0, 0.0, -0.01], "up": [0.0, 1.0, 0.0], "fov_deg": 60.0}
    orbit = Orbit.of(camera, wall, 5.0)
    assert np.allclose(orbit.target, [0.0, 0.0, -4.0]) and np.allclose(orbit.eye, 0.0, atol=1e-9)


@pytest.mark.parametrize("within", [False, True])
@pytest.mark.parametrize("aspect", [0.8, 4 / 3, 2.2])
def test_a_picture_fits_into_what_the_panel_leaves_free(within, aspect):
    camera = {"eye": [1.0, 2.0, 3.0], "target": [0.0, 0.5, 0.0], "up": [0.0, 1.0, 0.0], "fov_deg": 40.0}
    orbit = Orbit.of(camera, np.zeros((1, 3)), 1.0)
    window = orbit.in_window(aspect, (0.1, 0.3), within)
    wide = np.tan(np.radians(20.0))
    corners = [x * wide * orbit.axes[0] + y * wide / PICTURE_ASPECT * orbit.axes[1] for x in (-1, 1) for y in (-1, 1)]
    pictured = np.array([orbit.target, *(orbit.target + orbit.distance * corner for corner in corners)])
    x, y, depth = ((pictured - window.eye) @ window.axes.T).T
    half = np.tan(np.radians(window.fov_deg / 2.0))
    across, above = x / -depth / half, y / -depth / half * aspect
    assert np.abs(across).max() <= 1.03
    low, high = 2 * 0.3 - 1, 1 - 2 * 0.1
    assert above[0] == pytest.approx((low + high) / 2, abs=1e-6)
    assert low - 0.03 <= above.min() and above.max() <= high + 0.03  # a tilt bends the corners a little
    assert np.allclose(window.eye, orbit.eye) == within


def test_without_a_process_the_same_messages_come(scene):
    worker = InlineWorker(SessionScene(scene, {"noon": "noon"}, {"white": None}))
    assert worker.poll() == []
    worker.submit(session_of(scene, albedos={"white": None}).answers.wish)
    kinds = [message[0] if message[0] != "result" else message[1] for message in worker.poll()]
    assert kinds[:2] == ["unshadowed", "light"] and kinds[-1] == "done" and "shading" in kinds
