"""The clear sky: against Mitsuba's `sunsky`, against closed forms, and through sunset, twilight and night."""

import struct
from pathlib import Path

import numpy as np
import pytest

from relight.light import sky_model
from relight.light.sky_model import ClearSky
from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import fibonacci_sphere, row_solid_angles, texel_directions
from splat2mesh.scene.color import luminance

mi = pytest.importorskip("mitsuba", reason="the oracle of these tests")

# Mitsuba divides by the integral of the CIE 1931 luminosity, so that a spectrum of 1 has luminance 1.
Y_INTEGRAL = 106.7502593994140625
FROM_MITSUBA = Y_INTEGRAL * sky_model.LUMINOUS_EFFICACY
RGB_FROM_XYZ = np.array(
    [[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]]
)  # IEC 61966-2-1


def sun_at(elevation_deg, azimuth_deg=70.0):
    elevation, azimuth = np.radians([elevation_deg, azimuth_deg])
    level = np.cos(elevation)
    return np.array([np.sin(azimuth) * level, np.sin(elevation), -np.cos(azimuth) * level])


def sunsky(variant, elevation_deg, turbidity, albedo, sun_scale=0.0, sky_scale=1.0):
    """Mitsuba's radiance as a function of one direction (3,), +y up, and of a wavelength if the variant is spectral."""
    mi.set_variant(variant)
    x, y, z = sun_at(elevation_deg).tolist()
    emitter = mi.load_dict(
        {
            "type": "sunsky",
            "sun_direction": [x, z, y],  # its frame is +z up
            "turbidity": turbidity,
            "albedo": albedo,
            "sun_scale": sun_scale,
            "sky_scale": sky_scale,
            "complex_sun": variant == "scalar_spectral",  # the disc by its parts, not from a coarse table
        }
    )

    def radiance(direction, wavelength=None):
        si = mi.SurfaceInteraction3f()
        x, y, z = (-direction).tolist()
        si.wi = mi.Vector3f(x, z, y)
        if wavelength is not None:
            si.wavelengths = wavelength
        return np.array(emitter.eval(si)).ravel()

    return radiance


@pytest.mark.parametrize("elevation_deg", [1.0, 8.0, 35.0, 80.0])
@pytest.mark.parametrize(("turbidity", "albedo"), [(1.0, 0.0), (2.6, 0.3), (6.0, 1.0), (10.0, 0.5)])
def test_the_sky_is_mitsubas(elevation_deg, turbidity, albedo):
    oracle = sunsky("scalar_rgb", elevation_deg, turbidity, albedo)
    directions = fibonacci_sphere(400)
    directions = directions[directions[:, 1] > 0.0]
    expected = np.array([oracle(direction) for direction in directions]) * FROM_MITSUBA
    found = ClearSky(sun_at(elevation_deg), turbidity, albedo).radiance(directions)
    expected = np.maximum(expected, 0.0)  # where the fit falls below, Mitsuba leaves it
    error = np.abs(found - expected) / np.maximum(expected, 1e-3 * expected.mean())
    # The same tables and equations; float32 in Mitsuba, whose angle to the sun loses most.
    assert np.median(error) < 1e-5
    assert error.max() < 1e-3


@pytest.mark.parametrize("elevation_deg", [1.0, 10.0, 45.0])
@pytest.mark.parametrize("turbidity", [2.0, 3.5, 8.0])
def test_sun_and_sky_stand_in_the_ratio_of_mitsubas_spectra(elevation_deg, turbidity):
    """Spectral Mitsuba holds sun and sky in the same watts; here both go through the CIE curves as one."""
    wavelengths = np.arange(320.0, 720.0, 5.0)  # at 720 Mitsuba reads past its table
    curves = np.array([np.array(mi.cie1931_xyz(float(each))).ravel()[:3] for each in wavelengths]) @ RGB_FROM_XYZ.T
    step, toward = 5.0 * sky_model.LUMINOUS_EFFICACY, sun_at(elevation_deg)
    model = ClearSky(toward, turbidity, 0.3)

    def color(radiance, direction):
        return np.array([radiance(direction, float(each))[0] for each in wavelengths]) @ curves * step

    disc = sunsky("scalar_spectral", elevation_deg, turbidity, 0.3, 1.0, 0.0)
    sun = np.mean([color(disc, part) for part in model.disc()[0][::17]], axis=0)  # every ring, all around
    cap = 2.0 * np.pi * (1.0 - np.cos(np.radians(sky_model.SUN_RADIUS_DEG)))
    found = model.sun_irradiance / cap
    # Parts are a sample, and wavelengths 5 nm apart. Colours of low suns beyond red are cut off at 0, on both sides.
    assert luminance(found) == pytest.approx(luminance(np.maximum(sun, 0.0)), rel=0.02)
    np.testing.assert_allclose(found, np.maximum(sun, 0.0), rtol=0.02, atol=0.01 * luminance(sun))
    sky = sunsky("scalar_spectral", elevation_deg, turbidity, 0.3)
    directions = fibonacci_sphere(40)
    directions = directions[directions[:, 1] > 0.0]
    expected = np.array([color(sky, direction) for direction in directions])
    # The authors fitted RGB on its own, not through the fits of 11 wavelengths: some percent apart.
    ratio = model.radiance(directions) / expected
    assert np.median(luminance(model.radiance(directions)) / luminance(expected)) == pytest.approx(1.0, abs=0.02)
    assert np.median(np.abs(ratio - 1.0)) < 0.05


def tensors(path):
    """Arrays of a file in Mitsuba's tensor format."""
    data = path.read_bytes()
    assert data[:12] == b"tensor_file\0"
    count, at, found = struct.unpack_from("<I", data, 14)[0], 18, {}
    for _ in range(count):
        length = struct.unpack_from("<H", data, at)[0]
        name = data[at + 2 : at + 2 + length].decode()
        at += 2 + length
        axes, _, start = struct.unpack_from("<HBQ", data, at)
        shape = struct.unpack_from(f"<{axes}Q", data, at + 11)
        at += 11 + 8 * axes
        found[name] = np.frombuffer(data, "<f8", int(np.prod(shape)), start).reshape(shape)
    return found


def test_the_tables_are_those_of_mitsubas_files():
    source = Path(mi.__file__).parent / "data" / "sunsky" / "sunsky_datasets.bin"
    if not source.exists():
        pytest.skip("this Mitsuba has its tables elsewhere")
    published, ours = tensors(source), sky_model._data()
    np.testing.assert_allclose(ours["sky_shape"], published["sky_params_rgb"], rtol=1e-6)
    np.testing.assert_allclose(ours["sky_radiance"], published["sky_rad_rgb"], rtol=1e-6)
    mi.set_variant("scalar_spectral")
    wavelengths = np.arange(320.0, 721.0)
    curves = np.array([np.array(mi.cie1931_xyz(float(each))).ravel()[:3] for each in wavelengths]) @ RGB_FROM_XYZ.T
    between = np.maximum(0.0, 1.0 - np.abs(wavelengths[:, None] - np.arange(320.0, 721.0, 40.0)) / 40.0)
    # The mean over a disc of the n-th power of the cosine of the limb's darkening is 2 / (n + 2).
    darkened = published["sun_ld_spec"] @ (2.0 / (np.arange(6) + 2.0))
    sun = np.einsum("tswk,w,wc->tsck", published["sun_rad_spec"], darkened, between.T @ curves)
    np.testing.assert_allclose(ours["sun_radiance"], sun, rtol=1e-5, atol=1e-5 * np.abs(sun).max())


def test_a_clear_noon_has_the_light_of_a_clear_noon():
    """Level ground has about 100,000 lux, of which the sky has a fifth; the sun has 1e9 to 2e9 cd/m^2."""
    model = ClearSky(sun_at(65.0))
    assert 9e4 < luminance(model.level_irradiance) < 1.1e5
    assert 0.1 < luminance(model.sky_irradiance) / luminance(model.level_irradiance) < 0.3
    assert 1e9 < luminance(model.sun_irradiance) / 6.8e-5 < 2e9
    red, _, blue = model.sky_irradiance
    assert blue > 2.0 * red


@pytest.mark.parametrize("elevation_deg", [75.0, 20.0, 3.0, 0.1, -4.0])
def test_irradiances_are_those_of_a_fine_grid(elevation_deg):
    model = ClearSky(sun_at(elevation_deg), 3.0, 0.25)
    directions, areas = texel_directions(1000, 2000), row_solid_angles(1000, 2000)
    image = model.radiance(directions)
    level = np.sum(image[:500] * (areas[:500] * directions[:500, :, 1])[..., None], axis=(0, 1))
    np.testing.assert_allclose(model.sky_irradiance, level, rtol=2e-3)  # the grid's own error beside the sun
    toward, weights = model.disc()
    total = level + toward[:, 1] @ weights
    np.testing.assert_allclose(model.level_irradiance, total, rtol=2e-3)
    np.testing.assert_allclose(image[500:], np.broadcast_to(0.25 * total / np.pi, image[500:].shape), rtol=2e-3)
    mean = (np.sum(luminance(image) * areas) + luminance(weights).sum()) / (4.0 * np.pi)
    assert model.mean_luminance == pytest.approx(mean, rel=2e-3)


def test_the_disc_is_a_disc_of_its_size_around_its_direction():
    model = ClearSky(sun_at(40.0))
    toward, weights = model.disc()
    away = np.degrees(np.arccos(np.clip(toward @ model.sun, -1.0, 1.0)))
    assert away.max() < sky_model.SUN_RADIUS_DEG
    assert np.mean(away < sky_model.SUN_RADIUS_DEG / np.sqrt(2.0)) == pytest.approx(0.5)  # equal areas
    center = luminance(weights) @ toward
    assert center / np.linalg.norm(center) == pytest.approx(model.sun, abs=1e-5)


def test_the_disc_sets_bit_by_bit():
    parts = [len(ClearSky(sun_at(elevation)).disc()[0]) for elevation in (0.3, 0.13, 0.0, -0.13, -0.3)]
    assert parts[0] == 512 and parts[2] == 256 and parts[4] == 0
    assert parts[1] + parts[3] == 512  # as much is up as is down on the other side
    assert ClearSky(sun_at(-0.3)).sun_irradiance.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(("turbidity", "rise"), [(1.0, 0.0), (3.0, 0.0), (5.0, 0.0), (9.0, 0.05)])
def test_the_light_falls_all_the_way_into_the_night(turbidity, rise):
    elevations = np.concatenate([np.arange(10.0, -17.9, -0.1), [-18.0, -30.0, -90.0]])
    lux = [float(luminance(ClearSky(sun_at(each), turbidity).level_irradiance)) for each in elevations]
    steps = np.diff(np.log(lux))
    low = elevations[1:] < -0.5
    assert np.all(steps[~low] <= rise)  # in haze above 5 the fit itself rises over the last half degree
    assert np.all(steps[low] < 0.005)  # the almanac's pieces meet within half a percent
    # No jump: the fit is steepest at the horizon, as it runs in the cube root of the elevation, most of all in haze.
    assert np.all(steps[:-2] > -0.25)
    assert lux[-1] == lux[-2] == lux[-3] > 0.0


@pytest.mark.parametrize(("elevation_deg", "lux"), [(-6.0, 3.4), (-9.0, 0.12), (-12.0, 0.008), (-18.0, 0.00065)])
def test_twilight_has_the_illuminance_of_the_almanac(elevation_deg, lux):
    """Published for the ends of civil, nautical and astronomical twilight, without a moon."""
    found = luminance(ClearSky(sun_at(elevation_deg), 5.0).level_irradiance)
    assert found == pytest.approx(lux, rel=0.05)  # two digits


def test_dusk_turns_blue_and_loses_its_glow():
    horizon = texel_directions(2, 64)[0] * [1.0, 0.0, 1.0]
    horizon /= np.linalg.norm(horizon, axis=-1, keepdims=True)
    glow, blueness = [], []
    for elevation in (0.0, -3.0, -5.5, -8.0):
        model = ClearSky(sun_at(elevation))
        around = luminance(model.radiance(horizon))
        glow.append(around.max() / around.min())
        blueness.append(model.sky_irradiance[2] / model.sky_irradiance[0])
    assert glow == sorted(glow, reverse=True) and glow[-1] == pytest.approx(1.0)
    assert blueness == sorted(blueness) and blueness[-1] > 2.0


@pytest.mark.parametrize("elevation_deg", [90.0, 89.9, 0.0, -1e-9, -89.9, -90.0])
@pytest.mark.parametrize("turbidity", [1.0, 10.0])
@pytest.mark.parametrize("albedo", [0.0, 1.0])
def test_no_direction_of_any_sky_is_nan_or_negative(elevation_deg, turbidity, albedo):
    model = ClearSky(sun_at(elevation_deg), turbidity, albedo)
    corners = np.vstack([np.eye(3), -np.eye(3), fibonacci_sphere(500), [sun_at(elevation_deg)]])
    found = model.radiance(corners)
    assert np.isfinite(found).all() and found.min() >= 0.0
    up = corners[:, 1] >= 0.0
    # In dense haze the fit falls below 0 in a spot of the horizon, two directions in 10,000 of the sky: 0 there.
    assert np.mean(luminance(found[up]) > 0.0) >= (0.99 if turbidity == 10.0 else 1.0)
    assert np.isfinite(model.disc()[1]).all() and model.disc()[1].min(initial=0.0) >= 0.0
    assert (model.ground_radiance == 0.0).all() if albedo == 0.0 else (model.ground_radiance > 0.0).all()


def test_turning_the_sun_turns_the_sky():
    turn = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])
    directions = fibonacci_sphere(200)
    sun = sun_at(23.0)
    np.testing.assert_allclose(
        ClearSky(turn @ sun).radiance(directions @ turn.T), ClearSky(sun).radiance(directions), rtol=1e-7
    )


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (([0.0, 1.0, 0.0], 0.9, 0.3), "`turbidity`"),
        (([0.0, 1.0, 0.0], 10.1, 0.3), "`turbidity`"),
        (([0.0, 1.0, 0.0], float("nan"), 0.3), "`turbidity`"),
        (([0.0, 1.0, 0.0], 3.0, -0.1), "`ground_albedo`"),
        (([0.0, 1.0, 0.0], 3.0, 1.1), "`ground_albedo`"),
        (([0.0, 0.0, 0.0], 3.0, 0.3), "direction of the sun"),
        (([0.0, float("nan"), 0.0], 3.0, 0.3), "direction of the sun"),
    ],
)
def test_what_is_no_sky_is_refused(values, says):
    with pytest.raises(InputError, match=says):
        ClearSky(*values)
