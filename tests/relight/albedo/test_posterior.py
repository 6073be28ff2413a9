"""The posterior of captured light: derivatives, recovery of lights drawn from the prior, suns, what is known, doubt."""

import numpy as np
import pytest
from captured_scenes import TOP_LEFT, given, lamp_light, objects, patchy, photographed

from relight.albedo import estimate, natural, posterior
from relight.albedo.captured import CapturedScene, CaptureEvidence
from relight.albedo.evidence import Evidence, LitPlaces, SeenSky
from relight.albedo.fitted import FITTED
from relight.albedo.said import Said
from relight.light.projections import texel_directions
from relight.sh import harmonics
from relight.transfer.transport import Transport
from splat2mesh.base.sphere import fibonacci_sphere

pytestmark = pytest.mark.usefixtures("fewer_samples")


@pytest.fixture(scope="module")
def evidence():
    scene = objects()
    captured = photographed(scene, patchy(scene[0]), lamp_light())
    transport = Transport(scene[1], scene[2])
    return CapturedScene(scene[0], captured, 0, lambda count: None, transport, CaptureEvidence()).evidence


@pytest.fixture(scope="module")
def with_sky(evidence):
    """The same with a sky of which a half was seen and a part of that clipped."""
    directions = evidence.places.directions
    seen = np.repeat((directions[:, :1] > 0) * 3e-4, 3, axis=1)
    found = type(evidence)(evidence.places, SeenSky(np.zeros((len(directions), 3)), seen, 0.5 * seen), evidence.fitted)
    return found


@pytest.mark.parametrize("cue", ["parallel pairs", "slanted pairs", "distant pairs", "hue", "sky", "clipped sky"])
def test_gradients_are_those_of_the_nats(with_sky, cue):
    """The median albedo is left out: its slope is that of the mean."""
    basis = harmonics.evaluate(with_sky.places.directions, natural.BANDS)
    rng = np.random.default_rng(1)
    at = natural.natural_light().mean + rng.normal(0, 0.2, (natural.BANDS**2, 3))
    gradient = with_sky.cues(basis @ at, basis)[cue].gradient
    along = rng.normal(size=at.shape)
    step = 1e-3 * along
    above, below = (with_sky.cues(basis @ (at + sign * step))[cue].nats for sign in (1, -1))
    expected = float(gradient @ along.T.ravel())
    # The best slope may change between the two; sums of float32 products hold five digits.
    assert (above - below) / 2e-3 == pytest.approx(expected, rel=0.05, abs=0.05 * np.linalg.norm(gradient))


def test_curvatures_are_symmetric_and_not_negative(with_sky):
    basis = harmonics.evaluate(with_sky.places.directions, natural.BANDS)
    for name, cue in with_sky.cues(basis @ natural.natural_light().mean, basis).items():
        matrix = np.asarray(cue.hessian)
        np.testing.assert_allclose(matrix, matrix.T, rtol=1e-4, atol=1e-4 * np.abs(matrix).max(), err_msg=name)
        assert np.linalg.eigvalsh(matrix).min() > -1e-3 * np.abs(matrix).max(), name


def test_distant_places_of_one_paint_tell_what_neighbours_cannot():
    """Two groups of places face up; one sees the eastern sky, one the western: within each, all are lit alike."""
    directions, count = fibonacci_sphere(300), 200
    east = directions[:, 0] > 0
    open_sky = np.maximum(directions[:, 1], 0.0) * 4.0 / len(directions)
    sky = np.repeat([open_sky * east, open_sky * ~east], count, axis=0).astype(np.float32)
    log_light = np.repeat(0.7 * east[:, None], 3, axis=1)
    normals, dark = np.tile([0.0, 1.0, 0.0], (2 * count, 1)), np.zeros((2 * count, 3))
    near = np.stack([np.arange(2 * count - 1), np.arange(1, 2 * count)], axis=1)
    near = np.delete(near, count - 1, axis=0)
    captured = 0.4 * (sky @ np.exp(log_light))
    places = LitPlaces(sky, directions, captured, dark, normals, near, np.ones(len(near)))
    found = [Evidence(places, None, FITTED).cues(light) for light in (log_light, 0.0 * log_light, -log_light)]
    assert len({each["parallel pairs"].nats for each in found}) == 1
    nats = [each["distant pairs"].nats for each in found]
    assert nats[0] < 1e-6 < 0.1 * min(nats[1:])


def test_the_prior_is_stationary_about_the_vertical():
    prior = natural.natural_light()
    _, order = harmonics.degrees_and_orders(natural.BANDS)
    assert not prior.mean[order != 0].any() and np.linalg.eigvalsh(prior.precision).min() > 0
    # cos and sin of one order have one precision, so turning the light by 90 degrees changes no probability
    blocks = prior.precision.reshape(3, 25, 3, 25)
    for number in range(1, natural.BANDS):
        plus, minus = np.flatnonzero(order == number), np.flatnonzero(order == -number)
        np.testing.assert_allclose(
            blocks[:, plus][:, :, :, plus], blocks[:, minus][:, :, :, minus], rtol=1e-6, atol=1e-9
        )
    directions = fibonacci_sphere(500)
    logs = natural.log_radiance(prior.mean, directions).mean(axis=1)
    assert logs[directions[:, 1] > 0].mean() > logs[directions[:, 1] < 0].mean()  # skies are brighter than the ground


def test_log_harmonics_give_back_a_light_of_five_bands():
    rng = np.random.default_rng(2)
    logs = rng.normal(0, 0.3, (natural.BANDS**2, 3))
    directions = texel_directions(64, 128)
    image = np.exp(natural.log_radiance(logs, directions.reshape(-1, 3))).reshape(64, 128, 3)
    np.testing.assert_allclose(natural.log_harmonics(image), logs @ natural.AXES.T, atol=5e-3)  # texels of 3 degrees


def test_shares_sum_to_one_and_the_mean_is_that_of_the_lights(evidence):
    lights = posterior.lights_of(evidence, natural.natural_light())
    assert sum(light.share for light in lights) == pytest.approx(1.0)
    assert [light.share for light in lights] == sorted((light.share for light in lights), reverse=True)
    directions = evidence.places.directions[:50]
    mean = sum(light.share * light.radiance(directions) for light in lights)
    np.testing.assert_allclose(posterior.mean_radiance(lights, directions), mean)
    assert 0.0 < posterior.spread(evidence, lights) < 0.3


def test_a_known_sun_stands_where_it_is_said_and_a_cloudy_sky_has_none():
    scene = objects()
    captured = photographed(scene, patchy(scene[0]), lamp_light())
    transport = Transport(scene[1], scene[2])

    def found(said):
        return estimate(scene[0], captured, transport=transport, evidence=CaptureEvidence(said=said)).lights

    assert all(light.sun is not None for light in found(Said(sun=TOP_LEFT)))
    np.testing.assert_allclose(found(Said(sun=TOP_LEFT))[0].sun.direction, TOP_LEFT)
    assert [light.sun for light in found(Said(sky="overcast"))] == [None]


def test_without_light_on_what_is_seen_nothing_breaks():
    scene = objects()
    dark = np.full((len(scene[3]), 3), 0.01, np.float32)
    found = estimate(scene[0], dark, **given(scene))
    assert np.isfinite(found.albedo).all() and np.isfinite(found.environment.radiance).all()
