"""Spherical harmonics against scipy, and the identities that any correct basis and rotation obeys."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from relight.sh import harmonics, latlong
from splat2mesh.base.errors import InputError

# Degree 9 in float64: values up to 1.2 after tens of roundings, summed over 100 coefficients: about 1e-14.
TIGHT = 1e-12


def _directions(count, seed=0):
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _rotations(count, seed=1):
    return Rotation.random(count, rng=np.random.default_rng(seed)).as_matrix()


def _oracle(directions, bands):
    """scipy's complex harmonics made real: for m < 0 sqrt(2) Im, for m > 0 sqrt(2) Re, without (-1)^m."""
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    columns = []
    for degree in range(bands):
        for m in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(m), polar, azimuth) * (-1.0) ** abs(m)
            columns.append(value.real if m == 0 else np.sqrt(2) * (value.real if m > 0 else value.imag))
    return np.stack(columns, axis=1)


def test_basis_equals_scipy():
    directions = np.vstack([_directions(500), np.eye(3), -np.eye(3)])
    np.testing.assert_allclose(harmonics.evaluate(directions, 10), _oracle(directions, 10), atol=1e-13)


def test_first_bands_are_constant_y_z_x_all_positive():
    x, y, z = _directions(1)[0]
    first = np.sqrt(3 / (4 * np.pi))
    expected = [np.sqrt(1 / (4 * np.pi)), first * y, first * z, first * x]
    np.testing.assert_allclose(harmonics.evaluate(np.array([[x, y, z]]), 2)[0], expected, atol=1e-15)


def test_basis_is_orthonormal():
    directions, weights = harmonics.quadrature(10)
    values = harmonics.evaluate(directions, 10)
    np.testing.assert_allclose(values.T @ (values * weights[:, None]), np.eye(100), atol=TIGHT)


def test_addition_theorem():
    """Over one degree, sum_m Y_lm(a) Y_lm(b) = (2 l + 1) / (4 pi) P_l(a . b)."""
    a, b = _directions(50, 2), _directions(50, 3)
    products = harmonics.evaluate(a, 10) * harmonics.evaluate(b, 10)
    for degree in range(10):
        legendre = np.polynomial.legendre.Legendre.basis(degree)(np.sum(a * b, axis=1))
        total = products[:, degree**2 : (degree + 1) ** 2].sum(axis=1)
        np.testing.assert_allclose(total, (2 * degree + 1) / (4 * np.pi) * legendre, atol=TIGHT)


def test_single_precision_stays_single_and_close():
    directions = _directions(20_000)  # more than one block
    single = harmonics.evaluate(directions.astype(np.float32), 5)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, harmonics.evaluate(directions, 5), atol=5e-6)  # ~40 eps at degree 4


def test_few_bands_are_the_first_of_many():
    directions = _directions(30)
    np.testing.assert_array_equal(harmonics.evaluate(directions, 4), harmonics.evaluate(directions, 10)[:, :16])


@pytest.mark.parametrize("shape", [(256, 512), (1, 1), (5, 3)])
def test_constant_sky_has_one_coefficient(shape):
    radiance = np.array([0.25, 2.0, 3.0])
    expected = np.zeros((100, 3))
    expected[0] = radiance * np.sqrt(4 * np.pi)
    image = np.broadcast_to(radiance, (*shape, 3))
    np.testing.assert_allclose(latlong.project_latlong(image, 10), expected, atol=TIGHT)


def test_projection_does_not_depend_on_resolution():
    image = np.random.default_rng(4).exponential(size=(6, 10, 3))
    fine = image.repeat(13, axis=0).repeat(7, axis=1)
    np.testing.assert_allclose(latlong.project_latlong(fine, 10), latlong.project_latlong(image, 10), atol=TIGHT)


def test_projection_recovers_a_band_limited_environment():
    """Averaging over patches of width w loses l (l + 1) w^2 / 24 of degree l: 1.4e-4 here at l = 9."""
    expected = np.random.default_rng(5).normal(size=(100, 3))
    height, width = 512, 1024
    latitude = np.pi * (0.5 - (np.arange(height)[:, None] + 0.5) / height)
    longitude = np.pi * (1 - 2 * (np.arange(width) + 0.5) / width)
    axes = np.broadcast_arrays(
        np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)
    )
    image = harmonics.evaluate(np.stack(axes, axis=-1).reshape(-1, 3), 10) @ expected
    found = latlong.project_latlong(image.reshape(height, width, 3), 10)
    np.testing.assert_allclose(found, expected, atol=1e-3)


@pytest.mark.parametrize("steps", [1, 5, 8, -3])
def test_turning_the_light_rolls_its_image_to_the_left(steps):
    image = np.random.default_rng(6).exponential(size=(8, 16, 3))
    turn = Rotation.from_rotvec([0, 2 * np.pi * steps / 16, 0]).as_matrix()
    turned = harmonics.rotation_matrix(turn, 10) @ latlong.project_latlong(image, 10)
    np.testing.assert_allclose(turned, latlong.project_latlong(np.roll(image, -steps, axis=1), 10), atol=TIGHT)


def test_rotations_compose():
    a, b = _rotations(2)
    product = harmonics.rotation_matrix(a, 10) @ harmonics.rotation_matrix(b, 10)
    np.testing.assert_allclose(product, harmonics.rotation_matrix(a @ b, 10), atol=TIGHT)


def test_rotating_the_basis_is_rotating_its_argument():
    directions = _directions(100)
    for rotation in _rotations(5):
        rotated = harmonics.evaluate(directions, 10) @ harmonics.rotation_matrix(rotation, 10).T
        np.testing.assert_allclose(harmonics.evaluate(directions @ rotation.T, 10), rotated, atol=TIGHT)


def test_rotated_light_comes_from_the_rotated_direction():
    coefficients = np.random.default_rng(7).normal(size=(36, 3))
    directions, (rotation,) = _directions(40), _rotations(1)
    before = harmonics.evaluate(directions, 6) @ coefficients
    after = harmonics.evaluate(directions @ rotation.T, 6) @ (harmonics.rotation_matrix(rotation, 6) @ coefficients)
    np.testing.assert_allclose(after, before, atol=TIGHT)


def test_lambert_lobe_is_the_legendre_series_of_the_clamped_cosine():
    node, weight = np.polynomial.legendre.leggauss(20)
    cosine, weight = 0.5 * (node + 1), 0.5 * weight  # the integrand is a polynomial on 0..1
    for degree, found in enumerate(harmonics.lambert_coefficients(10)):
        legendre = np.polynomial.legendre.Legendre.basis(degree)(cosine)
        np.testing.assert_allclose(found, 2 * np.pi * np.sum(weight * cosine * legendre), atol=1e-14)


def test_irradiance_of_a_constant_sky_is_pi_times_its_radiance():
    coefficients = np.zeros((25, 3))
    coefficients[0] = 2.0 * np.sqrt(4 * np.pi)
    irradiance = harmonics.evaluate(_directions(10), 5) @ harmonics.convolve(coefficients)
    np.testing.assert_allclose(irradiance, 2.0 * np.pi, atol=TIGHT)


def test_3dgs_coefficients_describe_the_same_colors_in_the_3dgs_basis():
    """The 3DGS basis has the signs that scipy's Condon-Shortley phase gives: (-1)^m on ours."""
    coefficients = np.random.default_rng(9).normal(size=(11, 16, 3)).astype(np.float32)
    directions = _directions(20)
    order = np.array([m for degree in range(4) for m in range(-degree, degree + 1)])
    theirs = np.einsum("nk,vkc->vnc", _oracle(directions, 4) * (-1.0) ** np.abs(order), coefficients)
    ours = np.einsum("nk,vkc->vnc", harmonics.evaluate(directions, 4), harmonics.from_3dgs(coefficients))
    np.testing.assert_allclose(ours, theirs, atol=TIGHT)
    assert harmonics.from_3dgs(coefficients).dtype == np.float32
    np.testing.assert_array_equal(harmonics.from_3dgs(harmonics.from_3dgs(coefficients)), coefficients)


@pytest.mark.parametrize("bands", [0, 11, -1, 2.5])
def test_impossible_band_counts_are_refused(bands):
    with pytest.raises(InputError, match=f"from 1 to 10, found {bands}"):
        harmonics.evaluate(_directions(1), bands)


@pytest.mark.parametrize("shape", [(), (0,), (8,), (3, 10, 3), (121, 3)])
def test_coefficient_counts_that_are_no_square_are_refused(shape):
    with pytest.raises(InputError, match="K = 1, 4, 9"):
        harmonics.convolve(np.zeros(shape))


@pytest.mark.parametrize("matrix", [np.eye(4), 2 * np.eye(3), np.full((3, 3), np.nan)])
def test_matrices_that_are_no_rotation_are_refused(matrix):
    with pytest.raises(InputError, match="rotation matrix"):
        harmonics.rotation_matrix(matrix, 3)


def test_directions_of_another_shape_are_refused():
    with pytest.raises(InputError, match=r"\(N, 3\), found \(4, 2\)"):
        harmonics.evaluate(np.zeros((4, 2)), 3)
