"""Light that a volume shares: surfaces keep every bit, constants stay, noise goes."""

import numpy as np
import pytest

from relight.splats.wide import LEAST, Neighborhoods


@pytest.fixture
def grass():
    """A meadow of which half is a volume, and a change of light that is noise there."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (4000, 3)).astype(np.float32) * [1, 0.05, 1]
    volume = np.where(points[:, 0] > 0, 1.0, 0.0).astype(np.float32)
    return points, volume, rng.normal(0, 0.5, (4000, 3)).astype(np.float32)


def test_surfaces_keep_every_bit(grass):
    points, volume, values = grass
    found = Neighborhoods(points, volume).shared(values)
    np.testing.assert_array_equal(found[volume == 0], values[volume == 0])
    np.testing.assert_array_equal(Neighborhoods(points, 0 * volume).shared(values), values)
    np.testing.assert_array_equal(Neighborhoods(points, 0 * volume + LEAST / 2).shared(values), values)


def test_a_constant_change_stays(grass):
    points, volume, values = grass
    constant = np.full_like(values, 0.3)
    np.testing.assert_allclose(Neighborhoods(points, volume).shared(constant), constant, rtol=1e-5)


def test_noise_among_leaves_falls_as_the_root_of_the_neighbours(grass):
    points, volume, values = grass
    found = Neighborhoods(points, volume).shared(values)
    assert found[volume == 1].std() < 1.3 * values.std() / np.sqrt(48)


def test_half_a_volume_is_half_drawn(grass):
    points, volume, values = grass
    whole = Neighborhoods(points, volume).shared(values) - values
    half = Neighborhoods(points, 0.5 * volume).shared(values) - values
    np.testing.assert_allclose(half, 0.5 * whole, atol=1e-6)


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_few_leaves_are_no_error(grass, count):
    points, _, values = grass
    volume = (np.arange(len(points)) < count).astype(np.float32)
    assert np.isfinite(Neighborhoods(points, volume).shared(values)).all()


def test_chunks_and_order_change_nothing(grass):
    points, volume, values = grass
    order = np.random.default_rng(1).permutation(len(points))
    found = Neighborhoods(points[order], volume[order]).shared(values[order])
    np.testing.assert_allclose(found, Neighborhoods(points, volume).shared(values)[order], atol=1e-6)
