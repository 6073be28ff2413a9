"""How a city is cut: every place has one tile, and no tile more than it may hold."""

import numpy as np
import pytest

from splat2mesh.base.errors import InputError
from splat2mesh.tiles.plan import RING, CityPlan, apart, cut, splats_for


def plan_of(tiles):
    corner = [0.0, 0.0, 0.0]
    return CityPlan(np.eye(4).tolist(), "", 0.1, 0.125, corner, corner, tiles, [0] * len(tiles), [], 0)


@pytest.mark.parametrize("seed", range(5))
def test_tiles_cover_the_city_without_overlap_and_hold_no_more_than_they_may(seed):
    rng = np.random.default_rng(seed)
    places = np.concatenate([rng.uniform(-300, 700, (3000, 2)), rng.normal(100, 40, (3000, 2))])
    bounds = np.stack([places.min(axis=0), places.max(axis=0)])
    tiles, counts = cut(places, np.full(6000, 50.0), bounds, 1.0, 10.0, 40_000)
    plan = plan_of(tiles)
    owner = plan.owner_of(places)
    assert owner.min() >= 0 and sum(counts) == 300_000
    for number, (x0, z0, x1, z1) in enumerate(tiles):
        inside = ((places >= [x0, z0]) & (places < [x1, z1])).all(axis=1)
        np.testing.assert_array_equal(inside, owner == number)
        near = ((places >= np.array([x0, z0]) - 10) & (places < np.array([x1, z1]) + 10)).all(axis=1)
        assert 50 * near.sum() <= 40_000 or min(x1 - x0, z1 - z0) < 8 * RING


def test_a_tile_is_near_itself_and_those_within_the_distance():
    plan = plan_of([[0, 0, 10, 10], [10, 0, 20, 10], [20, 0, 30, 10]])
    assert plan.block == 1.0
    assert plan.near(0, 5.0) == [0, 1] and plan.near(0, 10.5) == [0, 1, 2]
    assert plan.owner_of(np.array([[9.99, 0.0], [10.0, 0.0], [-1.0, 0.0]])).tolist() == [0, 1, -1]


def test_memory_that_the_libraries_fill_is_refused():
    with pytest.raises(InputError, match="`memory`"):
        splats_for(0.5)
    assert splats_for(2.0) == pytest.approx(300_000, rel=0.1)
    assert splats_for(1000.0) > splats_for(None) > splats_for(2.0)


def test_a_city_beyond_the_lattice_is_refused():
    with pytest.raises(InputError, match="too many"):
        cut(np.zeros((1, 2)), np.ones(1), np.array([[0.0], [1e6]]) + np.zeros(2), 0.1, 1.0, 10)


def test_the_distance_of_splats_goes_by_the_surface_that_they_lie_on():
    rng = np.random.default_rng(0)
    ground = rng.uniform(0, [400, 0, 20], (20_000, 3))
    wall = rng.uniform(0, [400, 20, 0], (20_000, 3))
    found = apart(np.concatenate([ground, wall]), np.full(40_000, 5.0))
    assert found == pytest.approx(np.sqrt(2 * 400 * 20 / 200_000), rel=0.25)
