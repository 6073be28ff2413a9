"""Directions on the sphere: even sets, and the texels of lat-long images."""

import numpy as np
import pytest

from splat2mesh.base.sphere import fibonacci_sphere, row_solid_angles, texel_directions
from splat2mesh.views.viewpoints import even_directions


@pytest.mark.parametrize("count", [1, 2, 7, 1000])
@pytest.mark.parametrize("of", [fibonacci_sphere, even_directions])
def test_even_sets_are_unit_and_as_many_lie_above_any_height(of, count):
    directions = of(count)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-14)
    axis = 1 if of is fibonacci_sphere else 2
    heights = directions[:, axis]
    # Of a sphere the part above a height is linear in it: Archimedes.
    np.testing.assert_allclose(heights, 1 - (2 * np.arange(count) + 1) / count, atol=1e-14)


def test_means_over_an_even_set_are_those_of_the_sphere():
    directions = fibonacci_sphere(2000)
    np.testing.assert_allclose(directions.mean(axis=0), 0, atol=1e-4)
    np.testing.assert_allclose(directions.T @ directions / 2000, np.eye(3) / 3, atol=1e-4)


def test_the_first_azimuth_turns_all_of_them():
    turn = 0.5 * np.pi * (3 - np.sqrt(5))
    cos, sin = np.cos(turn), np.sin(turn)
    about_y = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
    np.testing.assert_allclose(fibonacci_sphere(50, first=0.5), fibonacci_sphere(50) @ about_y.T, atol=1e-12)


def test_texels_follow_openexr():
    directions = texel_directions(2, 4)
    assert directions.shape == (2, 4, 3)
    assert (directions[0, :, 1] > 0).all() and (directions[1, :, 1] < 0).all()
    np.testing.assert_allclose(texel_directions(1, 4)[0, :, 0], np.sin(np.pi * np.array([0.75, 0.25, -0.25, -0.75])))
    middle = texel_directions(3, 3)[1, 1]
    np.testing.assert_allclose(middle, [0, 0, 1], atol=1e-15)
    np.testing.assert_array_equal(texel_directions(8, 16, slice(2, 5)), texel_directions(8, 16)[2:5])


@pytest.mark.parametrize(("height", "width"), [(1, 1), (2, 4), (64, 128)])
def test_rows_cover_the_sphere_and_no_more(height, width):
    angles = row_solid_angles(height, width)
    assert angles.shape == (height, 1)
    assert angles.sum() * width == pytest.approx(4 * np.pi, rel=1e-13)
    upper = angles[: height // 2].sum() * width
    assert height == 1 or upper == pytest.approx(2 * np.pi, rel=1e-13)
