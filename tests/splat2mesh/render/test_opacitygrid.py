"""The grid of opacity: rays stop at surfaces, in the foreground and behind it, and learn how fine they were trained."""

import numpy as np
import pytest
from place_splats import box, joined

from splat2mesh.render.opacitygrid import SCALES_PER_PIXEL, OpacityGrid

AXES = np.concatenate([np.eye(3), -np.eye(3)])


@pytest.fixture(scope="module")
def grid():
    splats = joined(box([-1, -1, -1], [1, 1, 1], 0.02), box([-12, -12, -12], [12, 12, 12], 0.6))
    return OpacityGrid.around(splats, np.array([[-1.1, -1.1, -1.1], [1.1, 1.1, 1.1]]))


def test_rays_stop_at_the_surface(grid):
    distance, _, level = grid.march(np.array([[0.01, 0.02, 0.03]]), AXES)
    np.testing.assert_allclose(distance[0], 1 - (AXES @ [0.01, 0.02, 0.03]), atol=3 * grid.cells[0])
    assert (level == 0).all()


def test_rays_that_leave_the_foreground_meet_what_is_behind(grid):
    distance, _, level = grid.march(np.array([[0.0, 1.05, 0.0]]), np.array([[0.0, 1.0, 0.0]]))
    assert level[0, 0] > 0
    assert distance[0, 0] == pytest.approx(12 - 1.05, abs=3 * grid.cells[level[0, 0]])


def test_the_pixel_is_read_off_the_splats_that_were_hit(grid):
    _, pixel, _ = grid.march(np.zeros((1, 3)), AXES)
    np.testing.assert_allclose(pixel, 0.6 * 0.02 / SCALES_PER_PIXEL, rtol=1e-3)
    assert grid.finest_pixel() == pytest.approx(0.6 * 0.02 / SCALES_PER_PIXEL, rel=1e-3)


def test_nothing_stops_a_ray_where_there_is_nothing(grid):
    distance, pixel, _ = grid.march(np.array([[0.0, 13.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]))
    assert np.isinf(distance).all() and np.isnan(pixel).all()
