"""A new light without a known way in: closed boxes, whose light is then assumed to follow it."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from lit_rooms import room

from relight import Environment, LightingOptions
from relight.engine.assumed_light import LEAST, OUTSIDE, assumed_change, assumed_exposure
from relight.insert.asked import AskedInsert
from relight.jobs.job import Job
from relight.jobs.object_surroundings import light_under
from relight.jobs.writer import report_of
from relight.request import RelightRequest
from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene


def even(*radiance):
    return Environment(np.broadcast_to(np.float32(radiance), (8, 16, 3)).copy(), "even")


def shaded(scene, env, **wishes):
    job = Job(RelightRequest(scene, env, LightingOptions(**wishes), albedo="estimated", caching="none"))
    with pytest.warns(DataWarning, match="closed room"):
        found = next(iter(job.shaded()))
    return job, found, found.shading.radiance * found.exposure


def unknown_room():
    """The closed box in grey: its light cannot be estimated."""
    scene = room()[0]
    grey = np.full_like(scene.colors_srgb, 120)
    return Scene([Mesh(scene.vertices, scene.normals, scene.faces, grey)], capture=scene.capture)


def test_an_even_white_light_is_that_of_the_capture_and_other_lights_are_factors_on_it():
    np.testing.assert_allclose(assumed_change(even(1, 1, 1)), 1.0, rtol=1e-5)
    np.testing.assert_allclose(assumed_change(even(0.5, 0.4, 0.2)), [0.5, 0.4, 0.2], rtol=1e-5)
    np.testing.assert_allclose(assumed_change(even(0.5, 0.4, 0.2), 0.1), [0.05, 0.04, 0.02], rtol=1e-5)
    # Brighter than white it is exposed for, darker than four stops it is shown as those.
    np.testing.assert_allclose(assumed_change(even(9, 9, 9)), 1.0, rtol=1e-5)
    np.testing.assert_allclose(assumed_change(even(1e-6, 1e-6, 1e-6)), LEAST, rtol=1e-5)
    np.testing.assert_allclose(assumed_change(even(0, 0, 0)), LEAST, rtol=1e-5)


def test_a_sunset_is_warmer_than_noon_from_any_side():
    sunset, noon = (assumed_change(Environment.load(name)) for name in ("sunset", "noon"))
    assert sunset[0] / sunset[2] > 1.2 * noon[0] / noon[2]
    turned = assumed_change(Environment.load("sunset").rotated(70.0))
    np.testing.assert_allclose(turned, sunset, rtol=1e-5)


def test_a_room_of_unknown_light_takes_after_the_new_one_and_says_so():
    scene = unknown_room()
    job, found, radiance = shaded(scene, "sunset")
    change = assumed_change(Environment.load("sunset"))
    np.testing.assert_allclose(radiance, change * scene.colors_linear, rtol=1e-5)
    # Splats change by what is received, which changes alike.
    look = job.known.appearance
    np.testing.assert_allclose(found.shading.received * found.exposure, change * look.irradiance, rtol=1e-5)
    assert report_of(job, found)["assumed"] == {"outside": 1.0, "change": pytest.approx(change, abs=1e-4)}
    job, found, radiance = shaded(scene, "captured")
    np.testing.assert_allclose(radiance, scene.colors_linear, rtol=1e-6)
    assert report_of(job, found)["assumed"] is None


def test_what_is_said_of_the_captured_light_holds_beside_any_environment():
    scene = unknown_room()
    _, _, fifth = shaded(scene, "sunset", captured=0.2)
    np.testing.assert_allclose(fifth, 0.2 * scene.colors_linear, rtol=1e-5)
    _, _, dim = shaded(scene, "sunset", env_scale=0.5)
    change = assumed_change(Environment.load("sunset"), 0.5)
    np.testing.assert_allclose(dim, change * scene.colors_linear, rtol=1e-5)


def test_without_a_window_lamps_stay_on_and_the_other_half_takes_after_the_new_light():
    scene = room()[0]
    job, _, radiance = shaded(scene, "sunset")
    captured, change = scene.colors_linear, assumed_change(Environment.load("sunset"))
    glowing = job.known.appearance.room.glow.any(axis=1)
    wanted = (1.0 - OUTSIDE + OUTSIDE * change) * captured
    np.testing.assert_allclose(radiance[~glowing], wanted[~glowing], rtol=1e-5)
    np.testing.assert_array_equal(radiance[glowing], captured[glowing])


@pytest.mark.slow
def test_with_its_lamps_off_a_room_without_a_window_has_what_is_assumed_to_come_from_outside():
    scene = room()[0]
    job, found, radiance = shaded(scene, "sunset", lamps="off")
    change = OUTSIDE * assumed_change(Environment.load("sunset"))
    glowing = job.known.appearance.room.glow.any(axis=1)
    np.testing.assert_allclose(radiance[~glowing], change * scene.colors_linear[~glowing], rtol=1e-5)
    # The lamp itself is a surface like others.
    assert 0.0 < radiance[glowing].mean() < scene.colors_linear[glowing].mean()
    assert report_of(job, found)["assumed"] == {"outside": OUTSIDE, "change": pytest.approx(change / OUTSIDE, abs=1e-4)}
    _, _, half = shaded(scene, "sunset", lamps=0.5)
    wanted = (0.5 * (1.0 - OUTSIDE) + change) * scene.colors_linear
    np.testing.assert_allclose(half[~glowing], wanted[~glowing], rtol=0.1, atol=0.01)  # lamps by the model's change
    _, _, dim = shaded(scene, "sunset", lamps="off", env_scale=0.1)
    np.testing.assert_allclose(dim[~glowing], 0.1 * radiance[~glowing], rtol=1e-4)
    # What is said of the captured light is all of it: then they are its only light.
    _, _, dark = shaded(scene, "sunset", lamps="off", captured=1.0)
    assert dark.mean() < 0.05 * scene.colors_linear.mean()


def test_the_exposure_of_a_light_gives_its_change():
    for name in ("sunset", "noon", "overcast"):
        light = Environment.load(name)
        mean = light.sh(1)[0] / np.sqrt(4.0 * np.pi)
        np.testing.assert_allclose(assumed_exposure(light, 0.3) * mean, assumed_change(light, 0.3), rtol=1e-5)
    assert assumed_exposure(even(0, 0, 0)) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("grey", [True, False], ids=["unknown light", "a lamp"])
def test_an_object_takes_the_light_of_the_room_that_is_assumed(grey):
    scene = unknown_room() if grey else room()[0]
    ball = trimesh.creation.icosphere(2, radius=0.15)
    white = np.full(ball.vertices.shape, 255, np.uint8)
    mesh = Mesh(np.float32(ball.vertices), np.float32(ball.vertex_normals), np.int32(ball.faces), white)
    low, high = scene.bounds
    middle = tuple(map(float, (low + high) / 2))
    asked = AskedInsert(mesh, middle, albedo=(0.5,) * 3)
    found = {}
    for name, lamps in (("captured", "keep"), ("sunset", "off")):
        request = RelightRequest(scene, name, LightingOptions(lamps=lamps), albedo="estimated", inserted=(asked,))
        job = Job(replace(request, caching="none", formats=("npy",)))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            shaded = next(iter(job.shaded()))
            skies = light_under(shaded, job.mix).skies
        found[name] = shaded.inserted.radiance * shaded.exposure, skies
    change = (1.0 if grey else OUTSIDE) * assumed_change(Environment.load("sunset"))
    then, now = (radiance for radiance, _ in found.values())
    if grey:  # light comes from surfaces, which have it, and from afar through what is open
        np.testing.assert_allclose(now, change * then, rtol=1e-3)
        (before,), (after,) = (skies for _, skies in found.values())
        np.testing.assert_allclose(after.environment.radiance, change * before.environment.radiance, rtol=1e-5)
    else:  # the lamp, which is off, lit it directly
        assert 0.0 < now.mean() < change.mean() * then.mean()
