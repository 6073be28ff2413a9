"""A clipped sky, estimated from a place's own colours; only surfaces visible from inside count."""

from dataclasses import replace

import numpy as np
import pytest
from captured_scenes import BANDS, PLACE, clipped_picture, given, photographed, yard

from relight import Environment
from relight.albedo import contrast, estimate, samples, with_known_light
from relight.albedo.check import self_relight
from relight.albedo.patches import ColorPatches, patches_of
from relight.albedo.seen import LOOKS, looks_from, standing
from relight.albedo.skylight import LITTLE_VISIBLE, visible_part
from relight.light.projections import texel_directions
from relight.sh import harmonics
from relight.sh.sphere import fibonacci_sphere
from relight.transfer.analytic import analytic
from splat2mesh.scene.measured import CapturedSky
from splat2mesh.scene.scene import Scene

SKY = texel_directions(64, 128)


@pytest.fixture(scope="module", autouse=True)
def fewer():
    """Fewer places, patches and suns: everything works the same, in a fraction of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(samples, "SAMPLES", 400)
        patch.setattr(contrast, "CONTRAST", replace(contrast.CONTRAST, most_patches=1200))
        patch.setattr(contrast, "TRIED", 24)
        yield


@pytest.fixture(scope="module")
def place():
    scene, geometry = yard()
    rng = np.random.default_rng(0)
    albedo = np.exp(rng.normal(np.log(0.3), 0.1, (len(scene.vertices), 1))).astype(np.float32) * np.ones(3, np.float32)
    return scene, geometry, albedo, looks_from(scene, geometry[0])


def lobe(toward, strength, width_deg=12.0):
    toward = np.asarray(toward) / np.linalg.norm(toward)
    angle = np.degrees(np.arccos(np.clip(texel_directions(64, 128) @ toward, -1, 1)))
    return strength * np.exp(-0.5 * (angle / width_deg) ** 2)[..., None] * np.ones(3)


def under_a_sun(geometry, albedo):
    """Direction of a sun, what of SKY lies above the horizon, and the colours captured under both."""
    toward = np.array([0.55, 0.7, -0.45]) / np.linalg.norm([0.55, 0.7, -0.45])
    above = SKY[..., 1:2] > 0.0
    light = Environment(np.where(above, 0.4, 0.05) + lobe(toward, 40.0, 8.0), "sunny")
    return toward, above, photographed(geometry, albedo, light)


def test_looks_see_fronts_from_where_the_capture_stood(place):
    scene, _, _, looks = place
    count = len(scene.vertices)
    sizes = looks.sizes(count)
    assert sizes.sum() == pytest.approx(len(looks.corners), rel=1e-5)
    assert len(looks.corners) < LOOKS * len(PLACE["eyes"])
    below = scene.vertices[:, 1] < -0.01
    assert below.any() and sizes[below].sum() == 0.0
    np.testing.assert_allclose(looks.at(np.ones((count, 2), np.float32)), 1.0, rtol=1e-5)
    assert sizes[~below].sum() > 0.25 * LOOKS * len(PLACE["eyes"])


def test_an_object_is_not_looked_at_from_within(place):
    scene, geometry, _, _ = place
    outside = Scene(scene.chunks, capture={"from": "outside", "eyes": PLACE["eyes"]})
    assert looks_from(outside, geometry[0]) is None and not len(standing(outside))


@pytest.mark.parametrize("toward", [(0.6, 0.8, 0.2), (-0.5, 0.7, 0.5)])
def test_contrast_shows_on_which_side_a_clipped_sky_is_bright(place, toward):
    _, geometry, albedo, looks = place
    above = SKY[..., 1:2] > 0.0
    light = Environment(np.where(above, 1.0, 0.05) + lobe(toward, 12.0, 25.0) * above, "one side")
    captured = photographed(geometry, albedo, light)
    captured *= np.float32(0.9 / np.quantile(captured, 0.99))
    clipped = np.broadcast_to(above, (64, 128, 3)).astype(np.float32)
    nothing = np.zeros_like(clipped)
    sky = CapturedSky(nothing, nothing, clipped)
    found = estimate(geometry[0], captured, **given(geometry, sky=sky, looks=looks))
    flat = np.array([found.direction[0], found.direction[2]])
    wanted = np.array([toward[0], toward[2]])
    assert flat @ wanted / np.linalg.norm(flat) / np.linalg.norm(wanted) > np.cos(np.radians(25.0))
    assert found.under_sky


def test_a_sun_that_no_camera_saw_is_found_by_its_shadows(place):
    _, geometry, albedo, looks = place
    toward, above, captured = under_a_sun(geometry, albedo)
    seen = above & (np.arccos(np.clip(SKY @ toward, -1, 1)) > np.radians(35.0))[..., None]
    bound = np.broadcast_to(seen, (64, 128, 3)).astype(np.float32)
    sky = CapturedSky(0.4 * bound, bound, np.zeros_like(bound))
    found = estimate(geometry[0], captured, **given(geometry, sky=sky, looks=looks))
    texels = texel_directions(*found.environment.radiance.shape[:2]).reshape(-1, 3)
    brightest = texels[found.environment.radiance.mean(axis=2).argmax()]
    assert brightest @ toward > np.cos(np.radians(20.0))
    check = self_relight(geometry[0], captured, found, geometry[2], looks.sizes(len(captured)))
    assert check["mesh_self_relight_db"] > 25.0 and check["self_relight_db"] > 34.0


def test_a_sun_over_what_was_photographed_from_outside_is_found_where_little_sky_was_seen(place):
    _, geometry, albedo, _ = place
    toward, above, captured = under_a_sun(geometry, albedo)
    bound = np.broadcast_to(above & (SKY[..., 2:] < -0.9), (64, 128, 3)).astype(np.float32)
    sky = CapturedSky(0.4 * bound, bound, np.zeros_like(bound))
    assert 0.0 < visible_part(sky) < LITTLE_VISIBLE
    found = estimate(geometry[0], captured, **given(geometry, sky=sky))
    assert found.direction @ toward > np.cos(np.radians(12.0)) and found.under_sky
    level = Environment(np.where(above, 0.4, 0.05) * np.ones(3), "level")
    captured = photographed(geometry, albedo, level)
    soft = estimate(geometry[0], captured, **given(geometry, sky=sky))
    alone = estimate(geometry[0], captured, **given(geometry))
    assert soft.under_sky and not alone.under_sky  # no sun is found: the mean of the estimates from sky and scene

    def off(found):
        return np.log(found.irradiance * albedo / captured).std()

    assert off(soft) < 0.7 * off(alone)


@pytest.mark.parametrize("beyond", [False, True])
def test_light_comes_from_where_nothing_was_seen_if_that_explains_more(beyond):
    directions = fibonacci_sphere(1024)
    low, high = directions[:, 1] < 0.3, (directions[:, 1] > 0.1) & (directions[:, 2] > 0.5)
    clipped = (low & (directions[:, 1] > 0.0) & (directions[:, 0] > 0.8)).astype(float)
    bound = np.where(directions[:, 1] > 0.0, 0.3, 0.05)
    light = bound + np.where(beyond, 3.0 * high, 20.0 * clipped)
    transfer = analytic(fibonacci_sphere(1200).astype(np.float32), 8).astype(np.float64)
    project = harmonics.evaluate(directions, 8) * (4.0 * np.pi / len(directions))
    noise = np.random.default_rng(0).normal(0.0, 0.1, len(transfer))
    log_captured = np.log(0.23 * np.maximum(transfer @ (project.T @ light), 1e-3)) + noise
    ones, none = np.ones(len(transfer)), np.zeros(len(transfer))
    patches = ColorPatches(log_captured, transfer, none, none.astype(int), ones)
    (share, found), *_ = contrast.brightness_of(patches, directions, bound, clipped, high.astype(float))
    assert share > 0.9 and found.beyond == beyond and found.sun is None
    region = clipped + (high if beyond else 0.0)
    estimated = bound + region * found.excess * np.exp(directions @ found.lean)
    assert 0.7 < estimated.mean() / light.mean() < 1.4


@pytest.mark.parametrize(("sun", "least", "most"), [(0.0, 0.0, 0.0), (3.5, 0.1, 0.9), (8.0, 1.0, 1.0)])
def test_lights_share_by_how_likely_they_are(sun, least, most):
    """A clipped sky with a sun in it, which takes all of the light where it is strong and a share where it is faint."""
    directions, toward = fibonacci_sphere(1024), np.array([0.5, 0.7, 0.5]) / np.sqrt(0.99)
    above, low = (directions[:, 1] > 0.0).astype(float), np.where(directions[:, 1] > 0.0, 1.0, 0.1)
    normals = fibonacci_sphere(1200)
    transfer = analytic(normals.astype(np.float32), 8).astype(np.float64)
    project = harmonics.evaluate(directions, 8) * (4.0 * np.pi / len(directions))
    received = transfer @ (project.T @ low) + sun * np.maximum(normals @ toward, 0.0) / np.pi
    ones, none = np.ones(len(transfer)), np.zeros(len(transfer))
    off = np.random.default_rng(1).normal(0.0, 0.4, len(transfer))
    patches = ColorPatches(np.log(0.23 * received) + off, transfer, none, none.astype(int), ones)
    found = contrast.brightness_of(patches, directions, low, above, none[: len(directions)])
    shares = [share for share, _ in found]
    assert sum(shares) == pytest.approx(1.0) and shares == sorted(shares, reverse=True)
    by_sun = sum(share for share, light in found if light.sun is not None)
    assert all(light.sun @ toward > np.cos(np.radians(15.0)) for _, light in found if light.sun is not None)
    assert least <= by_sun <= most
    spread = contrast.ambiguity(patches, directions, low, (above, none[: len(directions)]), found)
    assert spread > 0.02 if len(found) > 1 else spread == 0.0
    doubted = contrast.brightness_of(patches, directions, low, above, none[: len(directions)], lambda sun: -300.0)
    assert all(light.sun is None for _, light in doubted)


def test_too_few_patches_show_nothing(place):
    _, geometry, albedo, looks = place
    captured = np.full(albedo.shape, 0.5, np.float32)
    usable = np.zeros(len(captured), bool)
    arrays = geometry[0], captured, usable, geometry[1], np.zeros_like(captured)
    assert patches_of(looks, *arrays) is None


def test_thinned_patches_keep_their_materials_apart():
    many = ColorPatches(np.zeros(50), np.zeros((50, 4)), np.ones(50), np.arange(50) // 5, np.ones(50))
    few = many.thinned(10)
    assert len(few.weight) == 10 and (few.material == np.arange(10)).all()


def test_a_known_light_takes_its_exposure_from_the_captured_sky(place):
    _, geometry, albedo, looks = place
    light = Environment(np.where(SKY[..., 1:2] > 0.0, 0.6, 0.1) + lobe((0.3, 0.9, 0.2), 8.0), "known")
    shown = Environment(0.5 * light.radiance, "as shown")
    captured = photographed(geometry, albedo, shown)
    found = with_known_light(geometry[0], captured, light, **given(geometry, sky=clipped_picture(shown), looks=looks))
    np.testing.assert_allclose(found.environment.radiance, shown.radiance, rtol=0.02)
    seen = looks.sizes(len(captured)) > 0.0
    away = np.abs(found.albedo - albedo)[seen]
    assert np.median(away) < 0.03
    assert BANDS**2 == geometry[1].shape[1]


def test_under_a_clipped_sky_trees_do_not_set_the_exposure_of_a_known_light(place):
    _, geometry, albedo, looks = place
    above = SKY[..., 1:2] > 0.0
    light = Environment(np.where(above, 2.0, 0.2) * np.ones(3), "overcast")
    captured = photographed(geometry, albedo, light)
    trees = (above & (SKY[..., 1:2] < 0.2)).astype(np.float32) * np.ones(3, np.float32)
    sky = CapturedSky(0.1 * trees, trees, (above - trees).astype(np.float32))
    found = with_known_light(geometry[0], captured, light, **given(geometry, sky=sky, looks=looks))
    assert 0.5 < found.brightness / light.mean_luminance < 1.2  # by the trees alone it is .05
