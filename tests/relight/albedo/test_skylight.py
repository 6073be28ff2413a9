"""The capture's light with a captured sky: what was seen binds, what was clipped is a lower bound; the check of it."""

import numpy as np
import pytest
from captured_scenes import given, lamp_light, objects, patchy, photographed

from relight import Environment
from relight.albedo import estimate, skylight
from relight.albedo.fitted import FITTED
from relight.light.projections import row_solid_angles, texel_directions
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.measured import CapturedSky

DIRECTIONS = texel_directions(64, 128)


pytestmark = pytest.mark.usefixtures("fewer_samples")


def photographed_sky(environment, exposure=1.0, seen=None):
    """The CapturedSky that a clipping camera sees of a light, where `seen` (64, 128) bool."""
    radiance = exposure * environment.lookup(DIRECTIONS.reshape(-1, 3)).reshape(64, 128, 3)
    seen = np.ones((64, 128), bool) if seen is None else seen
    clipped = (radiance >= 0.95) & seen[..., None]
    bound = (seen[..., None] & ~clipped).astype(np.float32)
    return CapturedSky((bound * radiance).astype(np.float32), bound, clipped.astype(np.float32))


def angle_of(found, environment):
    y, z, x = environment.sh(2)[1:4].mean(axis=1)
    truth = np.array([x, y, z]) / np.linalg.norm([x, y, z])
    return np.degrees(np.arccos(np.clip(found.direction @ truth, -1.0, 1.0)))


def off(albedo, truth):
    gain = (albedo * truth).sum(axis=0) / (albedo * albedo).sum(axis=0)
    return np.linalg.norm(gain * albedo - truth) / np.linalg.norm(truth)


@pytest.fixture(scope="module")
def scene():
    found = objects()
    return found, patchy(found[0])


def test_a_sky_without_clipping_is_the_light(scene):
    geometry, albedo = scene
    light = lamp_light()
    dim = Environment(0.15 * light.radiance, "dim")
    captured = photographed(geometry, albedo, dim)
    found = estimate(geometry[0], captured, **given(geometry, sky=photographed_sky(dim)))
    off_log = np.log(found.environment.lookup(DIRECTIONS.reshape(-1, 3)) / dim.lookup(DIRECTIONS.reshape(-1, 3)))
    assert np.sqrt(np.mean(off_log**2)) < 0.3  # harmonics of five bands, and the noise that skies are taken to have
    assert off(found.albedo, albedo) < 0.12


def test_a_clipped_lamp_is_at_least_as_bright_as_the_clip_and_stands_where_it_was(scene):
    geometry, albedo = scene
    light = lamp_light()
    captured = photographed(geometry, 0.5 * albedo, light)
    sky = photographed_sky(light)
    found = estimate(geometry[0], captured, **given(geometry, sky=sky))
    inside = sky.clipped.mean(axis=2).ravel() == 1.0
    assert inside.any()
    assert (found.environment.lookup(DIRECTIONS.reshape(-1, 3))[inside].mean(axis=1) > 0.9).all()
    assert angle_of(found, light) < 15.0


def test_a_wholly_clipped_sky_says_what_is_usual(scene):
    geometry, albedo = scene
    light = lamp_light()
    captured = photographed(geometry, 0.5 * albedo, light)
    nothing = np.zeros((64, 128, 3), np.float32)
    above = np.broadcast_to(DIRECTIONS[..., 1:2] > 0, nothing.shape).astype(np.float32)
    found = estimate(geometry[0], captured, **given(geometry, sky=CapturedSky(nothing, nothing, above)))
    assert np.isfinite(found.environment.radiance).all()
    assert found.separable
    usual = np.median(found.albedo @ [0.2126, 0.7152, 0.0722])
    assert FITTED.albedo / 3.0 < usual < 2.0 * FITTED.albedo  # half the albedo of a usual scene, under a bright sky


def test_a_sun_within_a_clipped_sky_is_looked_for_there_alone(scene):
    geometry, albedo = scene
    toward = np.array([0.5, 0.8, 0.33])
    toward /= np.linalg.norm(toward)
    cosine = texel_directions(128, 256) @ toward
    image = np.where(cosine[..., None] > np.cos(np.radians(4.0)), 150.0, 0.3) * np.ones(3)
    sunny = Environment(image, "sunny")
    captured = photographed(geometry, 0.5 * albedo, sunny)
    halo = (DIRECTIONS @ toward > np.cos(np.radians(20.0)))[..., None]
    sky = photographed_sky(Environment(np.where(halo, 3.0, 0.3) * np.ones(3), "photographed"))
    found = estimate(geometry[0], captured, **given(geometry, sky=sky))
    bright = texel_directions(128, 256).reshape(-1, 3)[found.environment.radiance.mean(axis=2).argmax()]
    assert bright @ toward > np.cos(np.radians(22.0))
    assert angle_of(found, sunny) < 15.0


def test_what_was_not_seen_below_the_horizon_is_ground():
    blank = np.zeros((64, 128, 3), np.float32)
    parts = skylight.SkyParts.looked_up(CapturedSky(blank, blank, blank), np.array([[0.0, 1, 0], [0.0, -1, 0]]))
    np.testing.assert_allclose(parts.unseen, [[1.0] * 3, [skylight.GROUND] * 3])


def test_parts_of_directions_share_the_whole_sky():
    rng = np.random.default_rng(0)
    bound = rng.uniform(0, 1, (64, 128, 3)).astype(np.float32)
    sky = CapturedSky(rng.uniform(0, 1, (64, 128, 3)).astype(np.float32), bound, 1.0 - bound)
    parts = skylight.SkyParts.at(sky, fibonacci_sphere(256))
    areas = row_solid_angles(64, 128).reshape(-1, 1, 1)
    mean = ((bound * sky.radiance + sky.clipped) * areas).sum(axis=(0, 1)) / (areas.sum() * 128)
    np.testing.assert_allclose(parts.known.mean(axis=0), mean, rtol=0.02)  # cells are not quite of one size
