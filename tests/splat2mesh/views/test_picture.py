import numpy as np
import pytest

from splat2mesh.render.view import View
from splat2mesh.views.picture import mesh_depth, place_view
from splat2mesh.views.standpoints import Eye

UP = np.array([0.0, 1.0, 0.0])


def sheet(corner, a, b, count):
    """A square of count x count vertices from a corner along two edges: vertices and faces."""
    u, v = np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, count))
    points = np.asarray(corner) + u[..., None] * np.asarray(a) + v[..., None] * np.asarray(b)
    index = np.arange(count * count).reshape(count, count)
    p, q, r, s = index[:-1, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel()
    return points.reshape(-1, 3), np.concatenate([np.stack([p, q, r], 1), np.stack([q, s, r], 1)])


def joined(*meshes):
    starts = np.cumsum([0, *(len(points) for points, _ in meshes[:-1])])
    faces = [faces + start for (_, faces), start in zip(meshes, starts, strict=True)]
    return np.concatenate([points for points, _ in meshes]).astype(np.float32), np.concatenate(faces)


@pytest.fixture
def yard():
    """A lawn of few vertices, a richly captured table on it, and a closet around (-6, ., 0), half a metre each way."""
    lawn = sheet([-10, 0, -10], [20, 0, 0], [0, 0, 20], 12)
    table = sheet([3.0, 0.8, 2.5], [1.5, 0, 0], [0, 0, 1.5], 60)
    walls = [sheet([-6.5, 0, z], [1, 0, 0], [0, 3, 0], 8) for z in (-0.5, 0.5)]
    walls += [sheet([x, 0, -0.5], [0, 0, 1], [0, 3, 0], 8) for x in (-6.5, -5.5)]
    return joined(lawn, *walls, table)


CLOSET = Eye(np.array([-6.0, 1.6, 0.0]), 0.01)


def test_the_picture_shows_what_was_captured_most_closely_and_no_wall(yard):
    vertices, faces = yard
    eyes = [CLOSET, Eye(np.array([-1.0, 1.6, 3.0]), 0.01)]
    view = place_view(vertices, mesh_depth(vertices, faces), eyes, [], UP)
    assert view.width / view.height == pytest.approx(4 / 3)
    np.testing.assert_allclose(view.center, eyes[1].center, atol=1e-12)
    pixels, depth = view.project(vertices[-3600:].astype(np.float64))
    shown = (depth > 0) & (pixels >= 0).all(axis=1) & (pixels < [view.width, view.height]).all(axis=1)
    assert shown.all()


def test_a_camera_of_the_capture_may_have_the_best_view(yard):
    vertices, faces = yard
    trained = View.look_at([3.8, 2.4, 6.0], [3.8, 0.8, 3.2], UP, 50.0, 64)
    view = place_view(vertices, mesh_depth(vertices, faces), [CLOSET], [trained], UP)
    np.testing.assert_allclose(view.center, trained.center)
    np.testing.assert_allclose(view.forward, trained.forward, atol=1e-12)
