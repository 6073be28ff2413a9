"""The pinhole camera: projection and rays undo one another, whatever the pose, size and zoom."""

import numpy as np
import pytest

from splat2mesh.render.view import View

# Positions of order one seen through focal lengths of order 100 pixels, in float64.
PIXEL_ROUNDING = 1e-10


def a_view(width=60, height=40):
    view = View.look_at([2.0, 1.0, -3.0], [0.1, 0.2, 0.3], [0.2, 1.0, 0.1], 50.0, width, height)
    return View(width, height, view.fx, 1.3 * view.fy, 0.4 * width, 0.7 * height, view.camera_from_world)


def points_before(view, count=50, seed=0):
    """Random points that lie inside the image, between z = 1 and z = 5."""
    rng = np.random.default_rng(seed)
    rays = view.ray_directions().reshape(-1, 3)
    return view.center + rng.uniform(1, 5, (count, 1)) * rays[rng.integers(0, len(rays), count)]


def test_projecting_points_on_the_rays_gives_the_pixel_centres():
    view = a_view()
    z = np.random.default_rng(1).uniform(0.5, 9.0, (view.height, view.width))
    points = view.center + z[..., None] * view.ray_directions()
    pixels, depth = view.project(points.reshape(-1, 3))
    columns, rows = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    np.testing.assert_allclose(pixels, np.stack([columns, rows], -1).reshape(-1, 2), atol=PIXEL_ROUNDING)
    np.testing.assert_allclose(depth, z.ravel(), rtol=1e-13)


def test_look_at_puts_the_target_in_the_centre_with_up_upwards_and_nothing_mirrored():
    eye, target, up = np.array([[3.0, 2.0, 1.0], [-0.5, 0.2, 0.4], [0.1, 0.9, -0.3]])
    view = View.look_at(eye, target, up, 60.0, 64, 48)
    # Seen by someone at the eye whose head points along up: their right hand is forward x up.
    right = np.cross(target - eye, up)
    pixels, z = view.project(np.stack([target, target + 0.1 * up, target + 0.1 * right]))
    np.testing.assert_allclose(pixels[0], [32, 24], atol=PIXEL_ROUNDING)
    np.testing.assert_allclose(z[0], np.linalg.norm(target - eye), rtol=1e-14)
    assert pixels[1, 1] < 24 and abs(pixels[1, 0] - 32) < PIXEL_ROUNDING  # rows grow downwards
    assert pixels[2, 0] > 32 and abs(pixels[2, 1] - 24) < PIXEL_ROUNDING
    rotation = view.camera_from_world[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(view.center, eye, atol=1e-14)
    np.testing.assert_allclose(view.forward, (target - eye) / np.linalg.norm(target - eye), atol=1e-15)


def test_field_of_view_is_the_angle_between_the_left_and_right_edge():
    view = View.look_at([0, 0, -2], [0, 0, 1], [0, 1, 0], 70.0, 100, 30)
    # The edges lie half a pixel outside the outermost pixel centres.
    edge = np.degrees(np.arctan2(view.width / 2, view.fx))
    assert 2 * edge == pytest.approx(70.0, abs=1e-12)
    assert view.fx == view.fy


@pytest.mark.parametrize("axis", [[0, 1, 0], [0, -2, 0], [0, 0, 1], [1, 0, 0], [1, 1, 1], [-1, 1, 0], [0.3, -2, 5]])
def test_up_along_the_line_of_sight_still_gives_a_rigid_camera(axis):
    view = View.look_at([0, 0, 0], axis, axis, 40.0, 8)
    rotation = view.camera_from_world[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(view.forward, np.array(axis) / np.linalg.norm(axis), atol=1e-14)


@pytest.mark.parametrize("longest", [30, 60, 120])
def test_resizing_scales_every_projection_with_the_image(longest):
    view = a_view(60, 40)
    small, points = view.resized(longest), points_before(view)
    assert (small.width, small.height) == (longest, longest * 40 // 60)
    before, after = view.project(points), small.project(points)
    np.testing.assert_allclose(after[0], before[0] * longest / 60, atol=PIXEL_ROUNDING)
    np.testing.assert_array_equal(after[1], before[1])


def test_resizing_to_a_side_that_does_not_divide_keeps_what_the_image_shows():
    view = a_view(60, 40)
    small, points = view.resized(25), points_before(view)  # 25 x 16.7
    assert (small.width, small.height) == (25, 17)
    relative = view.project(points)[0] / [view.width, view.height]
    np.testing.assert_allclose(small.project(points)[0] / [25, 17], relative, atol=PIXEL_ROUNDING)


@pytest.mark.parametrize("seed", range(20))
def test_framing_holds_all_points_touches_the_edges_and_keeps_the_size_limit(seed):
    view = View.look_at([4.0, 1.0, 2.0], [0, 0, 0], [0, 1, 0], 40.0, 80)
    points = np.random.default_rng(seed).uniform(-0.6, 0.8, (30, 3))
    framed = view.framing(points)
    before, (after, _) = view.project(points)[0], framed.project(points)
    assert max(framed.width, framed.height) == 80
    np.testing.assert_allclose(after.min(axis=0), 0.0, atol=1e-9)
    size = np.array([framed.width, framed.height])
    # Whole pixels only: less than one of them stays empty at the right and bottom edge.
    assert (after.max(axis=0) <= size + 1e-6).all() and (after.max(axis=0) > size - 1).all()
    zoom = framed.fx / view.fx
    np.testing.assert_allclose(after - after[0], (before - before[0]) * zoom, atol=1e-9)
    np.testing.assert_array_equal(framed.camera_from_world, view.camera_from_world)


def test_points_behind_have_negative_depth_and_a_point_at_the_eye_is_no_crash():
    view = View.look_at([0, 0, -2], [0, 0, 0], [0, 1, 0], 40.0, 8)
    pixels, z = view.project(np.array([[0.0, 0.0, -5.0], [0.0, 0.0, -2.0]]))
    np.testing.assert_allclose(z, [-3.0, 0.0], atol=1e-15)
    assert np.isnan(pixels[1]).all()
