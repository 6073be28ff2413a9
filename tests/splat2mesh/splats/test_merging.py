"""Splats made fewer: the mixture's moments stay, and so does what they cover."""

import numpy as np
import pytest
from splat_samples import make_splats

from splat2mesh.splats.merging import merged
from splat2mesh.splats.splats import Splats


def test_one_splat_for_several_has_the_moments_of_their_mixture():
    splats = make_splats(11, 1)
    found = merged(splats, 4)
    assert len(found) == 3 and found.degree == splats.degree == 1
    area = np.sort(splats.scales, axis=1)[:, 1:].prod(axis=1)
    for number, rows in enumerate((slice(0, 4), slice(4, 8), slice(8, 11))):
        weights = (splats.opacities * area)[rows].astype(float)
        mean = np.average(splats.means[rows], axis=0, weights=weights)
        away = splats.means[rows] - mean
        spread = splats.covariances()[rows] + np.einsum("ni,nj->nij", away, away)
        np.testing.assert_allclose(found.means[number], mean, rtol=1e-5, atol=1e-6)
        expected = np.average(spread, axis=0, weights=weights)
        np.testing.assert_allclose(found.covariances()[number], expected, rtol=1e-4, atol=1e-6 * expected.max())
        colors = np.average(splats.sh[rows], axis=0, weights=weights)
        np.testing.assert_allclose(found.sh[number], colors, rtol=1e-5, atol=1e-6)
        own = np.sort(found.scales[number])[1:].prod()
        assert found.opacities[number] == pytest.approx(min(weights.sum() / own, 1.0), rel=1e-3)


def test_equal_splats_at_one_place_stay_what_they_are():
    one = make_splats(1, 0)
    splats = Splats(*(np.repeat(getattr(one, name), 4, axis=0) for name in ("means", "scales", "quats_wxyz")),
                    np.full(4, 0.1), np.repeat(one.sh, 4, axis=0))  # fmt: skip
    found = merged(splats)
    np.testing.assert_allclose(found.means, one.means, rtol=1e-5)
    np.testing.assert_allclose(np.sort(found.scales), np.sort(one.scales), rtol=1e-3)
    np.testing.assert_allclose(found.opacities, 0.4, rtol=1e-3)
