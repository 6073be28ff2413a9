"""The far background: found where there is one and nowhere else, cut without a trace, or kept as a shell around."""

from dataclasses import replace

import numpy as np
import open3d as o3d
import pytest
from disc_splats import discs, plain
from generated import scene
from scipy.spatial import cKDTree

from scenes.cameras import FLIP
from splat2mesh import convert
from splat2mesh.api import plan_mesh as plan
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.foreground import COARSER, LEAST_SHARE, RADII, SOLID, far_background
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.background import EYES, views_from_within
from splat2mesh.surface.extract import EFFORTS, Effort, extract
from splat2mesh.surface.solid import BACKGROUND_SHARE
from splat2mesh.views.viewpoints import bounds_of, even_directions

VERTICES, DOME, RADIUS, COLOR = 2000, 600, 8.0, 0.75


def joined(*parts):
    names = ("means", "scales", "quats_wxyz", "opacities", "sh")
    return Splats(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def ball(radius=1.0, count=3000, scale=0.05, opacity=0.9):
    """Round splats spread over a sphere."""
    return plain(radius * even_directions(count), scale, opacity)


def moved(splats, scale, shift):
    return Splats(scale * splats.means + shift, scale * splats.scales, splats.quats_wxyz, splats.opacities, splats.sh)


def only_last(splats, count):
    return np.arange(len(splats)) >= len(splats) - count


# -- which splats


@pytest.mark.parametrize(("kind", "count"), [("object", 20_000), ("tabletop", 30_000), ("room", 40_000)])
def test_what_is_all_near_has_no_background(kind, count):
    assert not far_background(scene(kind, count)[2]).any()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_a_dome_is_found_exactly_in_any_unit_place_and_order(scale):
    rng = np.random.default_rng(0)
    # Of any size between 4 and 40 radii away, with gaps, and splats too faint to be counted that belong to it.
    far = even_directions(900) * rng.uniform(4.2, 40, (900, 1))
    splats = joined(ball(), plain(far, rng.uniform(0.2, 2, (900, 3)), np.where(np.arange(900) % 3, 0.9, SOLID / 2)))
    order = rng.permutation(len(splats))
    splats = moved(splats, scale, scale * np.array([7.0, -3.0, 20.0])).take(order)
    np.testing.assert_array_equal(far_background(splats), order >= 3000)


@pytest.mark.parametrize(("radii", "found"), [(0.95 * RADII, False), (1.05 * RADII, True)])
def test_background_begins_some_radii_away(radii, found):
    # All detail lies on the unit sphere, so half of it within radius one.
    splats = joined(ball(), ball(radii, 300, 0.5))
    np.testing.assert_array_equal(far_background(splats), only_last(splats, 300) & found)


@pytest.mark.parametrize(("coarser", "found"), [(1.0, False), (0.95 * COARSER, False), (1.05 * COARSER, True)])
def test_the_far_end_of_a_long_object_is_background_only_where_it_is_coarse(coarser, found):
    body, neck = ball(), np.zeros((400, 3))
    neck[:, 0] = np.linspace(1.0, 6.0, 400)
    scale = np.where(neck[:, :1] > RADII + 0.1, coarser * 0.05, 0.05)
    splats = joined(body, plain(neck, scale))
    far = far_background(splats)
    assert far.any() == found
    if found:
        assert not far[:3000].any() and (np.flatnonzero(far[3000:]) >= np.searchsorted(neck[:, 0], RADII - 0.2)).all()
        assert far[3000:][neck[:, 0] > RADII + 0.2].all()


def test_a_few_floaters_are_no_background():
    least = int(np.ceil(3000 * LEAST_SHARE / (1 - LEAST_SHARE)))  # of all, themselves included
    for count in (0, 1, least - 1, least):
        splats = joined(ball(), ball(10.0, count, 0.5) if count else ball().take(slice(0)))
        np.testing.assert_array_equal(far_background(splats), only_last(splats, count) & (count == least))


def test_fog_far_away_is_no_background():
    assert not far_background(joined(ball(), ball(10.0, 1000, 0.5, opacity=0.9 * SOLID))).any()
    assert not far_background(ball(opacity=0.9 * SOLID)).any()
    assert not far_background(ball(count=50)).any()
    assert far_background(ball().take(slice(0))).shape == (0,)


def test_splats_without_size_do_no_harm():
    grains = joined(plain(even_directions(500), 0.0), ball(), ball(10.0, 300, 0.5))
    np.testing.assert_array_equal(far_background(grains), only_last(grains, 300))


# -- views from within


@pytest.mark.parametrize("up", [(0, -1, 0), (0, 0, 1), (0.48, -0.64, 0.6)])
def test_views_from_within_see_all_around_from_the_middle(up):
    box = np.random.default_rng(0).uniform([-27, 8, -12], [33, 14, 15], (2000, 3))
    splats, up = plain(box, 0.5), np.array(up, float)
    views = views_from_within(splats, 96, up)
    assert len(views) == 6 * EYES and all(view.width == view.height == 96 for view in views)
    low, high = bounds_of(splats)
    eyes = np.unique(np.round([view.center for view in views], 6), axis=0)
    assert len(eyes) == EYES
    assert (np.abs(eyes - (low + high) / 2) < 0.3 * (high - low)).all()
    # Every direction from every eye is in a picture, well inside one of them.
    directions = even_directions(500)
    for eye in eyes:
        shown = np.zeros(500, bool)
        for view in views:
            if np.allclose(view.center, eye, atol=1e-5):
                pixels, depth = view.project(view.center + directions)
                shown |= (depth > 0) & ((pixels > 1) & (pixels < 95)).all(axis=1)
        assert shown.all()
    # Level ones hold up upwards: rows count downwards.
    level = [view for view in views if abs(view.forward @ up) < 1e-6]
    assert len(level) == 4 * EYES
    for view in level:
        np.testing.assert_allclose(view.camera_from_world[1, :3], -up, atol=1e-9)


# -- conversion


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """An object alone, and under a dome of coarse discs: alone.ply, dome.ply."""
    folder = tmp_path_factory.mktemp("dome")
    alone = scene("object")[2]
    normals, wide = even_directions(DOME), 0.7 * RADIUS * np.sqrt(4 * np.pi / DOME)
    dome = discs(RADIUS * normals + alone.means.mean(axis=0), normals, wide, 0.02)
    dome = Splats(
        dome.means, dome.scales, dome.quats_wxyz, dome.opacities, dome.sh + np.float32((COLOR - 0.5) * 3.5449)
    )
    write_inria_ply(folder / "alone.ply", alone)
    write_inria_ply(folder / "dome.ply", joined(alone, dome))
    return folder


@pytest.fixture(scope="module")
def converted(files):
    """The object alone; the object under its dome, cut, and kept; the warnings of the cut."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EFFORTS, "draft", Effort(views=12, pixels=96, cells=80))
        settings = {"detail": "draft", "vertices": VERTICES}
        found = {"alone": convert(files / "alone.ply", **settings)}
        with pytest.warns(DataWarning) as found["warnings"]:
            found["cut"] = convert(files / "dome.ply", **settings)
        found["keep"] = convert(files / "dome.ply", background="keep", **settings)
    return found


def voxel(mesh):
    return np.linalg.norm(np.ptp(mesh.bounds, axis=0)) / 80


@pytest.mark.slow
def test_cutting_leaves_what_the_foreground_alone_gives_and_says_so(converted):
    alone, cut = converted["alone"], converted["cut"]
    (warning,) = converted["warnings"]
    assert f"{DOME} of {20_000 - alone.statistics['splats_invisible'] + DOME} splats" in str(warning.message)
    assert "`background` keep" in str(warning.message)
    assert cut.settings["background"] == "cut" and cut.statistics["splats_background"] == DOME
    assert alone.statistics["splats_background"] == 0
    # Splats stand in another order, so sums are rounded differently; more, only where a choice was that close.
    assert len(cut.vertices) == pytest.approx(len(alone.vertices), rel=0.01)
    for first, second in ((cut, alone), (alone, cut)):
        distance, nearest = cKDTree(first.vertices).query(second.vertices)
        assert np.percentile(distance, 95) < 0.01 * voxel(alone) and distance.max() < 2 * voxel(alone)
        apart = np.abs(first.colors_srgb[nearest].astype(int) - second.colors_srgb).max(axis=1)
        assert np.percentile(apart, 95) <= 1
    for name in ("eye", "target"):
        np.testing.assert_allclose(cut.preview_camera[name], alone.preview_camera[name], atol=1e-5)


def test_keeping_adds_a_shell_at_the_dome_that_faces_inwards(converted):
    alone, kept = converted["alone"], converted["keep"]
    assert kept.settings["background"] == "keep" and kept.statistics["splats_background"] == DOME
    assert kept.statistics["views"] == alone.statistics["views"] + 6 * EYES
    local = kept.vertices - scene("object")[2].means.mean(axis=0) * FLIP
    radius = np.linalg.norm(local, axis=1)
    shell = radius > RADIUS / 2
    # Discs are flat, so they lie within the sphere through their middles, and before it by what training adds.
    assert (radius[shell] > 0.9 * RADIUS).all() and (radius[shell] < RADIUS).all()
    outward = local[shell] / radius[shell, None]
    assert ((kept.normals[shell] * outward).sum(axis=1) < -0.95).all()
    # All around: no direction is farther than a few triangles from a vertex.
    gap = 2 * np.degrees(np.arcsin(cKDTree(outward).query(even_directions(2000))[0] / 2))
    assert gap.max() < 25
    assert shell.sum() == pytest.approx(BACKGROUND_SHARE * VERTICES, rel=0.15)
    assert (np.abs(kept.colors_srgb[shell] / 255 - COLOR) < 0.02).all()
    # No triangle spans the gap, every vertex is used, and the object inside is the one without a dome.
    assert (shell[kept.faces].all(axis=1) | ~shell[kept.faces].any(axis=1)).all()
    np.testing.assert_array_equal(np.unique(kept.faces), np.arange(len(kept.vertices)))
    distance = cKDTree(alone.vertices).query(kept.vertices[~shell])[0]
    assert distance.max() < 3 * voxel(alone) and np.median(distance) < voxel(alone)  # fewer vertices: others
    assert kept.preview_camera == converted["cut"].preview_camera


def quietly_emptied(way, look, effort, vertices, stages):
    """In place of `extract`: a surface for the foreground, an open one that nobody saw for a background."""
    mesh, pictures = extract(way, look, effort, vertices, stages)
    if len(look.splats) == DOME:
        mesh = o3d.geometry.TriangleMesh.create_sphere(RADIUS)
        pictures = [replace(each, depth=np.full_like(each.depth, np.nan)) for each in pictures]
        mesh.remove_triangles_by_index(range(len(mesh.triangles) // 2))
    return mesh, pictures


def test_a_background_without_a_surface_leaves_the_foreground_as_it_is(files, converted, monkeypatch):
    monkeypatch.setitem(EFFORTS, "draft", Effort(views=12, pixels=96, cells=80))
    monkeypatch.setattr("splat2mesh.surface.solid.extract", quietly_emptied)
    found = convert(files / "dome.ply", detail="draft", vertices=VERTICES, background="keep")
    np.testing.assert_array_equal(np.unique(found.faces), np.arange(len(found.vertices)))
    assert np.linalg.norm(np.ptp(found.bounds, axis=0)) < RADIUS


def test_the_plan_counts_the_background_and_measures_the_foreground(files):
    with_dome, alone = (plan(files / name, detail="draft") for name in ("dome.ply", "alone.ply"))
    assert with_dome["splats_background"] == DOME and alone["splats_background"] == 0
    assert with_dome["splats"] == alone["splats"] + DOME and with_dome["background"] == "cut"
    np.testing.assert_array_equal(with_dome["bounds_in_splat_frame"], alone["bounds_in_splat_frame"])
    assert with_dome["training_pixel"] == alone["training_pixel"]
    with pytest.raises(InputError, match="`background` drop: expected one of cut keep"):
        plan(files / "dome.ply", background="drop")
