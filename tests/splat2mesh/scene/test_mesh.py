"""Normals of vertices where they are known, and where the faces around a vertex cancel."""

import numpy as np
import pytest

from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.mesh import Mesh, known_normals, vertex_normals
from splat2mesh.scene.scene import Scene

OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
FACES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])


def test_the_corners_of_an_octahedron_look_away_from_its_middle():
    found = vertex_normals(OCTAHEDRON, FACES)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, OCTAHEDRON, atol=1e-7)
    np.testing.assert_allclose(vertex_normals(OCTAHEDRON, FACES[:, ::-1]), -OCTAHEDRON, atol=1e-7)


def test_where_two_sides_cancel_the_largest_face_decides():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 2, 0]], float)
    # Both sides of one triangle: every mean is zero, and the last of two equal faces stays.
    np.testing.assert_array_equal(vertex_normals(points[:3], [[0, 1, 2], [0, 2, 1]]), [[0, 0, -1]] * 3)
    found = vertex_normals(points, [[0, 1, 3], [0, 2, 1]])
    np.testing.assert_allclose(np.abs(found[:, 2]), 1.0)
    assert found[3, 2] == 1.0 and found[2, 2] == -1.0


def test_a_vertex_without_faces_looks_up():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]], float)
    np.testing.assert_array_equal(vertex_normals(points, [[0, 1, 2]])[3], [0, 1, 0])


@pytest.mark.parametrize("missing", [[0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 0], [1e-9, 0, 0]])
def test_missing_normals_are_those_of_the_faces_and_others_stay(missing):
    normals = np.tile(np.float32([0, 0, 2]), (7, 1))
    normals[[1, 6]] = missing
    points = np.concatenate([OCTAHEDRON, [[5, 5, 5]]])
    mesh = Mesh(np.float32(points), normals, np.int32(FACES), np.zeros((7, 3), np.uint8))
    found = known_normals(mesh)
    np.testing.assert_allclose(found[:6], [[0, 0, 2], [-1, 0, 0], *4 * [[0, 0, 2]]], atol=1e-7)
    np.testing.assert_array_equal(found[6], np.float32(missing))  # no face says where it looks
    with pytest.warns(DataWarning, match="2 vertices of 14 had no normal"):  # one of each: the other has no faces
        np.testing.assert_array_equal(Scene([mesh, mesh]).normals, np.concatenate([found, found]))


def test_normals_that_are_there_are_not_copied_and_what_is_no_mesh_stays():
    whole = Mesh(np.float32(OCTAHEDRON), np.float32(OCTAHEDRON), np.int32(FACES), np.zeros((6, 3), np.uint8))
    assert known_normals(whole) is whole.normals
    none = np.zeros((6, 3), np.float32)
    for faces in (FACES + 1, FACES - 1, FACES[:0]):
        assert known_normals(Mesh(whole.vertices, none, faces, whole.colors_srgb)) is none
