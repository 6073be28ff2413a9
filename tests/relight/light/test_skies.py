"""The built-in environments: their mean, their shape, and where their light comes from."""

import numpy as np
import pytest

from relight import Environment
from relight.light import projections, skies
from relight.sh import latlong
from splat2mesh.scene.color import luminance

AREAS = projections.row_solid_angles(skies.HEIGHT, skies.WIDTH)
DIRECTIONS = projections.texel_directions(skies.HEIGHT, skies.WIDTH)


def _irradiance(image, normal):
    """Luminous irradiance of a surface by summing texels: independent of spherical harmonics."""
    return np.sum(luminance(image) * AREAS * np.maximum(DIRECTIONS @ normal, 0.0))


@pytest.mark.parametrize("name", skies.BUILTIN)
def test_every_sky_is_positive_with_mean_luminance_one_and_always_the_same(name):
    image = skies.image_of(name)
    assert image.shape == (256, 512, 3) and image.dtype == np.float32
    assert np.isfinite(image).all() and image.min() > 0.0
    mean = np.sum(luminance(image) * AREAS) / (4 * np.pi)
    assert mean == pytest.approx(1.0, rel=1e-6)  # float32 rounding of the texels
    np.testing.assert_array_equal(image, skies.image_of(name))
    assert Environment.load(name).mean_luminance == pytest.approx(1.0, rel=1e-6)


def test_texel_areas_cover_the_sphere():
    assert AREAS.sum() * skies.WIDTH == pytest.approx(4 * np.pi, rel=1e-14)


def test_overcast_zenith_is_three_times_its_horizon_and_the_ground_a_fifth_of_its_irradiance():
    image = luminance(skies.image_of("overcast"))
    # Half a texel, 0.35 degrees, from the exact directions: sin(0.35 degrees) = 0.006 in 1 + 2 sin.
    assert image[0].mean() / image[127].mean() == pytest.approx(3.0, rel=0.02)
    sky_irradiance = np.sum((image * AREAS * DIRECTIONS[..., 1])[:128])
    np.testing.assert_allclose(image[128:], 0.2 * sky_irradiance / np.pi, rtol=1e-5)
    np.testing.assert_allclose(image, np.broadcast_to(image[:, :1], image.shape), rtol=1e-6)


@pytest.mark.parametrize(("name", "elevation_deg", "share"), [("noon", 60.0, 5.0), ("sunset", 6.0, 0.25)])
def test_sun_stands_where_it_should_with_the_energy_it_should(name, elevation_deg, share):
    image = skies.image_of(name)
    above = luminance(image)[:128]
    sun = above > 100.0  # the disc outshines haze and sky by a factor of over a thousand
    assert 1 <= sun.sum() <= 9  # half a degree across: 0.7 degrees a texel, so that it straddles a few
    power = np.where(sun, above, 0.0) * AREAS[:128]
    center = np.einsum("hw,hwc->c", power, DIRECTIONS[:128])
    center /= np.linalg.norm(center)
    assert np.degrees(np.arcsin(center[1])) == pytest.approx(elevation_deg, abs=0.1)
    level = DIRECTIONS[:128, :, 1]
    ratio = np.sum(power * level) / np.sum(np.where(sun, 0.0, above) * AREAS[:128] * level)
    # Counted at texel centres, up to 0.35 degrees off, and with a little sky: some percent of sin(6 degrees).
    assert ratio == pytest.approx(share, rel=0.05)


def test_disc_covers_its_solid_angle():
    center = np.array([0.48, 0.6, 0.64])
    radius = np.radians(skies.SUN_RADIUS_DEG)
    covered = np.sum(skies._disc(DIRECTIONS, center) * AREAS)
    # 16 x 16 samples a texel, on the order of a hundred across the rim: 1%.
    assert covered == pytest.approx(2 * np.pi * (1 - np.cos(radius)), rel=0.01)


def test_studio_lights_from_the_upper_front_left_and_leaves_no_side_black():
    image = skies.image_of("studio")
    key = _irradiance(image, np.array([-0.6, 0.48, 0.64]))
    sides = {axis: _irradiance(image, np.array(axis, float)) for axis in ((1, 0, 0), (0, -1, 0), (0, 0, -1))}
    assert all(0.1 * key < side < 0.7 * key for side in sides.values())
    assert _irradiance(image, np.array([-1.0, 0, 0])) > sides[1, 0, 0]
    coefficients = latlong.project_latlong(image, 2)
    toward = luminance(coefficients)[[3, 1, 2]]  # the linear band points to the light: x, y, z
    assert toward[0] < 0 < toward[1] and toward[2] > 0
