"""Cleaning, holes, decimation, borders: the size asked for, the shape kept, no broken triangle and no flap left."""

import numpy as np
import open3d as o3d
import pytest
from mesh_samples import (
    arrays,
    border_vertices,
    edges_and_uses,
    face_normals,
    sheet,
    sheet_points,
    slivered_sphere,
    sphere,
    volume,
)
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from splat2mesh.scene.mesh import vertex_normals
from splat2mesh.surface.clean import SMALLEST_COMPONENT, drop_small_components, fill_holes, trim_borders
from splat2mesh.surface.decimate import decimate


def edge_uses(faces):
    return edges_and_uses(faces)[1]


@pytest.mark.parametrize("wanted", [200, 1000, 5000])
def test_decimation_reaches_its_target_and_keeps_the_sphere(wanted):
    vertices, faces = decimate(*arrays(sphere()), wanted)
    assert vertices.dtype == np.float64 and faces.dtype == np.int32
    assert 0.9 * wanted <= len(vertices) <= 1.05 * wanted
    # A triangle inscribed in the unit sphere, on n vertices, sags by about 2.4 / n; quadrics put half of it outside.
    radius = np.linalg.norm(vertices, axis=1)
    assert np.abs(radius - 1).max() < 5 / wanted + 0.002  # 0.002: the mesh to be decimated sags itself
    volume = np.einsum("ij,ij->i", vertices[faces[:, 0]], face_normals(vertices, faces)).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi, rel=20 / wanted + 0.005)


def test_the_result_is_closed_clean_and_its_normals_point_outward():
    vertices, faces = decimate(*arrays(sphere()), 1000)
    normals = vertex_normals(vertices, faces)
    np.testing.assert_array_equal(edge_uses(faces), 2)
    assert len(vertices) - 3 * len(faces) // 2 + len(faces) == 2
    np.testing.assert_array_equal(np.unique(faces), np.arange(len(vertices)))
    assert (np.diff(np.sort(faces, axis=1), axis=1) > 0).all()  # three different corners
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)
    assert (np.linalg.norm(face_normals(vertices, faces), axis=1) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
    outward = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    # Triangles are about 0.12 wide on a sphere of radius one: normals stray by a fraction of that angle.
    assert (normals * outward).sum(axis=1).min() > np.cos(0.12)


def test_a_mesh_small_enough_keeps_its_vertices():
    mesh = sphere(resolution=20)
    before, triangles = arrays(mesh)
    vertices, faces = decimate(before, triangles, len(before))
    np.testing.assert_array_equal(vertices, before)
    np.testing.assert_array_equal(faces, triangles)
    vertices[:] = 0.0  # its own copy
    assert before.any()


@pytest.mark.parametrize(("scale", "center"), [(1e-3, (0, 0, 0)), (1e3, (0, 0, 0)), (1.0, (1e3, -1e3, 1e3))])
def test_decimation_does_not_depend_on_unit_or_place(scale, center):
    vertices, faces = decimate(*arrays(sphere(scale, center)), 1000)
    local = (vertices - center) / scale
    np.testing.assert_allclose(np.linalg.norm(local, axis=1), 1.0, atol=0.007)  # 5 / wanted + 0.002, as above
    assert (np.einsum("ij,ij->i", vertex_normals(vertices, faces), local) > 0.9).all()
    assert 900 <= len(vertices) <= 1050 and (edge_uses(faces) == 2).all()


def test_slivers_do_not_keep_decimation_from_its_target():
    vertices, faces = decimate(*slivered_sphere(), 1000)
    assert 900 <= len(vertices) <= 1050 and edge_uses(faces).max() == 2
    assert np.abs(np.linalg.norm(vertices, axis=1) - 1).max() < 0.02
    # What slivers tear open where non-manifold edges go are small holes, and these are closed.
    _, filled, count = fill_holes(vertices, faces, 1.0)
    assert count > 10
    np.testing.assert_array_equal(edge_uses(filled), 2)


def test_edges_with_three_faces_and_degenerate_faces_are_removed():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
    fin = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [2, 2, 3], [0, 1, 2]])
    vertices, faces = decimate(points, fin, 100)
    assert len(faces) == 2
    assert edge_uses(faces).max() <= 2
    np.testing.assert_array_equal(np.unique(faces), np.arange(len(vertices)))


def test_small_components_are_dropped_and_counted():
    large = sphere()
    mesh = sphere()
    limit = SMALLEST_COMPONENT * len(large.triangles)
    small = [sphere(0.1, (3 + k, 0, 0), resolution=5) for k in range(4)]
    enough = sphere(0.3, (0, 5, 0), resolution=12)
    assert len(small[0].triangles) < limit <= len(enough.triangles)
    for part in (*small, enough):
        mesh += part
    assert drop_small_components(mesh) == 4
    assert len(mesh.triangles) == len(large.triangles) + len(enough.triangles)
    assert len(mesh.vertices) == len(large.vertices) + len(enough.vertices)
    assert np.asarray(mesh.vertices)[:, 0].max() < 1.01
    assert drop_small_components(mesh) == 0


def test_an_empty_mesh_stays_empty():
    mesh = o3d.geometry.TriangleMesh()
    assert drop_small_components(mesh) == 0
    vertices, faces = decimate(*arrays(mesh), 1000)
    assert vertices.shape == faces.shape == vertex_normals(vertices, faces).shape == (0, 3)
    assert trim_borders(faces, np.zeros(0, bool)).shape == (0, 3)
    points, faces, filled = fill_holes(vertices, faces, 1.0)
    assert points.shape == faces.shape == (0, 3) and filled == 0


def test_vertex_normals_are_the_mean_of_the_faces_by_area():
    vertices, faces = decimate(*arrays(sphere()), 300)
    vertices = vertices + np.random.default_rng(0).normal(0, 0.05, vertices.shape)
    expected = np.zeros_like(vertices)
    for face, normal in zip(faces, face_normals(vertices, faces), strict=True):  # as long as twice the area
        expected[face] += normal
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    found = vertex_normals(vertices, faces)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=1e-6)


# -- holes


def test_small_holes_are_closed_and_large_ones_stay_open():
    points, whole = decimate(*arrays(sphere()), 2000)
    middles = points[whole].mean(axis=1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    # Three holes, as caps of these angles: their borders are about 2 pi sin(angle) long, and jagged.
    faces = whole
    for axis, angle in (([1, 0, 0], 0.1), ([0, 1, 0], 0.2), ([0, 0, 1], 0.6)):
        faces = faces[middles[: len(faces)] @ axis < np.cos(angle)]
        middles = middles[middles @ axis < np.cos(angle)]
    filled_points, filled, count = fill_holes(points, faces, 2.5)
    assert count == 2 and len(filled_points) == len(points) + 2 and filled.dtype == faces.dtype
    np.testing.assert_array_equal(filled_points[: len(points)], points)
    np.testing.assert_array_equal(filled[: len(faces)], faces)
    assert edge_uses(filled).max() == 2 and (points[border_vertices(filled, len(points))][:, 2] > 0.7).all()
    assert (filled_points[border_vertices(filled, len(filled_points))][:, 2] > 0.7).all()
    # With all closed it is the sphere, facing outwards: the caps are flat now, and small.
    everything_points, everything, count = fill_holes(points, faces, 10.0)
    assert count == 3
    np.testing.assert_array_equal(edge_uses(everything), 2)
    cap = np.pi / 3 * (1 - np.cos(0.6)) ** 2 * (2 + np.cos(0.6))
    assert volume(everything_points, everything) == pytest.approx(volume(points, whole) - cap, rel=0.02)
    np.testing.assert_array_equal(fill_holes(points, whole, 10.0)[1], whole)


def test_holes_that_touch_in_a_vertex_are_closed_each():
    points, faces = sheet_points(10, 10), sheet(10, 10)
    squares = [(3, 3), (4, 4), (5, 3)]  # neighbours across a corner, not across an edge
    gone = [y * 9 + x for x, y in squares]
    holed = np.delete(faces, [*gone, *(81 + square for square in gone)], axis=0)
    filled_points, filled, count = fill_holes(points, holed, 5.0)
    assert count == 3 and len(filled) == len(holed) + 3 * 4
    np.testing.assert_allclose(np.sort(filled_points[100:], axis=0), [[3.5, 3.5, 0], [4.5, 3.5, 0], [5.5, 4.5, 0]])
    # Flat, without overlap, and only the outer border is left.
    areas = face_normals(filled_points, filled)[:, 2] / 2
    assert (areas > 0).all() and areas.sum() == pytest.approx(81)
    assert border_vertices(filled, 103).sum() == 36


# -- ragged borders


def trimmed_by_regions(faces, seen):
    """Said another way: unseen regions that touch the border go, with every face that touches them."""
    count = len(seen)
    start, end = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    dark = ~seen[start] & ~seen[end]
    graph = coo_array((np.ones(dark.sum()), (start[dark], end[dark])), (count, count))
    region = connected_components(graph, directed=False)[1]
    outer = np.unique(region[border_vertices(faces, count) & ~seen])
    return faces[~(np.isin(region, outer) & ~seen)[faces].any(axis=1)]


def test_a_flap_goes_and_an_island_stays():
    columns, rows = 12, 10
    faces, seen = sheet(columns, rows), np.ones((rows, columns), bool)
    seen[3:5, 9:] = False  # a flap at the right border
    seen[6:8, 4:6] = False  # an island
    seen[0, 0] = False  # a corner
    kept = trim_borders(faces, seen.ravel())
    used = np.isin(np.arange(rows * columns), kept).reshape(rows, columns)
    expected = np.ones((rows, columns), bool)
    expected[3:5, 9:] = expected[0, 0] = False
    np.testing.assert_array_equal(used, expected)
    # What touches the flap goes, 4 x 3 squares less the two of their corner triangles that do not; of the corner's
    # square both triangles touch it.
    assert len(faces) - len(kept) == (~expected.ravel())[faces].any(axis=1).sum()


@pytest.mark.parametrize("seed", range(4))
def test_trimming_takes_unseen_regions_at_borders_and_nothing_else(seed):
    rng = np.random.default_rng(seed)
    vertices, faces = decimate(*arrays(sphere()), 2000)
    faces = rng.permutation(faces[vertices[faces].mean(axis=1)[:, 2] < 0.5])  # open at the top, in any order
    waves = np.sin(vertices @ rng.normal(0, 6, (3, 4)) + rng.uniform(0, 6, 4)).sum(axis=1)
    seen = waves > -0.5  # patches
    kept, expected = trim_borders(faces, seen), trimmed_by_regions(faces, seen)
    assert len(kept) < len(faces) and (~seen[kept]).any()  # flaps there were, and islands there are
    np.testing.assert_array_equal(kept, expected)  # in their order
    border = border_vertices(kept, len(vertices))
    assert border.any() and seen[border].all()
    np.testing.assert_array_equal(trim_borders(kept, seen), kept)


def test_unseen_flaps_of_any_depth_go_entirely_and_seen_ones_stay():
    faces = sheet(60, 4)
    assert trim_borders(faces, np.zeros(240, bool)).shape == (0, 3)
    seen = np.zeros((4, 60), bool)
    seen[:, :5] = True
    assert len(trim_borders(faces, seen.ravel())) == len(sheet(5, 4))
    np.testing.assert_array_equal(trim_borders(faces, np.ones(240, bool)), faces)


def test_what_is_closed_has_no_border_to_trim():
    vertices, faces = decimate(*arrays(sphere()), 500)
    np.testing.assert_array_equal(trim_borders(faces, np.zeros(len(vertices), bool)), faces)
