"""relight.gloss.ggx: the lobe as factors on harmonics, against its own samples and against quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import eval_legendre

from relight.gloss.ggx import fresnel_rise, lobe_direction, zonal_factors

ALPHAS = 0.05, 0.15, 0.3, 0.6, 1.0


def looking_down(alpha, samples):
    """Directions and weights of one lobe, seen along its normal."""
    normal = np.array([[0.0, 0.0, 1.0]])
    one = np.full(1, alpha)
    found = [lobe_direction(one, normal, normal, sample, samples, np.zeros(1)) for sample in range(samples)]
    return np.concatenate([each[0] for each in found]), np.concatenate([each[1] for each in found])


@pytest.mark.parametrize("alpha", ALPHAS)
def test_factors_are_those_of_the_distribution_of_half_vectors(alpha):
    def density(angle, degree):
        toward = np.cos(2 * angle)
        distribution = alpha**2 / (np.cos(angle) ** 2 * (alpha**2 - 1) + 1) ** 2
        return distribution * np.cos(angle) * np.sin(angle) * toward * eval_legendre(degree, toward)

    points = [alpha / 2, alpha] if alpha < 0.7 else None
    whole = quad(density, 0, np.pi / 4, args=(0,), points=points)[0]
    expected = [quad(density, 0, np.pi / 4, args=(degree,), points=points)[0] / whole for degree in range(8)]
    # 4,000 steps of the midpoint rule
    np.testing.assert_allclose(zonal_factors(alpha, 8), expected, atol=2e-6)


def test_a_sharp_lobe_keeps_the_light_and_a_rough_one_blurs_it():
    assert zonal_factors(0.005, 6).min() > 0.99
    each = np.array([zonal_factors(alpha, 6) for alpha in ALPHAS])
    np.testing.assert_allclose(each[:, 0], 1.0, atol=1e-12)
    assert (np.diff(each[:-1, 1:], axis=0) < 0.0).all()  # rougher blurs more
    assert (np.diff(each[:-1], axis=1) < 0.0).all()  # and fine detail first; at 1 it is the clamped cosine's, with a 0


def test_samples_return_no_more_light_than_arrives():
    means = []
    for alpha in ALPHAS:
        directions, weights = looking_down(alpha, 4096)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-12)
        means.append(weights.mean())
    assert means[0] == pytest.approx(1.0, abs=0.01)
    assert (np.diff(means) < 0.0).all()  # Smith's masking loses what bounces twice between facets
    assert means[-1] == pytest.approx(1.0 - np.log(2.0), rel=1e-3)  # of alpha 1: the integral of c / (1 + c)


def test_samples_of_a_narrow_lobe_lie_about_the_mirrored_direction():
    normal = np.array([[0.0, 0.0, 1.0]])
    toward = np.array([[0.6, 0.0, 0.8]])
    found = [lobe_direction(np.full(1, 0.02), normal, toward, k, 64, np.zeros(1))[0] for k in range(64)]
    mean = np.concatenate(found).mean(axis=0)
    assert np.degrees(np.arccos(mean @ [-0.6, 0.0, 0.8] / np.linalg.norm(mean))) < 1.0


def test_a_dielectric_mirrors_all_at_grazing_angles_and_a_metal_rises_not():
    cosine = np.array([1.0, 0.0])
    np.testing.assert_allclose(0.04 * fresnel_rise(cosine, np.zeros(2, bool)), [0.04, 1.0])
    np.testing.assert_array_equal(fresnel_rise(cosine, np.ones(2, bool)), 1.0)
