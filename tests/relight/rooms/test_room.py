"""A generated closed box with a lamp, whose light radiosity knows: the lamp is found, and goes off."""

from functools import cache

import numpy as np
import pytest
from lit_rooms import room

from relight import Environment, LightingOptions, Relighter
from relight.albedo import samples
from relight.engine.appearance import Place
from relight.engine.relit_room import RelitRoom
from relight.jobs.job import Job
from relight.request import RelightRequest
from relight.rooms import lamps
from relight.rooms.interior import within
from relight.rooms.seen import seen_from
from relight.rooms.trust import DOUBT, trust_in
from relight.transfer.occluder import Frame, Occluder
from relight.transfer.store import Cache
from scenes.radiosity import light
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.color import luminance
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene


def relit(scene, **wishes):
    job = Job(
        RelightRequest(
            scene,
            wishes.pop("env", "overcast"),
            LightingOptions(tolerance=0.05, **wishes),
            albedo="estimated",
            caching="none",
        )
    )
    with pytest.warns(DataWarning, match="closed room"):
        shaded = next(iter(job.shaded()))
    return job, shaded, shaded.shading.radiance * shaded.exposure


@cache
def kept_on():
    return relit(room()[0], env="captured")


def test_the_lamp_is_found_with_its_strength_and_the_albedo_behind_its_light():
    _, place, exposure, _ = room()
    job, _, _ = kept_on()
    report = job.known.appearance.capture["room"]
    lamp = max(report["lamps"], key=lambda each: each["evidence"])
    glowing = place.emitted.any(axis=1)
    assert np.linalg.norm(np.subtract(lamp["place"], place.vertices[glowing].mean(axis=0))) < 0.1
    # How bright all is together is a prior's guess, of a median albedo of 0.4; here it is 0.3.
    true = float(luminance(place.emitted[glowing].mean(axis=0) * exposure))
    assert 0.4 < luminance(np.array(lamp["radiance"])) / true < 1.5 and lamp["evidence"] > 0.5
    assert len(report["lamps"]) == 1  # and not the ceiling above it, which is as white
    found, known = job.known.appearance.albedo, place.albedo_linear
    captured = job.known.appearance.captured
    lit = (captured.max(axis=1) < 0.9) & (captured.min(axis=1) > 0.01)

    def error(values):
        gain = (values[lit] * known[lit]).sum() / (values[lit] ** 2).sum()
        return np.linalg.norm(gain * values[lit] - known[lit]) / np.linalg.norm(known[lit])

    assert error(found) < 0.5 * error(captured)


def test_where_nothing_changes_the_room_is_as_captured():
    _, _, radiance = kept_on()
    captured = room()[0].colors_linear
    unclipped = captured.max(axis=1) < 0.9
    np.testing.assert_allclose(radiance[unclipped], captured[unclipped], rtol=1e-5)


def under(env, **wishes):
    """Radiance (V, 3) of the closed box under a light, with wishes for its lamp and ceiling."""
    relighter = Relighter(room()[0], tolerance=0.1, **wishes)
    look = kept_on()[0].known.appearance._replace(place=Place.ROOM)
    return RelitRoom(look, relighter, 1.0).shading(Environment.load(env)).radiance


def test_what_a_session_shows_of_a_room_is_what_is_written_of_it():
    relighter = Relighter(room()[0], tolerance=0.1, lamps=0.5)
    look = kept_on()[0].known.appearance._replace(place=Place.ROOM)
    place = RelitRoom(look, relighter, 2.0)
    written = place.shading(Environment.load("overcast"))
    _, by_lamps = place.session()
    found = place.as_captured(0.5 * by_lamps, written.settings)
    lit = ~look.room.glow.any(axis=1)
    # The light of glowing surfaces is separated only there, and weighs little in the mean change.
    np.testing.assert_allclose(found[lit], written.radiance[lit], rtol=0.01, atol=1e-4)
    np.testing.assert_allclose(found[~lit], written.radiance[~lit], rtol=1e-4)


def test_with_its_only_lamp_off_a_closed_box_is_dark_and_with_half_of_it_half_as_bright():
    captured = room()[0].colors_linear
    unclipped = captured.max(axis=1) < 0.9
    assert under("noon", lamps="off").mean() < 0.05 * captured.mean()
    half = under("noon", lamps=0.5)
    np.testing.assert_allclose(half[unclipped], 0.5 * captured[unclipped], rtol=0.1, atol=0.01)


def test_what_a_window_lets_in_is_new():
    scene, place, exposure, _ = room("one-window")
    with pytest.warns(DataWarning, match="found no lamp"):  # and none is dimmed
        _, _, radiance = relit(scene, env="noon", lamps=0.5)
    truth = exposure * light(place, Environment.load("noon")).radiance()
    captured, inside = scene.colors_linear, seen(scene, place)

    def error(values):
        gains = (values[inside] * truth[inside]).sum(axis=0) / (values[inside] ** 2).sum(axis=0)
        return np.linalg.norm(gains * values[inside] - truth[inside]) / np.linalg.norm(truth[inside])

    assert error(radiance) < 0.5 * error(captured)


def test_what_windows_let_in_of_the_captured_light_is_kept_and_a_broken_one_is_made_anew(tmp_path, monkeypatch):
    scene = room("one-window")[0]
    look = relit(scene)[0].known.appearance._replace(place=Place.ROOM)
    calls, shading = [], Relighter.shading
    monkeypatch.setattr(Relighter, "shading", lambda *given: calls.append(given) or shading(*given))

    def lit():
        calls.clear()
        relighter = Relighter(scene, tolerance=0.1, cache=Cache(tmp_path, "geometry"))
        return RelitRoom(look, relighter, 1.0).shading(Environment.load("noon")).radiance, len(calls)

    (first, before), (second, after) = lit(), lit()
    assert (before, after) == (2, 1) and np.array_equal(first, second)
    kept = Cache(tmp_path, "geometry")
    (name,) = kept.settings_of("windows")
    kept.put("windows", *name, radiance=np.zeros(3, np.float32))
    third, again = lit()
    assert again == 2 and np.array_equal(first, third)


def test_methods_without_shadows_say_that_walls_hide_nothing():
    scene = room("one-window")[0]
    look = kept_on()[0].known.appearance._replace(place=Place.ROOM)
    look = look._replace(captured=scene.colors_linear, room=None)
    for method in ("analytic", "neural-gash"):
        with pytest.warns(DataWarning, match=f"`method` {method} knows no shadows"):
            RelitRoom(look, Relighter(scene, method=method), 1.0)
    RelitRoom(look, Relighter(scene, method="raytraced"), 1.0)  # a DataWarning fails the test


def test_a_black_cabinet_in_a_room_stays_black():
    scene, place, _, _ = room("one-window")
    colors = scene.colors_srgb.copy()
    black = place.part == place.part[np.argmax(place.albedo_linear @ [1.0, 0.0, -2.0])]  # all of one piece
    colors[black] = np.random.default_rng(0).integers(0, 4, (black.sum(), 3))
    dark = Scene([Mesh(scene.vertices, scene.normals, scene.faces, colors)], capture=scene.capture)
    _, _, radiance = relit(dark, env="noon")
    assert 20 < black.sum() < 0.5 * len(black)
    assert np.isfinite(radiance).all() and radiance[black].max() < 0.02


def seen(scene, place):
    """(V,) bool: what shows its front to where the capture stood, and is not clipped."""
    occluder = Occluder(scene.vertices, scene.normals, scene.faces)
    eyes = Frame.around(scene.vertices, scene.faces).unit(within(scene))
    return seen_from(occluder, np.arange(len(scene.vertices)), eyes) & (scene.colors_linear.max(axis=1) < 0.9)


def test_words_for_lamps_and_openings():
    assert LightingOptions(lamps="off").lamp_factor == 0.0 and LightingOptions(lamps="0.25").lamp_factor == 0.25
    for wrong in ({"lamps": "dim"}, {"lamps": -1.0}, {"lamps": float("nan")}):
        with pytest.raises(InputError, match="expected"):
            LightingOptions(**wrong)


def test_what_is_bright_in_one_channel_alone_is_no_lamp():
    scene, place, *_ = room()
    glowing, captured = place.emitted.any(axis=1), scene.colors_linear.copy()
    occluder = Occluder(scene.vertices, scene.normals, scene.faces)
    areas, nothing = samples.vertex_areas(occluder), np.zeros_like(captured)
    found = lamps.find(occluder, captured, areas, nothing[:, 0], nothing)
    assert any(np.isin(lamp.rows, np.flatnonzero(glowing)).all() for lamp in found)
    captured[glowing] = 0.95, 0.7, 0.4  # as a wall beside a lamp is seen
    found = lamps.find(occluder, captured, areas, nothing[:, 0], nothing)
    assert not any(np.isin(np.flatnonzero(glowing), lamp.rows).any() for lamp in found)


def test_a_model_is_trusted_where_it_gives_the_capture_back():
    scene, *_ = room()
    captured = np.full_like(scene.colors_linear, 0.5)
    modelled = captured.copy()
    np.testing.assert_array_equal(trust_in(modelled, captured, scene.faces), 1.0)
    modelled *= np.exp(DOUBT)  # a thousandth is added to both before they are compared
    np.testing.assert_allclose(trust_in(modelled, captured, scene.faces), 0.5, atol=2e-3)
