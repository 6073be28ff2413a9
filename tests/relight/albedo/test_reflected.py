"""relight.albedo.reflected: the light that gloss shows guides the estimate where the shading confirms it."""

import numpy as np
import pytest
from captured_scenes import given, lamp_light, objects, patchy, photographed

from relight.albedo import estimate
from relight.albedo.reflected import log_shape
from relight.light.projections import texel_directions
from relight.sh import harmonics
from splat2mesh.scene.color import luminance

pytestmark = pytest.mark.usefixtures("fewer_samples")


def shape_of(light, bands=5):
    """What reflections show of a light: its luminance without the mean, at another scale."""
    coefficients = 0.03 * luminance(light.sh(bands))
    coefficients[0] = 0.0
    return coefficients


def toward(coefficients):
    y, z, x = coefficients[1:4]
    return np.array([x, y, z]) / np.linalg.norm([x, y, z])


@pytest.mark.parametrize("contrast", [0.5, 1.0, 2.0])
def test_a_shape_becomes_a_positive_light(contrast):
    rng = np.random.default_rng(0)
    shape = np.append(0.0, rng.normal(size=24))
    log = log_shape(shape, contrast, 5)
    directions = texel_directions(64, 128).reshape(-1, 3)
    weights = np.repeat(np.sin((np.arange(64) + 0.5) / 64 * np.pi), 128)
    light = np.exp(harmonics.evaluate(directions, 5) @ log)
    if contrast < 1.0:  # beyond, five bands of the logarithm hold too little of the dark half
        assert np.average(light, weights=weights) == pytest.approx(1.0, abs=0.1)
    about = harmonics.evaluate(directions, 5) @ shape
    assert np.corrcoef(light, about)[0, 1] > 0.6  # its brightest parts grow, the dark end at 0
    np.testing.assert_allclose(log_shape(7.0 * shape, contrast, 5), log)  # its scale does not count


def test_no_contrast_is_no_light_of_its_own():
    np.testing.assert_allclose(log_shape(np.append(0.0, np.ones(24)), 0.0, 5), 0.0, atol=1e-12)


def test_the_right_light_is_taken_and_a_wrong_one_changes_no_bit():
    occluder = objects()[0]
    captured = photographed(objects(), patchy(occluder), lamp_light())
    plain = estimate(occluder, captured, **given(objects()))
    shape = shape_of(lamp_light())
    guided = estimate(occluder, captured, **given(objects(), reflected=shape))
    true = toward(luminance(lamp_light().sh(2)))
    found = [np.degrees(np.arccos(np.clip(each.direction @ true, -1, 1))) for each in (plain, guided)]
    assert found[1] < 10.0 and found[1] <= found[0] + 1.0
    assert not np.array_equal(guided.irradiance, plain.irradiance)
    # From the other side: the shading does not agree, and the estimate is what it was.
    degree, _ = harmonics.degrees_and_orders(5)
    other = estimate(occluder, captured, **given(objects(), reflected=shape * (-1.0) ** degree))
    np.testing.assert_array_equal(other.irradiance, plain.irradiance)
