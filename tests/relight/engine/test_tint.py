"""The colour of the captured light as a person gives it: what follows from it, and what is refused."""

import dataclasses

import numpy as np
import pytest

from relight import Environment, Relighter
from relight.engine.appearance import appearance_of, bounced_light
from relight.engine.tint import color_where_white, retinted
from relight.jobs.job import Job
from relight.request import RelightRequest
from scenes import build
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import bytes_from_unit, luminance, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

BLUE = np.array([0.35, 0.9, 2.4])


@pytest.fixture(scope="module")
def table():
    """A generated table, captured under a blue sky: its Relighter, true albedo and the colour of that sky."""
    truth = build("tabletop", 3, 2_000)
    mesh = Mesh(truth.vertices, truth.normals, truth.faces, np.zeros(truth.vertices.shape, np.uint8))
    sky = Environment.load("overcast")
    blue = Environment((sky.radiance * BLUE).astype(np.float32), "blue")
    radiance = Relighter(Scene([mesh]), rays=64).shade(blue, truth.albedo_linear)
    shown = radiance * (0.9 / np.quantile(radiance, 0.99))
    mesh.colors_srgb[:] = bytes_from_unit(srgb_from_linear(np.clip(shown, 0.0, 1.0)))
    mean = blue.sh(1)[0]
    return Relighter(Scene([mesh])), truth.albedo_linear, mean / luminance(mean)


@pytest.fixture(scope="module")
def look(table):
    return appearance_of("estimated", None, table[0])


def tint_error(found, true):
    """Largest error of the median ratio in a colour, one gain for all."""
    ratio = np.median(found / np.maximum(true, 1e-3), axis=0)
    return np.abs(ratio / ratio.mean() - 1.0).max()


def test_the_true_colour_takes_the_cast_out_of_the_albedo(table, look):
    relighter, albedo, color = table
    tinted = retinted(look, color, bounced_light(relighter))
    # .056 as estimated, .0006 with the true colour were measured.
    assert tint_error(look.albedo, albedo) > 0.03
    assert tint_error(tinted.albedo, albedo) < 0.02  # the light differs in more than its mean colour
    np.testing.assert_allclose(tinted.capture["color"], color, rtol=1e-4)
    # What was captured is what its light sends out, but for where the albedo is held back; luminance stays.
    shown = np.median(tinted.albedo * tinted.irradiance / np.maximum(look.captured, 1e-3), axis=0)
    np.testing.assert_allclose(shown, 1.0, atol=0.05)
    np.testing.assert_allclose(tinted.capture["brightness"], look.capture["brightness"], rtol=1e-4)


def test_the_estimated_colour_changes_nothing(table, look):
    same = retinted(look, np.array(look.capture["color"]), bounced_light(table[0]))
    # A factor of 1 within the last bits of float32.
    np.testing.assert_allclose(same.irradiance, look.irradiance, rtol=1e-5)
    np.testing.assert_allclose(same.albedo, look.albedo, rtol=1e-4)


def test_what_was_white_becomes_grey(table, look):
    relighter, albedo, _ = table
    scene, bounced = relighter.scene, bounced_light(relighter)
    spread = np.ptp(albedo, axis=1) / albedo.max(axis=1)
    lit = luminance(look.irradiance) > 0.5 * np.median(luminance(look.irradiance))

    def around(vertex):
        return np.linalg.norm(scene.vertices - scene.vertices[vertex], axis=1) < 0.01 * scene.diagonal

    # The greyest vertex in the light that has neighbours, all of one colour.
    greyest = np.argsort(np.where(lit, spread, np.inf), kind="stable")
    near = next(int(v) for v in greyest if around(v).sum() > 2 and not np.ptp(albedo[around(v)], axis=0).any())
    found = color_where_white(look, bounced, scene.vertices, scene.diagonal, scene.vertices[near])
    tinted = retinted(look, found, bounced)
    grey = np.median(tinted.albedo[around(near)], axis=0)
    np.testing.assert_allclose(grey / grey.mean(), 1.0, atol=0.02)  # medians of colours are not of one vertex
    with pytest.raises(InputError, match="no surface"):
        color_where_white(look, bounced, scene.vertices, scene.diagonal, scene.vertices[near] + scene.diagonal)


def test_a_request_holds_the_place_as_three_numbers():
    assert RelightRequest("a", white_at="1,-2,.5").white_at == (1.0, -2.0, 0.5)
    with pytest.raises(InputError, match="`white_at` 1,2"):
        RelightRequest("a", white_at="1,2")


def test_a_job_shows_its_light_in_that_colour_and_refuses_it_where_nothing_is_estimated(table, look):
    relighter = table[0]
    place = relighter.scene.vertices[look.captured.min(axis=1).argmax()]
    asked = {"formats": ("npy",), "caching": "none", "albedo": "estimated", "white_at": place}
    request = RelightRequest(relighter.scene, "noon", **asked)
    assert not np.allclose(Job(request).known.appearance.capture["color"], look.capture["color"], rtol=1e-3)
    with pytest.raises(InputError, match="`white_at`"):
        Job(dataclasses.replace(request, albedo="white")).known.appearance  # noqa: B018
