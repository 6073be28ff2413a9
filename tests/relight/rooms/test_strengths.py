"""Strengths from several samples of places: what they average, and what does not count."""

import numpy as np

from relight.rooms.received import RoomIrradiance
from relight.rooms.strengths import Strengths, averaged

EAST, WEST, UP = [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]


def sample(lamp, sky, patches=(EAST, WEST)):
    """A sample whose patches have these brightnesses, with the Strengths that it gives."""
    none = np.zeros((0, 3))
    directions = np.array(patches, np.float64).reshape(-1, 3)
    places = RoomIrradiance(np.zeros(0, np.int64), none, none[:, None], directions, none, none, none, none)
    shares = np.full(1 + (len(directions) > 0), 0.5)
    bright = np.repeat(np.array(sky, np.float64)[:, None], 3, axis=1)
    return places, Strengths(np.full((1, 3), lamp), bright, shares, 0.1, 0.4, shares, 0.2)


def test_one_sample_is_its_own_mean():
    alone = sample(20.0, [3.0, 5.0])
    for mean, own in zip(averaged([alone]), alone[1], strict=True):
        np.testing.assert_allclose(mean, own, rtol=1e-12)


def test_strengths_are_geometric_means_and_patches_those_of_the_nearest():
    found = averaged([sample(20.0, [3.0, 5.0]), sample(5.0, [20.0, 12.0], (WEST, EAST)), sample(10.0, [1.0], (UP,))])
    np.testing.assert_allclose(found.radiance, 10.0)
    np.testing.assert_allclose(found.patches[:, 0], np.cbrt([3.0 * 12.0, 5.0 * 20.0]))


def test_samples_that_show_nothing_or_other_emitters_do_not_count():
    first = sample(20.0, [3.0, 5.0])
    found = averaged([first, (first[0], None), sample(5.0, [], ())])
    np.testing.assert_allclose(found.radiance, 20.0)
    np.testing.assert_allclose(found.patches, first[1].patches)
    assert averaged([(first[0], None), first]) is None
