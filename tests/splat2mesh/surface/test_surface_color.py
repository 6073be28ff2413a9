"""Vertex colours and thicknesses from pictures: only views that see a vertex contribute."""

import numpy as np
import open3d as o3d
import pytest

from splat2mesh.render.view import View
from splat2mesh.surface.album import Album, RenderedPicture, filled_in


def shown(vertices, normals, pictures):
    """What an album of an object shows at its vertices."""
    radius = np.linalg.norm(np.ptp(vertices, axis=0)) / 2 if len(vertices) else 1.0
    return Album.of_object(pictures, radius).look_up(vertices, normals)


def vertex_colors(vertices, normals, pictures):
    return filled_in(shown(vertices, normals, pictures)[0], vertices)


def vertex_thickness(vertices, normals, pictures):
    return shown(vertices, normals, pictures)[1]


RED, GREEN = np.array([200, 10, 30]), np.array([20, 180, 60])


def sphere(radius=1.0, center=(0, 0, 0), resolution=24):
    mesh = o3d.geometry.TriangleMesh.create_sphere(radius, resolution)
    normals = np.asarray(mesh.vertices) / radius
    return (normals * radius + center).astype(np.float32), normals.astype(np.float32)


def hit_depth(view, center, radius):
    """Camera z at which each pixel's ray enters a sphere: (H, W) float64, NaN beside it."""
    rays, to_eye = view.ray_directions(), view.center - np.asarray(center, float)
    a, b, c = (rays**2).sum(-1), rays @ to_eye, to_eye @ to_eye - radius**2
    with np.errstate(invalid="ignore"):
        return (-b - np.sqrt(b * b - a * c)) / a


def picture_of(view, depth, paint=None, thickness=0.1):
    """A picture with color paint(points) / 255, else black, and a thickness (broadcast) where depth is finite."""
    points = view.center + view.ray_directions() * np.nan_to_num(depth)[..., None]
    color = paint(points) / 255 if paint else np.zeros_like(points)
    return RenderedPicture.from_render(
        view, color, depth.astype(np.float32), np.where(np.isfinite(depth), thickness, np.nan)
    )


def halves(points):
    return np.where(points[..., :1] < 0, RED, GREEN)


def around(count=8, distance=4.0, pixels=128, height=0.8):
    angles = (np.arange(count) + 0.5) * 2 * np.pi / count
    eyes = distance * np.stack([np.cos(angles), height * (-1.0) ** np.arange(count), np.sin(angles)], axis=1)
    return [View.look_at(eye, [0, 0, 0], [0, 1, 0], 40.0, pixels) for eye in eyes]


def test_each_half_of_a_sphere_takes_its_own_colour_exactly():
    vertices, normals = sphere()
    pictures = [picture_of(view, hit_depth(view, (0, 0, 0), 1), halves) for view in around()]
    colors, unseen = vertex_colors(vertices, normals, pictures)
    assert unseen == 0 and colors.dtype == np.uint8
    # A pixel is 0.022 wide at the sphere, seen at up to 87 degrees from its normal: so far the seam may blur.
    clear = np.abs(vertices[:, 0]) > 0.1
    assert clear.mean() > 0.8
    np.testing.assert_array_equal(colors[clear], halves(vertices)[clear])


def test_what_hides_a_vertex_does_not_colour_it():
    # A small green sphere between the one camera and a large red one.
    large, large_normals = sphere(1.0)
    small, small_normals = sphere(0.4, (0, 0, 2))
    view = View.look_at([0, 0, 6], [0, 0, 0], [0, 1, 0], 40.0, 256)
    behind, front = hit_depth(view, (0, 0, 0), 1), hit_depth(view, (0, 0, 2), 0.4)
    depth = np.fmin(behind, front)
    picture = picture_of(view, depth, lambda points: np.where(points[..., 2:] > 1.2, GREEN, RED))
    vertices, normals = np.vstack([large, small]), np.vstack([large_normals, small_normals])
    colors, unseen = vertex_colors(vertices, normals, [picture])
    np.testing.assert_array_equal(colors[: len(large)], np.tile(RED, (len(large), 1)))
    in_front = np.arange(len(vertices)) >= len(large)
    facing = (normals * (view.center - vertices)).sum(axis=1) > 0.4
    np.testing.assert_array_equal(colors[in_front & facing], np.tile(GREEN, ((in_front & facing).sum(), 1)))
    # Unseen are the far sides and the shadow of the small sphere on the large one.
    assert unseen > (normals @ [0, 0, 1] < 0).sum()


def test_the_back_of_a_sheet_takes_nothing_from_its_front():
    x, y = np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21))
    vertices = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1).astype(np.float32)
    view = View.look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], 40.0, 64)
    picture = picture_of(view, np.full((64, 64), 5.0), lambda points: np.broadcast_to(RED, points.shape))
    normal = np.tile(np.float32([0, 0, 1]), (len(vertices), 1))
    colors, unseen = vertex_colors(vertices, normal, [picture])
    assert unseen == 0
    np.testing.assert_array_equal(colors, np.tile(RED, (len(vertices), 1)))
    colors, unseen = vertex_colors(vertices, -normal, [picture])
    assert unseen == len(vertices)
    np.testing.assert_array_equal(colors, np.full((len(vertices), 3), 128))


def test_unseen_vertices_are_counted_and_take_their_nearest_seen_neighbours_colour():
    vertices, normals = sphere()
    view = View.look_at([-4, 0, 0], [0, 0, 0], [0, 1, 0], 40.0, 128)
    depth = hit_depth(view, (0, 0, 0), 1)
    upper_green = lambda points: np.where(points[..., 1:2] < 0, RED, GREEN)  # noqa: E731
    colors, unseen = vertex_colors(vertices, normals, [picture_of(view, depth, upper_green)])
    towards = view.center - vertices
    cosine = (normals * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
    # Across half a pixel, 0.016 from corner to corner, a slope of 45 degrees stays within the depth tolerance, 0.017.
    assert (cosine < 0).sum() <= unseen <= (cosine < 0.7).sum()
    far = (cosine < 0) & (np.abs(vertices[:, 1]) > 0.3) & (np.abs(vertices[:, 1]) < 0.9)
    np.testing.assert_array_equal(colors[far], upper_green(vertices)[far])


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_colours_do_not_depend_on_the_unit_of_length(scale):
    vertices, normals = sphere()
    pictures = []
    for view in around():
        pose = view.camera_from_world.copy()
        pose[:3, 3] *= scale
        view = View(view.width, view.height, view.fx, view.fy, view.cx, view.cy, pose)
        pictures.append(picture_of(view, hit_depth(view, (0, 0, 0), scale), halves))
    colors, unseen = vertex_colors(vertices * np.float32(scale), normals, pictures)
    clear = np.abs(vertices[:, 0]) > 0.1
    np.testing.assert_array_equal(colors[clear], halves(vertices)[clear])
    assert unseen == 0


def test_a_picture_keeps_bytes_and_clips():
    view = around(1)[0]
    picture = RenderedPicture.from_render(
        view, np.array([[[0.5, -1.0, 2.0]]]), np.zeros((1, 1), np.float32), np.full((1, 1), 0.25)
    )
    assert picture.color.dtype == np.uint8 and picture.thickness.dtype == np.float32
    np.testing.assert_array_equal(picture.color, [[[128, 0, 255]]])
    np.testing.assert_array_equal(picture.thickness, [[0.25]])


# -- thickness


def two_views(thickness, angles_deg=(0, 60)):
    """Three vertices of a plane, their normals, and pictures of it from these angles with these thicknesses."""
    vertices, normals = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.float32([[0, 0, 1]] * 3)
    pictures = []
    for angle, value in zip(np.radians(angles_deg), thickness, strict=True):
        view = View.look_at([0, 5 * np.sin(angle), 5 * np.cos(angle)], [0, 0, 0], [1, 0, 0], 40.0, 513)
        depth = -view.center[2] / view.ray_directions()[..., 2]  # of the plane z = 0
        pictures.append(picture_of(view, depth, thickness=value))
    return vertices, normals, pictures


def test_each_half_of_a_sphere_has_its_own_thickness():
    vertices, normals = sphere()
    pictures = []
    for view in around():
        depth = hit_depth(view, (0, 0, 0), 1)
        points = view.center + view.ray_directions() * np.nan_to_num(depth)[..., None]
        pictures.append(picture_of(view, depth, thickness=np.where(points[..., 0] < 0, 0.02, 0.5)))
    thickness = vertex_thickness(vertices, normals, pictures)
    assert thickness.shape == (len(vertices),) and thickness.dtype == np.float32
    clear = np.abs(vertices[:, 0]) > 0.1
    # Kept as float32: 6e-8 of it.
    np.testing.assert_allclose(thickness[clear], np.where(vertices[clear, 0] < 0, 0.02, 0.5), rtol=2e-7)


def test_a_thickness_that_is_unknown_does_not_count():
    vertices, normals, pictures = two_views([0.3, np.nan])
    np.testing.assert_allclose(vertex_thickness(vertices, normals, pictures), 0.3, rtol=1e-6)
    assert vertex_colors(vertices, normals, pictures[1:])[1] == 0  # though it is seen
    assert np.isposinf(vertex_thickness(vertices, normals, pictures[1:])).all()


def test_what_no_picture_sees_is_infinitely_thick():
    vertices, normals = sphere()
    view = View.look_at([-4, 0, 0], [0, 0, 0], [0, 1, 0], 40.0, 128)
    pictures = [picture_of(view, hit_depth(view, (0, 0, 0), 1))]
    thickness = vertex_thickness(vertices, normals, pictures)
    unseen = vertex_colors(vertices, normals, pictures)[1]
    assert np.isposinf(thickness).sum() == unseen > len(vertices) / 2 and not np.isnan(thickness).any()
    assert np.isposinf(thickness[(normals * (view.center - vertices)).sum(axis=1) < 0]).all()


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_thickness_scales_with_everything_else(scale):
    vertices, normals = sphere()
    found = []
    for size in (1.0, scale):
        pictures = []
        for count, view in enumerate(around()):
            pose = view.camera_from_world.copy()
            pose[:3, 3] *= size
            view = View(view.width, view.height, view.fx, view.fy, view.cx, view.cy, pose)
            pictures.append(picture_of(view, hit_depth(view, (0, 0, 0), size), thickness=0.02 * (1 + count) * size))
        found.append(vertex_thickness(vertices * np.float32(size), normals, pictures) / size)
    # Vertices are float32: a few that project between two pixels may fall into the other one.
    assert np.isclose(found[0], found[1], rtol=1e-5).mean() > 0.99 and np.ptp(found[0]) > 0.01


def test_no_vertices_have_no_colours():
    nothing, pictures = np.zeros((0, 3), np.float32), two_views([0.1, 0.1])[2]
    colors, unseen = vertex_colors(nothing, nothing, pictures)
    assert colors.shape == (0, 3) and unseen == 0
    assert vertex_thickness(nothing, nothing, pictures).shape == (0,)
