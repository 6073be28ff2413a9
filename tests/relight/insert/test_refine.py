"""Triangles made finer."""

import numpy as np

from relight.insert.refine import carried, refined
from splat2mesh.scene.mesh import unit


def fan(count=9):
    angle = np.arange(count) * 2 * np.pi / count
    points = np.concatenate([np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1), [[0, 0, 0]]])
    faces = np.stack([np.arange(count), (np.arange(count) + 1) % count, np.full(count, count)], 1)
    return points, faces.astype(np.int32)


def area(points, faces):
    a, b, c = points[faces.T]
    return 0.5 * np.cross(b - a, c - a)[:, 2]


def test_area_winding_and_neighbours_stay():
    points, faces = fan()
    finer, rounds = refined(points, faces, 0.2, 10**6, points[:, 0] > 0.5)
    placed = carried(points, rounds)
    areas = area(placed, finer)
    assert areas.min() > 0.0
    np.testing.assert_allclose(areas.sum(), area(points, faces).sum())
    edges = np.sort(np.concatenate([finer[:, [0, 1]], finer[:, [1, 2]], finer[:, [2, 0]]]), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert count.max() == 2
    boundary = np.unique(edges, axis=0)[count == 1]
    inner = (placed[boundary] ** 2).sum(-1) < 0.7  # a gap would have edges of its own within the fan
    assert not inner.any()


def test_edges_end_as_short_as_asked_where_that_is_wanted_and_stay_elsewhere():
    points, faces = fan()
    finer, rounds = refined(points, faces, 0.1, 10**6)
    placed = carried(points, rounds)
    assert max(np.linalg.norm(placed[finer[:, i]] - placed[finer[:, i - 1]], axis=1).max() for i in range(3)) <= 0.1
    same, none = refined(points, faces, 0.1, 10**6, np.zeros(len(points), bool))
    assert none == []
    np.testing.assert_array_equal(same, faces)


def test_too_many_faces_are_not_cut_again():
    points, faces = fan()
    finer, _ = refined(points, faces, 1e-3, 100)
    assert 100 < len(finer) <= 400


def test_values_of_new_vertices_are_the_means_of_their_parents():
    points, faces = fan()
    _, rounds = refined(points, faces, 0.3, 10**6)
    linear = points @ np.array([[1.0], [2.0], [0.0]])
    placed = carried(points, rounds)
    np.testing.assert_allclose(carried(linear, rounds), placed @ np.array([[1.0], [2.0], [0.0]]), atol=1e-12)


def test_normals_have_length_one_and_none_stays_none():
    found = unit(np.array([[0.0, 3.0, 4.0], [0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(found, [[0.0, 0.6, 0.8], [0.0, 0.0, 0.0]])
