"""SeenPatches of a surface: means over cubes, apart where it faces other ways."""

import numpy as np
import pytest

from splat2mesh.surface.patches import SeenPatches


def level(count, rng, height=0.0, noise=0.01):
    """Points of a level square of side 2 m, facing up."""
    points = np.column_stack(
        [rng.uniform(-1, 1, count), height + rng.normal(0, noise, count), rng.uniform(-1, 1, count)]
    )
    return points, np.tile([0.0, 1.0, 0.0], (count, 1))


def of(points, normals, areas=None, thickness=0.05, side=0.5):
    count = len(points)
    return SeenPatches.of(points, normals, np.full(count, thickness), np.ones(count) if areas is None else areas, side)


def test_patches_are_the_weighted_means_of_their_cells():
    points, normals = level(4000, np.random.default_rng(0))
    areas = np.random.default_rng(1).uniform(0.5, 2, len(points))
    found = of(points, normals, areas)
    assert found.areas.sum() == pytest.approx(areas.sum())
    np.testing.assert_allclose(found.areas @ found.points / areas.sum(), areas @ points / areas.sum(), atol=1e-12)
    np.testing.assert_allclose(found.thickness, 0.05)
    cells = found.cells_of(points)
    for k in range(len(found.areas)):
        mine = cells == found.cells[k]
        np.testing.assert_allclose(found.points[k], np.average(points[mine], axis=0, weights=areas[mine]), atol=1e-12)


def test_noise_cancels_and_its_size_is_known():
    points, normals = level(20_000, np.random.default_rng(2), height=0.2)
    found = of(points, normals)
    assert np.abs(np.average(found.points[:, 1], weights=found.areas) - 0.2) < 3e-4
    assert np.sqrt(np.average(found.scatter**2, weights=found.areas)) == pytest.approx(0.01, rel=0.02)


def test_a_step_within_a_cell_scatters_and_two_sides_are_apart():
    rng = np.random.default_rng(3)
    points, normals = level(4000, rng, height=0.1, noise=0)
    points[points[:, 0] > 0.2, 1] += 0.1
    assert of(points, normals).scatter.max() > 0.03
    both = np.vstack([points, points - [0, 0.01, 0]])
    found = of(both, np.vstack([normals, -normals]))
    assert set(found.normals[:, 1].round(9)) == {1.0, -1.0}


def test_normals_that_cancel_give_no_patch_and_nothing_gives_none():
    points, normals = level(400, np.random.default_rng(4))
    ways = np.array([[0.6, 0.8, 0], [-0.6, 0.8, 0]])[np.arange(400) % 2] * [1.2, 0.9, 1]
    leaning = of(points, ways / np.linalg.norm(ways, axis=1)[:, None], areas=np.zeros(400))
    assert len(leaning.areas) == 0
    none = of(points[:0], normals[:0])
    assert len(none.areas) == 0 and none.cells_of(points).shape == (400,)
