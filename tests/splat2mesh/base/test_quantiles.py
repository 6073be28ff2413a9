"""Weighted quantiles."""

import numpy as np
import pytest

from splat2mesh.base.quantiles import weighted_quantile


@pytest.mark.parametrize("part", [0.0, 0.25, 0.5, 0.98, 1.0])
def test_a_weighted_quantile_reaches_its_part_of_the_weight(part):
    """Weights are whole numbers, whose sums are exact: so is the answer, among equal values too."""
    rng = np.random.default_rng(4)
    for count in (1, 2, 3, 10, 999):
        for distinct in (3, 10**6):
            values, weights = rng.integers(0, distinct, count) * 0.5, rng.integers(0, 5, count).astype(float)
            before = values.copy(), weights.copy()
            order = np.argsort(values)
            reached = np.cumsum(weights[order])
            expected = values[order][np.searchsorted(reached, part * reached[-1])]
            assert weighted_quantile(values, weights, part) == expected
            np.testing.assert_array_equal((values, weights), before)
    assert weighted_quantile(np.array([np.nan, 2.0, -np.inf]), np.ones(3), 0.5) == 2.0
