"""Splitting edges where colours ask for it: more vertices on a line of colour, none on plain ground, and no gap."""

import numpy as np

from splat2mesh.render.opacityfield import FieldDepth
from splat2mesh.render.view import View
from splat2mesh.surface.album import Album, filled_in
from splat2mesh.surface.refine import refine_by_color
from splat2mesh.surface.sight import Sighting

SIDE = 256


def album():
    """One picture straight down on the plane y = 0 from a height of 1: white for x < 0.11, black beyond."""
    view = View.look_at([0, 1, 0], [0, 0, 0], [0, 0, 1], 90.0, SIDE)
    points = view.center + view.ray_directions()
    color = np.repeat((points[..., :1] < 0.11).astype(np.float32), 3, axis=-1)
    flat = np.ones((SIDE, SIDE), np.float32)
    seen = FieldDepth(flat, np.tile(np.float32([0, 1, 0]), (SIDE, SIDE, 1)), 0.01 * flat, color, flat)
    return Album.of([Sighting(view, seen, 0.01 * flat)])


def plane(count=9):
    """A square of the plane y = 0 in 2 (count - 1)^2 faces that look up."""
    grid = np.linspace(-0.9, 0.9, count)
    x, z = np.meshgrid(grid, grid, indexing="ij")
    points = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1).astype(np.float32)
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + count], axis=1),
            np.stack([corner + 1, corner + count + 1, corner + count], axis=1),
        ]
    )
    return points, faces.astype(np.int32)


def area(points, faces):
    a, b, c = (points[faces[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_vertices_gather_where_the_colour_changes():
    points, faces = plane()
    finer, split = refine_by_color(points, faces, album(), 10_000)
    added = finer[len(points) :]
    assert len(added) > 50
    assert (np.abs(added[:, 0] - 0.11) < 0.3).all()
    assert np.isclose(area(finer, split), area(points, faces), rtol=1e-6)
    normals = np.cross(finer[split[:, 1]] - finer[split[:, 0]], finer[split[:, 2]] - finer[split[:, 0]])
    assert (normals[:, 1] > 0).all()


def test_no_gap_opens():
    points, faces = refine_by_color(*plane(), album(), 10_000)
    starts, ends = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    edges = set(zip(starts.tolist(), ends.tolist(), strict=True))
    alone = np.array([edge for edge in edges if edge[::-1] not in edges])
    # What has no neighbour lies on the outer border, all of it.
    on_border = np.isclose(np.abs(points[alone][..., [0, 2]]), 0.9, atol=1e-6)
    assert on_border.all(axis=1).any(axis=1).all()


def test_the_number_of_vertices_is_kept():
    assert len(refine_by_color(*plane(), album(), 100)[0]) == 100
    points, faces = plane()
    same, kept = refine_by_color(points, faces, album(), len(points))
    assert len(same) == len(points) and kept is faces


def test_colours_come_from_the_picture_and_else_from_the_nearest_that_has_one():
    points = np.float32([[-0.5, 0, 0], [0.5, 0, 0], [0.55, -5, 0]])
    colors, thickness, pixel = album().look_up(points, np.tile(np.float32([0, 1, 0]), (3, 1)))
    np.testing.assert_allclose(colors[:2, 0], [255, 0])
    assert np.isnan(colors[2]).all() and np.isinf(thickness[2]) and np.isinf(pixel[2])
    np.testing.assert_allclose(pixel[:2], 2 / SIDE, rtol=1e-6)
    np.testing.assert_allclose(thickness[:2], 0.01, rtol=1e-6)
    filled, unseen = filled_in(colors, points)
    assert unseen == 1 and filled[2, 0] == 0


def test_the_back_of_a_surface_is_not_seen():
    colors, _, _ = album().look_up(np.zeros((1, 3), np.float32), np.float32([[0, -1, 0]]))
    assert np.isnan(colors).all()
