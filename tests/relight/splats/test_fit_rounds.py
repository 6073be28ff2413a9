"""The fit's loops give the sums of drawing whole pictures and spreading their errors, to the bit."""

import numpy as np
import pytest
from ball_splats import solid_ball

from relight.splats.blending import blending_of
from relight.splats.fit_rounds import FitRounds
from splat2mesh.render.view import View


@pytest.fixture(scope="module")
def fit():
    """A fit to a third of the pixels of two views, and its Gaussians' colours, (N, 3)."""
    splats = solid_ball(800)
    eyes = ([1.0, 0.0, -7.0], (70, 50)), ([0.5, 1.0, 6.0], (64, 48))
    views = [View.look_at(eye, [0.0, 0.0, 0.0], [0, -1, 0], 30, *size) for eye, size in eyes]
    blending, rng = blending_of(splats, views, 0.01), np.random.default_rng(5)
    pixels = len(blending.drawn(np.zeros((len(splats), 3), np.float32)))
    known = np.flatnonzero(rng.random(pixels) < 0.33)
    return FitRounds.of(blending, known), rng.normal(size=(len(splats), 3)).astype(np.float32)


def test_what_is_wanted_is_the_picture_times_the_gains(fit):
    rounds, colors = fit
    gains = np.random.default_rng(6).normal(size=(len(rounds.known), 3)).astype(np.float32)
    weight, expected = np.zeros((2, len(colors), 1), np.float32)
    mask = np.zeros((len(rounds.blending.drawn(colors)), 1), np.float32)
    mask[rounds.known] = 1.0
    rounds.blending.spread(mask, expected)
    wanted = gains.copy()
    rounds.begin(colors, wanted, weight)
    np.testing.assert_array_equal(wanted, gains * rounds.blending.drawn(colors)[rounds.known])
    np.testing.assert_array_equal(weight, expected)
    assert weight.any()


def test_what_is_spread_is_what_the_picture_lacks(fit):
    rounds, colors = fit
    wanted = np.random.default_rng(7).normal(size=(len(rounds.known), 3)).astype(np.float32)
    picture = rounds.blending.drawn(colors)
    error = np.zeros_like(picture)
    error[rounds.known] = wanted - picture[rounds.known]
    sums, expected = np.zeros((2, *colors.shape), np.float32)
    rounds.blending.spread(error, expected)
    rounds.spread(colors, wanted, sums)
    np.testing.assert_array_equal(sums, expected)
    assert sums.any()


def test_without_a_known_pixel_nothing_is_spread(fit):
    rounds, colors = fit
    none = FitRounds.of(rounds.blending, np.zeros(0, np.int64))
    sums = np.zeros_like(colors)
    none.spread(colors, np.zeros((0, 3), np.float32), sums)
    assert not sums.any()
