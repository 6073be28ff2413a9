"""The network that refines a captured light: what it must not depend on, the level it keeps, and that it helps."""

import numpy as np
import pytest
from captured_scenes import lamp_light, objects, patchy, photographed

from relight.albedo import natural, posterior, refined
from relight.albedo.captured import CapturedScene, CaptureEvidence
from relight.albedo.evidence import Evidence, LitPlaces
from relight.albedo.fitted import FITTED
from relight.transfer.transport import Transport
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.color import luminance

pytestmark = pytest.mark.usefixtures("fewer_samples")


@pytest.fixture(scope="module")
def day():
    scene = objects()
    captured = photographed(scene, patchy(scene[0]), lamp_light())
    return CapturedScene(scene[0], captured, 0, lambda count: None, Transport(scene[1], scene[2]), CaptureEvidence())


@pytest.fixture(scope="module")
def lights(day):
    return posterior.lights_of(day.evidence, natural.natural_light())


def received(evidence, lights):
    radiance = posterior.mean_radiance(lights, evidence.places.directions)
    return luminance(evidence.places.sky @ radiance.astype(np.float32) + evidence.places.bounced)


def test_the_median_place_stays_as_bright_as_it_was(day, lights):
    before, after = (received(day.evidence, each) for each in (lights, refined.refined(day.evidence, lights)))
    assert np.median(np.log(after / before)) == pytest.approx(0.0, abs=0.02)  # of the mean light; lights have shares
    assert np.abs(np.log(after / before)).max() > 0.01


def test_colours_are_those_of_the_posterior(day, lights):
    directions = fibonacci_sphere(50)
    before, after = (
        posterior.mean_radiance(each, directions) for each in (lights, refined.refined(day.evidence, lights))
    )
    np.testing.assert_allclose(after / before, np.repeat((after / before)[:, :1], 3, axis=1), rtol=1e-6)


def test_neither_the_exposure_nor_the_order_of_places_matters(day, lights):
    evidence = day.evidence
    radiance = posterior.mean_radiance(lights, evidence.places.directions)
    rows = np.arange(300)
    change = refined._by_network(refined.inputs_of(evidence, radiance, rows))
    places = evidence.places
    brighter = places._replace(captured=8.0 * places.captured, bounced=8.0 * places.bounced)
    same = refined.inputs_of(Evidence(brighter, None, FITTED), 8.0 * radiance, rows[::-1])
    np.testing.assert_allclose(refined._by_network(same), change, atol=1e-3)  # float32 sums in another order


def test_a_turn_about_the_vertical_turns_the_change(day, lights):
    """Up to the cells of the sphere, which do not turn."""
    places = day.evidence.places
    radiance = posterior.mean_radiance(lights, places.directions)
    half = np.diag([-1.0, 1.0, -1.0])
    turned = LitPlaces(
        places.sky, places.directions @ half, places.captured, places.bounced, places.normals @ half.astype(np.float32),
        places.pairs, places.weights,
    )  # fmt: skip
    change = [
        refined.change_of(Evidence(each, None, FITTED), radiance, refined._by_network) for each in (places, turned)
    ]
    assert np.corrcoef(*change)[0, 1] > 0.9
    assert np.sqrt(np.mean((change[0] - change[1]) ** 2)) < 0.3 * np.std(change[0]) + 0.02


def test_it_brings_the_light_of_a_generated_scene_nearer(day, lights):
    places = day.evidence.places
    true = luminance(places.sky @ lamp_light().lookup(places.directions) + places.bounced)

    def off(lights):
        logs = np.log(received(day.evidence, lights) / true)
        return float(np.std(logs))

    assert off(refined.refined(day.evidence, lights)) < off(lights)
