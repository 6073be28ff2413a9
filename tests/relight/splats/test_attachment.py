"""Places of Gaussians on the mesh: each by itself."""

import numpy as np
import pytest
from viewer_scenes import ball_on_plate

from relight.splats.attachment import Places, Surface
from splat2mesh.splats.splats import Splats


@pytest.mark.parametrize("count", [0, 1, 500])
def test_the_place_of_a_gaussian_depends_on_no_other_and_on_no_order(count):
    rng, surface = np.random.default_rng(3), Surface(ball_on_plate())
    means, scales = rng.uniform(-1.5, 1.5, (count, 3)), rng.uniform(0.01, 0.1, (count, 3))
    splats = Splats(means, scales, rng.normal(size=(count, 4)), np.ones(count), np.zeros((count, 1, 3)))
    places, order = Places(surface, splats), rng.permutation(count)
    shuffled = Places(surface, splats.take(order))
    for name in ("columns", "weights", "far"):
        np.testing.assert_array_equal(getattr(shuffled, name), getattr(places, name)[order])
