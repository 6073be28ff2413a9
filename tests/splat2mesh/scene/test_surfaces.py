"""What readers of mesh files share: fans, joined corners, meshes far from the origin."""

import numpy as np
import pytest

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.surfaces import centred, check_corners, fans, joined


def test_a_polygon_of_n_corners_is_n_minus_2_triangles_around_its_first():
    corners = np.array([7, 8, 9, 0, 1, 2, 3, 4])
    found = fans(corners, np.array([3, 5]), "a.ply")
    assert found.tolist() == [[7, 8, 9], [0, 1, 2], [0, 2, 3], [0, 3, 4]]


def test_polygons_without_area_are_counted_and_left_out():
    with pytest.warns(DataWarning, match="left out 2 of 3 faces"):
        found = fans(np.array([0, 1, 4, 5, 6, 9]), np.array([2, 3, 1]), "a.ply")
    assert found.tolist() == [[4, 5, 6]]


def test_joined_corners_give_back_what_they_held_in_the_order_of_first_use():
    rng = np.random.default_rng(0)
    places = rng.integers(0, 3, (200, 3)).astype(float)
    normals = np.eye(3)[rng.integers(0, 3, 200)]
    corners = rng.permutation(200)
    rows, vertices = joined(corners, places, None, normals)
    np.testing.assert_array_equal(places[rows][vertices], places[corners])
    np.testing.assert_array_equal(normals[rows][vertices], normals[corners])
    assert len(np.unique(np.hstack([places, normals])[rows], axis=0)) == len(rows)
    first = [vertices.tolist().index(vertex) for vertex in range(len(rows))]
    assert first == sorted(first)


def test_minus_zero_joins_zero_and_values_equal_in_float32_are_one():
    values = np.array([[0.0], [-0.0], [1.0], [1.0 + 1e-12]])
    rows, vertices = joined(np.arange(4), values)
    assert rows.tolist() == [0, 2] and vertices.tolist() == [0, 0, 1, 1]


def test_a_mesh_is_moved_only_where_float32_would_lose_it():
    near = np.array([[1.0, 2.0, 3.0], [2.0, 2.0, 3.0]])
    assert centred(near)[1] is None and centred(near)[0] is near
    far = near + np.array([1e7, 0.0, 0.0])
    moved, by = centred(far)
    np.testing.assert_array_equal(by, [1e7 + 1.5, 2.0, 3.0])
    np.testing.assert_array_equal(moved + by, far)
    assert centred(np.full((3, 3), np.nan))[1] is None


@pytest.mark.parametrize("corner", [-1, 3])
def test_corners_beyond_the_vertices_are_refused(corner):
    check_corners(np.array([[0, 1, 2]]), 3, "a.ply")
    with pytest.raises(InputError, match=r"a\.ply: a face names a vertex beyond the 3"):
        check_corners(np.array([[0, 1, corner]]), 3, "a.ply")
