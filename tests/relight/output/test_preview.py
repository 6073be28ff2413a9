"""relight.output.preview and relight.tonemap: where things appear in the picture, and with which value."""

import numpy as np
import open3d as o3d
import pytest

from relight.light.environment import Environment
from relight.light.tonemap import SHOULDER_START, auto_exposure, compress_highlights, tone_map
from relight.output import preview
from relight.output.preview import Preview, default_camera
from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

RED, GREEN, BLUE = np.eye(3)
FRONT = {"eye": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0], "fov_deg": 60.0}
BLACK = Environment(np.zeros((2, 4, 3)))


def render_preview(scene, radiance, environment, camera, width=960, height=720, exposure=1.0, samples=4):
    """One picture under one light."""
    return Preview(scene, camera, width, height, samples).render(radiance, environment, exposure)


def make_scene(vertices, faces):
    vertices = np.asarray(vertices, np.float32)
    normals = np.tile(np.float32([0, 0, 1]), (len(vertices), 1))
    return Scene([Mesh(vertices, normals, np.asarray(faces, np.int32), np.zeros(vertices.shape, np.uint8))])


def quads(*rectangles):
    """A scene of rectangles (x0, y0, x1, y1) in the plane z = 0, four vertices each."""
    vertices = [[x, y, 0] for x0, y0, x1, y1 in rectangles for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    faces = [[4 * k + a, 4 * k + b, 4 * k + c] for k in range(len(rectangles)) for a, b, c in ((0, 1, 2), (0, 2, 3))]
    return make_scene(vertices, faces)


def pixel_of(x, y, width, height):
    """Row and column of (x, y, 0) seen by FRONT: the picture is 10 tan(30 degrees) units wide there."""
    per_unit = width / (10 * np.tan(np.radians(30)))
    return int(height / 2 - y * per_unit), int(width / 2 + x * per_unit)


def srgb_bytes(linear):
    linear = np.asarray(linear, np.float64)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    return np.round(255 * encoded)


# ---------------------------------------------------------------------------------------------- tone map


def khronos_pbr_neutral(color, f90):
    """The published specification, one colour at a time; f90 > 0."""
    start, x = 0.8 - f90, min(color)
    fresnel = x - x * x / (4 * f90) if x <= 2 * f90 else f90
    color = np.asarray(color, np.float64) - fresnel
    peak = color.max()
    if peak <= start:
        return color
    new_peak = 1 - (1 - start) ** 2 / (peak + 1 - 2 * start)
    g = 1 / (0.15 * (peak - new_peak) + 1)
    return color * (new_peak / peak) * g + new_peak * (1 - g)


def test_highlights_follow_the_specification_in_the_limit_of_no_fresnel_reflection():
    colors = np.random.default_rng(1).exponential(2.0, (500, 3))
    expected = [khronos_pbr_neutral(color, 1e-9) for color in colors]
    np.testing.assert_allclose(compress_highlights(colors), expected, rtol=0, atol=2e-7)  # one float32 rounding of 1


def test_below_the_shoulder_nothing_changes():
    colors = np.random.default_rng(2).uniform(0, SHOULDER_START, (4, 5, 3)).astype(np.float32)
    np.testing.assert_array_equal(compress_highlights(colors), colors)
    np.testing.assert_array_equal(np.round(255 * tone_map(colors)), srgb_bytes(colors))


def test_brighter_light_is_never_shown_darker_and_stays_within_the_display():
    intensity = np.geomspace(1e-4, 1e6, 4000)
    for color in np.random.default_rng(3).dirichlet([0.5] * 3, 20):
        shown = tone_map(intensity[:, None] * color)
        assert shown.min() >= 0 and shown.max() <= 1
        # float32 values near 1 are 6e-8 apart.
        assert np.diff(shown, axis=0).min() >= -2e-7
    np.testing.assert_allclose(tone_map([1e6, 1e6, 0]), 1, atol=1e-4)  # the brightest colours end in white


def test_the_shoulder_starts_without_a_kink_and_keeps_the_hue():
    step = 1e-3
    below, at, above = compress_highlights((SHOULDER_START + step * np.array([[-1], [0], [1]])) * np.ones(3))[:, 0]
    # The hyperbola's second derivative is at most 2 / (1 - 0.8) = 10, so the slopes differ by 10 steps.
    assert abs((above - at) - (at - below)) < 11 * step**2
    shown = compress_highlights([3.0, 1.5, 0.75])
    assert (shown[1] - shown[2]) / (shown[0] - shown[2]) == pytest.approx((1.5 - 0.75) / (3.0 - 0.75), abs=1e-6)


def test_negative_light_is_black():
    np.testing.assert_array_equal(tone_map([[-0.2, -1.0, -1e-9]]), [[0, 0, 0]])


def test_auto_exposure_brings_the_bright_end_to_the_shoulder_whatever_the_unit():
    radiance = np.random.default_rng(4).exponential(1.0, (2000, 3)).astype(np.float32)
    exposure = auto_exposure(radiance)
    burning = np.mean((radiance * exposure).max(axis=1) > SHOULDER_START)
    assert burning == pytest.approx(0.02, abs=1 / 2000)
    assert auto_exposure(1000 * radiance) == pytest.approx(exposure / 1000, rel=1e-6)


def test_auto_exposure_withstands_a_few_suns_and_saturated_light():
    radiance = np.full((1000, 3), [0.1, 0.2, 0.5])
    assert auto_exposure(radiance) == pytest.approx(SHOULDER_START / 0.5)
    radiance[:15] = 1e5
    assert auto_exposure(radiance) == pytest.approx(SHOULDER_START / 0.5)
    assert auto_exposure(np.zeros((10, 3))) == 1.0


# ----------------------------------------------------------------------------------------------- picture


def test_left_right_top_and_both_sides_of_a_face():
    scene = quads((-2, -0.3, -1.4, 0.3), (1.4, -0.3, 2, 0.3), (-0.3, 1.2, 0.3, 1.8))
    radiance = 0.5 * np.repeat([RED, GREEN, BLUE], 4, axis=0)
    left, right, top = (pixel_of(x, y, 160, 120) for x, y in ((-1.7, 0), (1.7, 0), (0, 1.5)))
    bottom = pixel_of(0, -1.5, 160, 120)
    image = render_preview(scene, radiance, BLACK, FRONT, 160, 120)
    assert image.shape == (120, 160, 3) and image.dtype == np.uint8
    for pixel, color in ((left, RED), (right, GREEN), (top, BLUE), (bottom, [0, 0, 0])):
        np.testing.assert_array_equal(image[pixel], 188 * np.array(color))
    behind = render_preview(scene, radiance, BLACK, {**FRONT, "eye": [0, 0, -5]}, 160, 120)
    for pixel, color in ((left, GREEN), (right, RED), (top, BLUE), (bottom, [0, 0, 0])):
        np.testing.assert_array_equal(behind[pixel], 188 * np.array(color))


def test_radiance_is_interpolated_linearly_over_a_face():
    """Barycentric interpolation and centred sampling reproduce an affine field over the plane exactly."""
    scene = quads((-4, -3.5, 4, 3))
    x, y, _ = scene.vertices.T
    affine = np.array([0.4, 0.35, 0.4]) + np.outer(x, [0.06, 0.0, -0.08]) + np.outer(y, [0.01, -0.1, 0.02])
    image = render_preview(scene, affine, BLACK, FRONT, 64, 48, samples=5)
    unit = 10 * np.tan(np.radians(30)) / 64
    column, row = np.meshgrid((np.arange(64) + 0.5 - 32) * unit, (24 - np.arange(48) - 0.5) * unit)
    field = np.array([0.4, 0.35, 0.4]) + column[..., None] * [0.06, 0, -0.08] + row[..., None] * [0.01, -0.1, 0.02]
    # Float32 barycentric coordinates may tip a value that lies on the edge between two levels.
    assert np.abs(image - srgb_bytes(field)).max() <= 1
    assert np.mean(image == srgb_bytes(field)) > 0.99


def test_a_constant_sky_on_a_white_thing_is_one_value():
    scene = quads((-1, -1, 1.3, 0.7))
    sky = Environment(np.ones((4, 8, 3)))
    image = render_preview(scene, np.ones((4, 3)), sky, FRONT, 90, 70, exposure=0.5)
    assert np.unique(image).tolist() == [188]


def test_no_ray_slips_between_the_faces_of_a_closed_mesh():
    sphere = o3d.geometry.TriangleMesh.create_sphere(1.5, resolution=60)
    scene = make_scene(np.asarray(sphere.vertices), np.asarray(sphere.triangles))
    image = render_preview(
        scene, np.full((len(scene.vertices), 3), [0.5, 0, 0]), Environment(np.ones((2, 4, 3))), FRONT
    )
    unit = 10 * np.tan(np.radians(30)) / 960
    column, row = np.meshgrid((np.arange(960) + 0.5 - 480) * unit, (360 - np.arange(720) - 0.5) * unit)
    # A sphere of radius r at distance d fills tan(angle) < r / sqrt(d^2 - r^2); facets lie up to 0.2% inside.
    radius = 5 * 1.5 / np.sqrt(25 - 1.5**2)
    inside, outside = np.hypot(column, row) < 0.995 * radius, np.hypot(column, row) > 1.005 * radius
    assert np.all(image[inside] == [188, 0, 0]) and np.all(image[outside] == tone_bytes(1.0))


def tone_bytes(grey):
    return srgb_bytes(khronos_pbr_neutral([grey] * 3, 1e-9))


@pytest.mark.parametrize("rotation_deg", [0.0, 70.0])
@pytest.mark.parametrize("eye", [[0, 0, 5], [3, 2, -4], [-4, -1, 0.5]])
def test_one_lit_texel_appears_where_the_camera_projects_its_direction(eye, rotation_deg):
    """Direction from the convention's formulas, image position from a projection written out here."""
    camera = {**FRONT, "eye": eye}
    forward = -np.asarray(eye, float) / np.linalg.norm(eye)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward])
    scene = quads((100, 100, 101, 101))  # out of sight
    rng, seen = np.random.default_rng(6), 0
    for row, column in zip(rng.integers(40, 216, 200), rng.integers(0, 512, 200), strict=True):
        longitude, latitude = np.pi * (1 - 2 * (column + 0.5) / 512), np.pi * (0.5 - (row + 0.5) / 256)
        longitude += np.radians(rotation_deg)
        direction = [
            np.sin(longitude) * np.cos(latitude),
            np.sin(latitude),
            np.cos(longitude) * np.cos(latitude),
        ]
        x, y, depth = axes @ direction
        x, y = 80 + 80 * x / depth / np.tan(np.radians(30)), 60 + 80 * y / depth / np.tan(np.radians(30))
        if depth < 0 or not (5 < x < 155 and 5 < y < 115):
            continue
        seen += 1
        texels = np.zeros((256, 512, 3), np.float32)
        texels[row, column] = [0.7, 0.0, 0.0]
        light = Environment(texels).rotated(rotation_deg)
        image = render_preview(scene, np.zeros((4, 3)), light, camera, 160, 120)
        shown = image[..., 0].astype(float)
        assert shown.max() > 60 and not image[..., 1:].any()
        found_y, found_x = ((np.indices(shown.shape) + 0.5) * shown / shown.sum()).sum(axis=(1, 2))
        # A texel covers about 2 x 2 pixels, a few more and slanted towards the corners.
        assert abs(found_x - x) < 0.5 and abs(found_y - y) < 0.5
    assert seen >= 3


@pytest.mark.parametrize("samples", [1, 4, 7, 16])
def test_edges_show_the_share_of_the_pixel_that_is_covered(samples):
    """No two samples share a column or a row, so n samples err by at most one on an upright edge."""
    unit = 10 * np.tan(np.radians(30)) / 40
    for share in (0.23, 0.5, 0.81):
        scene = quads((-10, -10, share * unit, 10), (-10, -10, share * unit, 10))
        row = render_preview(scene, np.full((8, 3), 0.8), BLACK, FRONT, 40, 1, samples=samples)[0, :, 0]
        assert np.all(row[:20] == srgb_bytes(0.8)) and np.all(row[21:] == 0)
        shares = [srgb_bytes(0.8 * k / samples) for k in range(samples + 1)]
        covered = shares.index(row[20])
        assert abs(covered / samples - share) <= 1 / samples


def test_an_edge_before_a_sun_is_as_smooth_as_any():
    unit = 10 * np.tan(np.radians(30)) / 40
    scene = quads((-10, -10, 0.5 * unit, 10))
    sun = Environment(np.full((2, 4, 3), 1e4))
    row = render_preview(scene, np.zeros((4, 3)), sun, FRONT, 40, 1)[0, :, 0]
    assert np.all(row[:20] == 0) and row[20] == srgb_bytes(0.5) and np.all(row[21:] == 255)


def test_the_size_of_the_bands_changes_nothing(monkeypatch):
    rng = np.random.default_rng(8)
    scene, radiance = quads((-2, -1, 1, 1.5)), rng.uniform(0, 1, (4, 3))
    sky = Environment(rng.uniform(0, 2, (16, 32, 3)))
    whole = render_preview(scene, radiance, sky, FRONT, 61, 47)
    monkeypatch.setattr(preview, "BATCH_RAYS", 61 * 5)
    banded = render_preview(scene, radiance, sky, FRONT, 61, 47)
    assert len(Preview(scene, FRONT, 61, 47)._passes) == 10 * 4
    # A shifted principal point rounds differently in the last float bit, which may tip a level.
    assert np.abs(whole.astype(int) - banded).max() <= 1 and np.mean(whole == banded) > 0.999


def test_one_cast_serves_every_light():
    rng = np.random.default_rng(9)
    scene = quads((-2, -1, 1, 1.5))
    several = Preview(scene, FRONT, 61, 47)
    for exposure in (0.5, 2.0):
        radiance, sky = rng.uniform(0, 1, (4, 3)), Environment(rng.uniform(0, 2, (16, 32, 3)))
        once = render_preview(scene, radiance, sky, FRONT, 61, 47, exposure)
        np.testing.assert_array_equal(several.render(radiance, sky, exposure), once)


# ------------------------------------------------------------------------------------------------ camera


@pytest.mark.parametrize("size", [(160, 120), (60, 200), (300, 80)])
@pytest.mark.parametrize("stretch", [[1, 1, 1], [20, 0.1, 1], [0.01, 5, 3]])
def test_default_camera_just_holds_the_scene(size, stretch):
    vertices = np.random.default_rng(10).normal(size=(200, 3)) * stretch + [30, -7, 400]
    scene = make_scene(vertices, [[0, 1, 2]])
    width, height = size
    camera = default_camera(scene, width / height)
    view = Preview(scene, None, width, height, samples=1).view
    pixels, depth = view.project(scene.vertices)
    assert depth.min() > 0
    offset = np.abs(pixels / [width, height] * 2 - 1).max(axis=0)
    assert offset.max() == pytest.approx(1 / 1.15, rel=1e-6)  # the margin, on the axis that decides; float32 vertices
    toward_eye = np.subtract(camera["eye"], camera["target"])
    assert toward_eye[2] > 0 and toward_eye[1] > 0
    above, _ = view.project(np.array([np.add(camera["target"], [0, 0.01, 0]), camera["target"]]))
    assert above[0, 1] < above[1, 1]


def test_the_given_camera_wins_over_the_scenes_own_and_that_over_the_default():
    scene = quads((-1, -1, 1, 1))
    assert Preview(scene, None, 4, 3).camera == default_camera(scene, 4 / 3)
    scene.preview_camera = {**FRONT, "eye": [1, 2, 3]}
    assert Preview(scene, None, 4, 3).camera == scene.preview_camera
    assert Preview(scene, FRONT, 4, 3).camera == FRONT


@pytest.mark.parametrize(
    "change",
    [
        {"eye": [0, 0, 0]},
        {"eye": [0, 1]},
        {"up": [0, 0, 0]},
        {"fov_deg": 180},
        {"fov_deg": None},
        {"eye": [0, np.nan, 1]},
    ],
)
def test_an_impossible_camera_is_refused(change):
    with pytest.raises(InputError, match="a camera needs eye"):
        Preview(quads((-1, -1, 1, 1)), {**FRONT, **change})
    with pytest.raises(InputError, match="a camera needs eye"):
        Preview(quads((-1, -1, 1, 1)), {"eye": [0, 0, 1], "target": [0, 0, 0]})


@pytest.mark.parametrize("size", [(0, 10, 4), (10, 0, 4), (10, 10, 0)])
def test_an_empty_picture_is_refused(size):
    with pytest.raises(InputError, match="at least 1 x 1 pixels"):
        Preview(quads((-1, -1, 1, 1)), FRONT, *size)


def test_radiance_must_fit_the_scene():
    with pytest.raises(InputError, match=r"must have shape \(4, 3\)"):
        render_preview(quads((-1, -1, 1, 1)), np.ones((5, 3)), BLACK, FRONT, 8, 6)
