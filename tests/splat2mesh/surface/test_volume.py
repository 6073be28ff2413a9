"""Surface or volume: sheets are surfaces however they lie, leaves are volumes, and the order does not matter."""

import numpy as np
import pytest

from splat2mesh.splats.splats import Splats
from splat2mesh.surface.volume import splat_volume, vertex_volume


def flat_splats(means, quats):
    count = len(means)
    scales = np.tile([0.02, 0.02, 0.002], (count, 1))
    return Splats(means, scales, quats, np.full(count, 0.8), np.zeros((count, 1, 3)))


def sheet(count=3000, noise=0.002, seed=0):
    rng = np.random.default_rng(seed)
    means = np.column_stack([rng.uniform(-1, 1, (count, 2)), rng.normal(0, noise, count)])
    return flat_splats(means, np.tile([1.0, 0, 0, 0], (count, 1)))


def foliage(count=3000, seed=0, center=(0.0, 0.0, 0.0)):
    """Leaves of every orientation in a cube."""
    rng = np.random.default_rng(seed)
    return flat_splats(rng.uniform(-0.5, 0.5, (count, 3)) + center, rng.normal(size=(count, 4)))


def both():
    parts = sheet(), foliage(center=(0.0, 0.0, 1.5))
    names = "means", "scales", "quats_wxyz", "opacities", "sh"
    return Splats(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_a_sheet_is_a_surface_in_any_unit(scale):
    s = sheet()
    s = Splats(scale * s.means, scale * s.scales, s.quats_wxyz, s.opacities, s.sh)
    assert splat_volume(s).max() == 0.0


def test_a_ball_is_a_surface():
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    quats = np.stack([1 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(4000)], axis=1)
    assert np.quantile(splat_volume(flat_splats(normals, quats)), 0.99) < 0.05


def test_a_forest_is_a_volume_throughout():
    volume = splat_volume(foliage())
    assert np.quantile(volume, 0.05) > 0.5
    assert volume.max() <= 1.0


def test_both_in_one_scene_are_told_apart_in_any_order():
    s = both()
    volume = splat_volume(s)
    assert volume[:3000].mean() < 0.02
    assert volume[3000:].mean() > 0.6
    order = np.random.default_rng(1).permutation(len(s))
    np.testing.assert_allclose(splat_volume(s.take(order)), volume[order], atol=1e-6)


def test_vertices_take_the_volume_of_the_splats_about_them():
    s = both()
    found = vertex_volume(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.5]]), s, splat_volume(s))
    assert found[0] < 0.05
    assert found[1] > 0.5


@pytest.mark.parametrize("count", [10, 16, 17])
def test_few_splats_are_no_error(count):
    assert splat_volume(sheet(count)).shape == (count,)
    assert vertex_volume(np.zeros((2, 3)), sheet(count), np.zeros(count, np.float32)).shape == (2,)
