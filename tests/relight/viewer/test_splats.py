"""Splats in the session: relit as what is written, drawn as what is written, at once and without waiting."""

from dataclasses import replace
from threading import Event

import numpy as np
import pytest

pytest.importorskip("pyvista")

from viewer_scenes import SIZE, ball_on_plate, bare, session_of

from relight.engine.light_mix import LightBeside
from relight.splats import Binding
from relight.splats.sky import FarSplats
from relight.viewer.controls import CONTROLS
from relight.viewer.splats import WAITING, SplatLook, SplatPainter, SplatSource, coarser
from relight.viewer.window import Window
from splat2mesh.base.errors import InputError
from splat2mesh.splats.splats import SH_C0, Splats

pytestmark = pytest.mark.usefixtures("vtk_is_silent")

BEFORE, LEAST = 0.8, 0.02
FRAME = np.diag([2.0, -2.0, -2.0, 1.0])
"""Splats are upside down, and their unit is two of the scene."""


@pytest.fixture(scope="module")
def scene():
    return replace(ball_on_plate(), scene_from_splat=FRAME)


@pytest.fixture(scope="module")
def splats(scene):
    """One for each vertex, in its colour, with some that depends on the view."""
    rng = np.random.default_rng(5)
    means = (scene.vertices @ np.linalg.inv(FRAME[:3, :3]).T).astype(np.float32)
    count = len(means)
    sh = rng.normal(scale=0.05, size=(count, 4, 3)).astype(np.float32)
    sh[:, 0] = (scene.colors_srgb / np.float32(255.0) - 0.5) / SH_C0
    scales = np.full((count, 3), 0.05, np.float32)
    quats = rng.normal(size=(count, 4)).astype(np.float32)
    return Splats(means, scales, quats, np.full(count, 0.9, np.float32), sh)


@pytest.fixture(scope="module")
def binding(scene, splats):
    return Binding(splats, scene)


@pytest.fixture
def source(scene, splats, binding):
    before = np.full((len(scene.vertices), 3), BEFORE, np.float32)
    albedo = np.maximum(scene.colors_linear, LEAST)
    looks, none = {"captured": SplatLook(before, lambda light, _: light / albedo)}, np.zeros(0, np.int64)
    return SplatSource(splats, lambda: binding, looks, lambda captured: FarSplats(captured, none, none, np.eye(4)))


def window_of(scene, source, **options):
    return Window(session_of(scene, exposure=0.35, splats=source, **options), SIZE, off_screen=True)


def test_the_picture_at_rest_is_of_the_splats_that_would_be_written(scene, source, binding):
    window = window_of(scene, source)
    session = window.session
    session.change(angle_deg=40.0, sky=False)
    found = bare(window)
    look = source.looks["captured"]
    relit = binding.relit(look.before, look.received(session.radiance(), 0.35), 0.35)
    layer = SplatPainter(scene).exact(relit, window.orbit, SIZE)
    covered = layer.alpha > 0.999
    assert covered.mean() > 0.05
    assert np.abs(found - np.round(255.0 * np.clip(layer.color, 0.0, 1.0)))[covered].max() <= 1
    assert np.abs(found - 255.0 * source.captured.sh[:, 0].mean()).mean() > 1.0
    window.close()


@pytest.mark.parametrize("degree", [0, 1])
def test_shares_that_are_kept_draw_what_is_rasterised(scene, splats, degree):
    painter = SplatPainter(scene)
    some = Splats(splats.means, splats.scales, splats.quats_wxyz, splats.opacities, splats.sh[:, : (degree + 1) ** 2])
    window = Window(session_of(scene), SIZE, off_screen=True)
    orbit = window.orbit
    window.close()
    exact, again = (draw(some, orbit, SIZE) for draw in (painter.exact, painter.again))
    # What is less than 1/512 of a pixel is left out: of up to twenty splats in each, of few in most.
    off = np.abs(exact.color - again.color)
    assert off.max() < 20 / 512 and off[exact.alpha > 0.5].mean() < 2 / 512
    assert np.abs(exact.alpha - again.alpha).max() < 1e-5
    brighter = Splats(some.means, some.scales, some.quats_wxyz, some.opacities, some.sh + np.float32(0.1))
    kept = painter.again(brighter, orbit, SIZE)
    assert np.abs(kept.color - painter.exact(brighter, orbit, SIZE).color).max() < 20 / 512


def test_gloss_mirrors_the_environment_the_captured_light_and_lamps(scene, source):
    """Of an environment of half its strength, at twice the level of the picture, beside .3 of the captured light."""
    found = []

    def gloss(relit, shining):
        found.append(shining)
        return relit

    count = len(scene.vertices)
    mixture = LightBeside(*(np.full((count, 3), each, np.float32) for each in (0.2, 0.4)), 0.5, 2.0, 1.0, False, 0.3)
    shines = source._replace(looks={"captured": source.looks["captured"]._replace(gloss=gloss)})
    for light in (None, mixture):
        window = window_of(scene, shines, mixture=light)
        window.session.change(sky=False)
        bare(window)
        window.close()
    alone, mixed = found
    assert (alone.unit, alone.captured, alone.lamps) == (1.0, 0.0, None)
    assert mixed.captured == 0.3 and mixed.unit == mixed.exposure / 2.0
    scale = mixed.exposure / alone.exposure
    np.testing.assert_allclose(mixed.light, 0.5 * scale * alone.light, rtol=1e-6)
    np.testing.assert_allclose(mixed.radiance, 0.2 + 0.5 * alone.radiance, rtol=1e-6)


def test_light_that_changes_nothing_changes_no_pixel(scene, source):
    before = source.looks["captured"].before
    same = source._replace(looks={"captured": SplatLook(before, lambda light, exposure: before / exposure)})
    window = window_of(scene, same)
    window.session.change(split=True, sky=False)
    split = bare(window)
    window.session.change(split_at=0.02)
    columns = np.arange(SIZE[0])[:, None]
    free = (np.abs(columns - [0.5 * SIZE[0], 0.02 * SIZE[0]]) > 6).all(axis=1)  # of both places of the line
    assert np.array_equal(split[:, free], bare(window)[:, free])
    window.close()


def test_a_key_shows_the_mesh_and_there_is_none_without_splats(scene, source):
    plain, window = Window(session_of(scene, exposure=0.35), SIZE, off_screen=True), window_of(scene, source)
    of_mesh, of_splats = bare(plain), bare(window)
    assert (of_mesh != of_splats).any(axis=2).mean() > 0.05
    window.press_key("g")
    assert np.array_equal(bare(window), of_mesh)
    window.press_key("g")
    assert np.array_equal(bare(window), of_splats)
    for changes in ({"mode": "normals"}, {"albedo": "white"}):  # of which no splats are known
        for each in (plain, window):
            each.reset()
            each.session.change(**changes)
        assert np.array_equal(bare(window), bare(plain))
    (key,) = (control for control in CONTROLS if control.key == "g")
    assert key.there(window.session) and not key.there(plain.session)
    plain.close()
    window.close()


def test_while_the_camera_moves_the_picture_is_the_same_but_coarse(scene, source):
    window = window_of(scene, source)
    window.finish()
    window.look(window.orbit.dragged(0.05, 0.0))
    seen = []
    draw = window._stage._of_splats
    window._stage._of_splats = lambda *asked: seen.append(draw(*asked)) or seen[-1]
    window.tick()  # by a clock that stands still
    assert seen[-1].shape[:2] == coarser(SIZE)[::-1]
    moving = np.repeat(np.repeat(seen[-1].astype(int), 2, axis=0), 2, axis=1)
    assert np.abs(moving - bare(window)).mean() < 4.0
    assert seen[-1].shape[:2] == SIZE[::-1]
    window.close()


def test_until_they_are_bound_the_captured_splats_show_and_the_panel_says_so(scene, source, binding):
    ready = Event()
    slow = source._replace(binding=lambda: (ready.wait(), binding)[1])
    window = window_of(scene, slow)
    window.session.finish()
    window.tick()
    assert WAITING in [text for text, *_ in window.panel.boxes]
    assert window.session.splats.colored() is source.captured
    revision = window.session.revision
    ready.set()
    window.session.splats._prepared.result()
    while window.session.revision == revision:  # what is quick comes in
        window.session.poll()
    window.finish()
    assert window.session.splats.colored() is not source.captured
    window.close()


def test_splats_that_cannot_be_bound_stay_as_captured(scene, source):
    def broken():
        raise InputError("they are of another scene")

    window = window_of(scene, source._replace(binding=broken))
    window.finish()
    assert window.session.splats.colored() is source.captured
    window.tick()
    assert any("they are of another scene" in text for text, *_ in window.panel.boxes)
    window.close()


def test_light_that_splats_cannot_take_leaves_them_as_captured(scene, source):
    before = source.looks["captured"].before
    window = window_of(scene, source._replace(looks={"captured": SplatLook(before, lambda light, _: -light)}))
    window.finish()
    window.tick()
    assert window.session.splats.colored() is source.captured
    assert any("not negative" in text for text, *_ in window.panel.boxes)
    window.close()


def test_splats_of_the_sky_show_the_new_one_or_go(scene, source):
    rows = np.arange(50)

    def far(splats):
        return FarSplats(splats, rows, rows, scene.scene_from_splat)

    window = window_of(scene, source._replace(far=far))
    window.session.change(sky=False)
    window.finish()
    shown = window.session.splats.colored()
    assert (shown.opacities[rows] == 0.0).all() and (shown.opacities[50:] == source.captured.opacities[50:]).all()
    window.session.change(sky=True)
    window.finish()
    shown = window.session.splats.colored()
    bright = shown.sh[rows, 0]
    dim = window_of(scene, source._replace(far=far, sky_level=1e-3))
    dim.finish()
    assert (dim.session.splats.colored().sh[rows, 0] < bright).all()
    dim.close()
    assert (shown.opacities == source.captured.opacities).all() and not shown.sh[rows, 1:].any()
    window.close()
