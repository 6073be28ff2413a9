"""From splats to a raw surface, both ways: near the truth of generated scenes, and facing outwards."""

import numpy as np
import open3d as o3d
import pytest
from disc_splats import discs, plain
from generated import UP, caster, dilated_splats, scene, seen_points

from scenes import capture_views
from scenes.cameras import FLIP
from splat2mesh.base.choices import SURFACE_CHOICES
from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Stages
from splat2mesh.render.view import View
from splat2mesh.surface.extract import (
    EFFORTS,
    SCALES_PER_PIXEL,
    TRAINING_DILATION,
    Effort,
    Look,
    as_trained,
    dilated,
    extract,
    merged_look,
    training_pixel,
)
from splat2mesh.views.viewpoints import even_directions, virtual_views

SMALL = Effort(views=24, pixels=128, cells=128)


def raw_surface(way, kind, count):
    """Vertices and faces of the raw surface in the scene frame, its pictures, and the size of a training pixel."""
    pixel, splats = training_pixel(scene(kind, count)[2]), dilated_splats(kind, count)
    views = capture_views(scene(kind, count)[0], SMALL.views, SMALL.pixels)
    mesh, pictures = extract(way, Look.around(splats, pixel, views), SMALL, 3000, Stages())
    return np.asarray(mesh.vertices) * FLIP, np.asarray(mesh.triangles), pictures, pixel


def distances(tracer, points):
    return tracer.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()


def caster_of(vertices, faces):
    tracer = o3d.t.geometry.RaycastingScene()
    tracer.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
    return tracer


@pytest.mark.parametrize("way", SURFACE_CHOICES)
def test_an_object_comes_back_to_a_fraction_of_a_training_pixel(way):
    truth, seen, _ = scene("object")
    vertices, faces, pictures, pixel = raw_surface(way, "object", 20_000)
    points, normals = seen_points(truth, seen)
    # Training fits photos, so nothing finer than its pixel is to be had; most is, for many Gaussians average.
    for error in (distances(caster(truth), vertices), distances(caster_of(vertices, faces), points)):
        assert np.median(error) < 0.4 * pixel and np.percentile(error, 99) < pixel
    # Faces look outwards: the nearest face's normal agrees with the truth's.
    found = caster_of(vertices, faces).compute_closest_points(o3d.core.Tensor(points.astype(np.float32)))
    cosine = (found["primitive_normals"].numpy() * normals).sum(axis=1)
    assert np.median(cosine) > 0.97 and (cosine > 0).mean() > 0.99
    assert len(pictures) == SMALL.views
    for picture in pictures:
        assert picture.color.shape == (*picture.depth.shape, 3) and picture.thickness.shape == picture.depth.shape
        known = np.isfinite(picture.thickness)
        np.testing.assert_array_equal(known, np.isfinite(picture.depth))
        assert (picture.thickness[known] > 0).all()
    # Of the order of a training pixel, the thickness that generated splats have; without a field, exactly that.
    thickness = np.concatenate([picture.thickness[np.isfinite(picture.thickness)] for picture in pictures])
    assert 0.5 * pixel < np.median(thickness) < 2 * pixel if way == "field" else (thickness == np.float32(pixel)).all()


def test_gaussians_finer_than_the_views_are_merged_and_the_surface_stays():
    """40,000 Gaussians for 4,608 pixels of the surface at half a one each: eight become one, in any order of rows."""
    truth, pixel = scene("object", 40_000)[0], training_pixel(scene("object", 40_000)[2])
    splats = dilated_splats("object", 40_000)
    shuffled = splats.take(np.random.default_rng(0).permutation(len(splats)))
    look = Look.around(shuffled, pixel, capture_views(truth, SMALL.views, 56))
    few = merged_look(look)
    assert len(few.splats) == len(splats) // 8 and few.views is look.views
    assert merged_look(look._replace(splats=splats.take(slice(0, 9000)))).splats.means.shape == (9000, 3)
    # Centres of Gaussians scatter about the surface, and means of neighbours lie a little inside a curved one.
    all_off, few_off = (
        np.percentile(distances(caster(truth), each.means * FLIP), [50, 95]) for each in (splats, few.splats)
    )
    assert (few_off < all_off * [1.5, 1.2]).all()


@pytest.mark.parametrize("way", SURFACE_CHOICES)
def test_a_tabletop_comes_back_where_it_was_seen(way):
    truth, seen, _ = scene("tabletop", 30_000)
    vertices, faces, _, pixel = raw_surface(way, "tabletop", 30_000)
    voxel = np.linalg.norm(np.ptp(truth.vertices, axis=0)) / SMALL.cells
    to_truth = distances(caster(truth), vertices)
    to_found = distances(caster_of(vertices, faces), seen_points(truth, seen)[0])
    # Few small views: what stands close together is joined, and undersides stay open. The rest is as good as above.
    assert np.median(to_truth) < pixel and np.median(to_found) < pixel
    assert (to_truth < voxel).mean() > 0.8 and (to_found < voxel).mean() > 0.8


def test_the_training_pixel_is_read_off_the_smallest_solid_gaussians():
    rng = np.random.default_rng(0)
    long = rng.permutation(np.linspace(0.1, 1.1, 1001))
    solid = plain(np.zeros((1001, 3)), np.stack([long, 0.5 * long, 0.01 * long], axis=1), opacity=0.9)
    assert training_pixel(solid) == pytest.approx(0.2 / SCALES_PER_PIXEL, rel=1e-5)  # the tenth percentile is 0.2
    opacities = np.where(long < 0.6, 0.1, 0.9)  # the faint half does not count
    mixed = plain(np.zeros((1001, 3)), solid.scales, opacity=opacities)
    assert training_pixel(mixed) == pytest.approx((0.6 + 0.1 * 0.5) / SCALES_PER_PIXEL, rel=0.01)
    faint = plain(np.zeros((1001, 3)), solid.scales, opacity=0.2)  # but where all are faint, all do
    assert training_pixel(faint) == training_pixel(solid)


def test_dilation_adds_the_variance_of_the_training_pixel():
    splats = scene("object")[2]
    wide = dilated(splats, 0.05)
    np.testing.assert_allclose(wide.scales**2 - splats.scales**2, TRAINING_DILATION * 0.05**2, rtol=1e-3)
    assert wide.scales.dtype == np.float32
    np.testing.assert_array_equal(dilated(splats, 0.0).scales, splats.scales)
    for name in ("means", "quats_wxyz", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(wide, name), getattr(splats, name))


def test_splats_as_trained_are_dilated_by_their_own_pixel():
    splats = scene("object")[2]
    shown, pixel = as_trained(splats)
    assert pixel == training_pixel(splats)
    np.testing.assert_array_equal(shown.scales, dilated(splats, pixel).scales)
    np.testing.assert_array_equal(shown.means, splats.means)


@pytest.mark.parametrize("thickness", [0.003, 0.01])
def test_thickness_is_that_of_the_surface_whichever_way_it_is_looked_at(thickness):
    x, y = (part.ravel() for part in np.meshgrid(np.arange(-1.5, 1.5, 0.05), np.arange(-1.5, 1.5, 0.05)))
    points = np.stack([x, y, 0 * x], axis=1)
    splats = discs(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), 0.05, thickness)
    found = []
    for angle in np.radians([0, 30, 60]):
        eye = 5 * np.array([np.sin(angle), 0, np.cos(angle)])
        look = Look.around(splats, 0.05, [View.look_at(eye, [0, 0, 0], UP, 15.0, 64)])
        (picture,) = extract("field", look, SMALL, 100, Stages())[1]
        found.append(np.nanmedian(picture.thickness))
    # Between the opacities 0.2 and 0.6 of a stack of Gaussians: a part of their standard deviation.
    np.testing.assert_allclose(found, found[0], rtol=0.15)
    assert 0.3 * thickness < found[0] < 2 * thickness


@pytest.mark.parametrize("way", SURFACE_CHOICES)
def test_nothing_solid_is_refused(way):
    fog = plain(np.random.default_rng(0).normal(size=(500, 3)), 0.05, opacity=0.02)
    ball = discs(even_directions(2000), even_directions(2000), 0.06, 1e-3)
    views = virtual_views(ball, 4, 64, UP)
    with pytest.raises(InputError, match="solid object"):
        extract(way, Look.around(fog, 0.01, views), SMALL, 3000, Stages())


def test_more_detail_means_more_work():
    draft, normal, fine = (EFFORTS[name] for name in ("draft", "normal", "fine"))
    for less, more in ((draft, normal), (normal, fine)):
        assert less.views < more.views and less.pixels < more.pixels
        assert less.cells <= more.cells and less.depth <= more.depth and less.points <= more.points
