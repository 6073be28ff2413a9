"""Deringing: never below zero, never more than needed, nothing where nothing rings."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import eval_legendre

from relight import Environment, sh
from relight.deringing import dering, window
from splat2mesh.errors import InputError


def directions(count, seed=0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def exit_radiance(coefficients, toward):
    return sh.evaluate(toward, sh.bands_of(coefficients)) @ sh.convolve(coefficients) / np.pi


def texel_sun(bands, row=20, color=(1.0, 1.0, 1.0)):
    image = np.zeros((64, 128, 3), np.float32)
    image[row, 33] = np.float32(1e5) * np.array(color, np.float32)
    return Environment(image).sh(bands)


def zonal(bands):
    """Exit radiance over its mean as polynomials: row l are the coefficients' parts for a sun at cosine x."""
    return lambda x: np.stack(
        [
            (2 * degree + 1) * (lobe / np.pi) * eval_legendre(degree, x)
            for degree, lobe in enumerate(sh.lambert_coefficients(bands))
        ]
    )


@pytest.mark.parametrize("bands", range(1, 11))
def test_a_texel_over_black_gives_no_negative_light(bands):
    coefficients = texel_sun(bands)
    mean = exit_radiance(coefficients[:1], directions(1))[0, 0]
    toward = directions(200_000)  # 0.5 degrees apart
    if bands > 1:
        assert exit_radiance(coefficients, toward).min() < -0.05 * mean  # it did ring
    windowed = dering(coefficients)
    assert exit_radiance(windowed, toward).min() >= 0.0
    np.testing.assert_array_equal(windowed[0], coefficients[0])


@pytest.mark.parametrize("bands", [2, 3, 4, 5, 6])
def test_the_change_is_the_least_there_is(bands):
    """Against SciPy's general minimiser of the same problem about the sun's axis."""
    parts = zonal(bands)
    x = np.linspace(-1, 1, 4001)
    values = parts(x)
    # Squared change of exit radiance over the sphere: the norm of a Legendre polynomial is 2 / (2 l + 1).
    power = np.array([values[degree, -1] ** 2 / (2 * degree + 1) for degree in range(bands)])
    result = minimize(
        lambda factors: (power[1:] * (1 - factors) ** 2).sum(),
        np.full(bands - 1, 0.5),
        jac=lambda factors: -2 * power[1:] * (1 - factors),
        constraints={
            "type": "ineq",
            "fun": lambda factors: values[0] + factors @ values[1:],
            "jac": lambda factors: values[1:].T,
        },
        bounds=[(0, 1)] * (bands - 1),
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert result.success
    sun = sh.evaluate(np.array([[0.36, 0.48, 0.8]]), bands).T * np.ones((1, 3))
    held = power[1:] > 0  # odd degrees from 3 on show on no white surface, and stay
    np.testing.assert_allclose(window(sun)[1:][held], result.x[held], atol=1e-3)  # of SLSQP's 4,001 points
    assert (window(sun)[1:][~held] == 1.0).all()


def test_less_change_than_a_window_of_one_parameter():
    """sinc(l / w)^4, the widest that does not go below zero: Sloan's choice of w."""
    bands, x = 6, np.linspace(-1, 1, 2001)
    values = zonal(bands)(x)
    degree = np.arange(bands)
    widths = np.geomspace(1, 100, 2000)
    fixed = [np.sinc(degree / width) ** 4 * (degree < width) for width in widths]
    fixed = max((factors for factors in fixed if (factors @ values).min() > -1e-9), key=np.sum)
    ours = window(texel_sun(bands))
    size = [values[index, -1] ** 2 / (2 * index + 1) for index in degree]
    assert (size * (1 - ours) ** 2).sum() < 0.5 * (size * (1 - fixed) ** 2).sum()


@pytest.mark.parametrize("name", ["overcast", "studio"])
def test_smooth_light_comes_back_itself(name):
    for bands in (3, 5, 10):
        coefficients = Environment.load(name).sh(bands)
        assert dering(coefficients) is coefficients
        assert (window(coefficients) == 1.0).all()


def test_one_window_for_all_colours_keeps_the_hue():
    coefficients = texel_sun(5, color=(1.0, 0.4, 0.1))
    windowed = dering(coefficients)
    np.testing.assert_allclose(windowed[:, 1], windowed[:, 0] * 0.4, rtol=1e-6)  # float32 image
    np.testing.assert_allclose(window(coefficients), window(texel_sun(5)), atol=1e-5)


def test_the_darkest_colour_decides_and_colours_without_energy_do_not():
    coefficients = texel_sun(4)
    coefficients[:, 1] = sh.evaluate(directions(1), 4)[0] * 0.0
    coefficients[0, 2] *= 50.0  # a bright sky in blue
    windowed = dering(coefficients)
    toward = directions(50_000)
    assert exit_radiance(windowed, toward).min() >= 0.0
    np.testing.assert_allclose(window(coefficients), window(texel_sun(4)), atol=1e-5)


def test_the_window_does_not_turn_with_the_light():
    light = texel_sun(5) + 0.3 * texel_sun(5, row=50, color=(0.2, 0.5, 1.0))
    light += Environment.load("overcast").sh(5) * 0.2
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    once, turned = window(light), window(sh.rotate(light, turn))
    assert once.min() < 1.0
    np.testing.assert_allclose(once, turned, atol=1e-4)  # flat valleys: the check may find other points of them


@pytest.mark.parametrize("bad", [np.ones(9), np.full((9, 3), np.nan), np.ones((8, 3))])
def test_what_are_no_coefficients_is_refused(bad):
    with pytest.raises(InputError, match="SH coefficients"):
        dering(bad)
