"""Surface or volume: sheets are surfaces however they lie, leaves are volumes, and the order does not matter."""

import numpy as np
import pytest

from splat2mesh.splats.splats import Splats
from splat2mesh.surface.measure import is_shell, measured_of
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


def test_both_in_one_scene_are_separated_in_any_order():
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


def ball(inner, count=6000, seed=0):
    """Opaque leaves of every orientation, evenly between an inner radius and 1; points on its surface."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    radii = np.cbrt(rng.uniform(inner**3, 1.0, (count, 1)))
    return flat_splats(directions * radii, rng.normal(size=(count, 4))), directions


def test_an_opaque_object_whose_surface_has_no_order_has_no_leaves_and_a_bush_keeps_its_own():
    none = np.zeros(0, np.int64)
    shell, points = ball(0.92)
    bush, _ = ball(0.0)
    shell_volume = (splat_volume(shell) > 0.25).mean()
    assert shell_volume > 0.1  # the neighbourhoods alone take it for leaves
    assert is_shell(points, shell, splat_volume(shell)) and not is_shell(points, bush, splat_volume(bush))
    assert not measured_of(shell, none, points, np.eye(4), is_object=True).foliage.any()
    leafy = measured_of(bush, none, points, np.eye(4), is_object=True)
    np.testing.assert_array_equal(leafy.foliage, measured_of(bush, none, points, np.eye(4)).foliage)
    assert leafy.foliage.mean() > 0.5
