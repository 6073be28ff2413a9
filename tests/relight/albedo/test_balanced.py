"""The colour of a sky that clipped to white, estimated from stone and soil under it."""

import numpy as np
import pytest
from captured_scenes import clipped_picture, given, photographed, yard

from relight import Environment
from relight.albedo import estimate
from relight.albedo.seen import looks_from
from relight.albedo.tint import GREENEST, USUAL_HUE
from relight.light.projections import texel_directions
from splat2mesh.scene.color import luminance

SKY = texel_directions(64, 128)
BLUE = np.array([0.75, 1.0, 1.2])

pytestmark = pytest.mark.usefixtures("fewer_samples")


@pytest.fixture(scope="module")
def place():
    scene, geometry = yard()
    return geometry, looks_from(scene, geometry[0])


def captured_in(geometry, hue, level):
    """Colours of a yard of one hue, mottled, under a blue sky as bright as `level`, and that sky."""
    rng = np.random.default_rng(0)
    albedo = (np.exp(rng.normal(np.log(0.25), 0.1, (len(geometry[0].origins), 1))) * hue).astype(np.float32)
    light = Environment(level * np.where(SKY[..., 1:2] > 0.0, BLUE, 0.05 * BLUE), "blue")
    return photographed(geometry, albedo, light), light


def hue(found):
    color = np.median(found.irradiance, axis=0)
    return color / color[1]


def test_stone_shows_the_colour_of_a_clipped_sky(place):
    geometry, looks = place
    captured, light = captured_in(geometry, USUAL_HUE, 2.0)
    found = estimate(geometry[0], captured, **given(geometry, sky=clipped_picture(light), looks=looks))
    # TRUST leaves a fifth of the way from white to blue: .94 and 1.04; bounces add a little.
    np.testing.assert_allclose(hue(found), BLUE, rtol=0.1)
    assert hue(found)[0] < 0.85 and hue(found)[2] > 1.1


def test_leaves_show_nothing(place):
    geometry, looks = place
    green = np.array([0.5, 1.0, 0.4])
    assert 1.0 / np.sqrt(0.5 * 0.4) > GREENEST
    captured, light = captured_in(geometry, green, 2.0)
    found = estimate(geometry[0], captured, **given(geometry, sky=clipped_picture(light), looks=looks))
    volume = np.ones(len(captured), np.float32)
    same = estimate(geometry[0], captured, **given(geometry, sky=clipped_picture(light), looks=looks, volume=volume))
    for each in (found, same):
        np.testing.assert_allclose(hue(each), 1.0, atol=0.06)  # a clipped sky is white but for green bounces


def test_a_house_of_brick_makes_the_light_no_redder(place):
    geometry, looks = place
    brick = (np.arange(len(geometry[0].origins)) % 3 == 0)[:, None]
    paints = np.where(brick, [2.1, 1.0, 0.5], USUAL_HUE)
    captured, light = captured_in(geometry, paints, 2.0)
    found = estimate(geometry[0], captured, **given(geometry, sky=clipped_picture(light), looks=looks))
    np.testing.assert_allclose(hue(found), BLUE, rtol=0.12)  # .93 and 1.02 where brick counts


def test_a_sky_that_was_seen_keeps_its_colour(place):
    geometry, looks = place
    captured, light = captured_in(geometry, np.ones(3), 0.5)  # of grey ground, which would suggest a bluer one
    found = estimate(geometry[0], captured, **given(geometry, sky=clipped_picture(light), looks=looks))
    shown = found.environment.lookup(SKY[:30].reshape(-1, 3)).mean(axis=0)
    np.testing.assert_allclose(shown, 0.5 * BLUE, rtol=0.05)


@pytest.mark.slow
def test_the_luminance_of_the_light_stays(place, monkeypatch):
    geometry, looks = place
    captured, light = captured_in(geometry, USUAL_HUE, 2.0)
    asked = given(geometry, sky=clipped_picture(light), looks=looks)
    found = estimate(geometry[0], captured, **asked)
    monkeypatch.setattr("relight.albedo.tint.TRUST", 0.0)
    before = estimate(geometry[0], captured, **asked)
    medians = [float(luminance(np.median(each.irradiance, axis=0))) for each in (found, before)]
    assert medians[0] == pytest.approx(medians[1], rel=0.02)  # of the mean, not of the median, to the last bit
