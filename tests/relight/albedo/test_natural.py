"""The colour of captured light from that of its scene: exact laws, real lights, and a scene of leaves."""

import numpy as np
import pytest
from captured_scenes import given, lamp_light, objects, patchy, photographed

from relight import Environment
from relight.albedo import estimate, fit, natural
from relight.lamps.color import blackbody
from splat2mesh.scene.color import luminance

WARM = np.array([1.0, 0.0, -1.0]) / np.sqrt(2.0)


def hue(color):
    """(3,) log colour, its mean 0."""
    log_color = np.log(np.asarray(color, float))
    return log_color - log_color.mean()


def test_a_light_takes_half_of_a_warm_colour_and_a_tenth_of_a_green_one():
    rng = np.random.default_rng(0)
    for color in rng.uniform(0.01, 1.0, (50, 3)):
        light = natural.light_of(color)
        assert luminance(light) == pytest.approx(luminance(color), rel=1e-12)
        assert hue(light) @ WARM == pytest.approx(0.5 * (hue(color) @ WARM), abs=1e-12)
        assert hue(light) @ natural.GREEN == pytest.approx(0.1 * (hue(color) @ natural.GREEN), abs=1e-12)


def test_grey_stays_grey_and_the_unit_of_colours_does_not_count():
    np.testing.assert_allclose(natural.light_of(np.full(3, 0.3)), 0.3, rtol=1e-12)
    color = np.array([0.1, 0.3, 0.05])
    np.testing.assert_allclose(natural.light_of(7.0 * color), 7.0 * natural.light_of(color), rtol=1e-12)


def test_the_prior_bounds_hues_and_leaves_brightness_alone():
    np.testing.assert_allclose(natural.PRECISION @ np.ones(3), 0.0, atol=1e-9)  # of eigenvalues of some 100
    np.testing.assert_allclose(natural.PRECISION @ WARM, WARM / 0.25**2, atol=1e-9)
    np.testing.assert_allclose(natural.PRECISION @ natural.GREEN, natural.GREEN / 0.05**2, atol=1e-9)


def test_the_prior_of_a_light_without_hues_is_the_one_with_all_hues_alike():
    alike = (np.eye(3) - 1.0 / 3.0) / fit.COLOR**2
    np.testing.assert_allclose(fit.prior_of(3, alike), fit.prior_of(3), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kelvin", [3000, 4000, 5500, 6500, 10000, 25000])
def test_black_bodies_are_neither_green_nor_magenta(kelvin):
    assert -0.16 < hue(blackbody(kelvin)) @ natural.GREEN < 0.18


@pytest.mark.parametrize("name", ["noon", "sunset", "overcast", "studio"])
def test_built_in_lights_are_neither_green_nor_magenta(name):
    assert abs(hue(Environment.load(name).sh(1)[0]) @ natural.GREEN) < 0.12


@pytest.mark.usefixtures("fewer_samples")
def test_leaves_under_a_white_lamp_are_green_and_their_light_is_not():
    occluder = objects()[0]
    leaves = patchy(occluder) * np.float32([0.5, 0.9, 0.3])
    leaves = np.sqrt(leaves * leaves.mean(axis=0))  # colours of one kind
    captured = photographed(objects(), leaves, lamp_light(color=(1.0, 1.0, 1.0)))
    found = estimate(occluder, captured, **given(objects()))
    assert found.separable
    green = hue(captured.mean(axis=0)) @ natural.GREEN
    assert green > 0.5
    assert abs(hue(found.color) @ natural.GREEN) < 0.2 * green  # it was .5
    seen = objects()[3] > 0.15
    assert hue(found.albedo[seen].mean(axis=0)) @ natural.GREEN > 0.7 * green
