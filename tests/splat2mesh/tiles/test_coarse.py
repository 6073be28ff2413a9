"""Coarse twins of tiles: few vertices, that hide what the tile hides, houses and trees alike."""

import numpy as np
import pytest

from scenes import shapes
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.mesh import Mesh, vertex_normals
from splat2mesh.surface.decimate import decimate
from splat2mesh.tiles.coarse import ALLOWED, FEW, TOTAL, coarse, merged_in_cells, twins

WANTED = 600


def joined(*solids):
    starts = np.cumsum([0, *(len(points) for points, _ in solids[:-1])])
    faces = [faces + start for (_, faces), start in zip(solids, starts, strict=True)]
    return np.concatenate([points for points, _ in solids]), np.concatenate(faces)


def houses():
    rng = np.random.default_rng(1)
    solids = []
    for x in range(3):
        for z in range(3):
            size = rng.uniform([4, 4, 4], [7, 12, 7])
            points, faces = shapes.rounded_box(tuple(size), 0.1, 0.35)
            solids.append((points + np.array([12 * x, size[1] / 2, 12 * z]), faces))
    return joined(*solids)


def needles():
    """Three crowns of a thousand loose slivers each."""
    rng = np.random.default_rng(2)
    tip = np.array([[0, 0, 0], [0.5, 0.1, 0], [0.1, 0.5, 0], [0, 0.1, 0.5]])
    middles = rng.normal(0, 1, (3, 1000, 3)) * [1.5, 2, 1.5] + np.array([[0, 5, 0], [8, 6, 2], [3, 5, 9]])[:, None]
    points = middles.reshape(-1, 1, 3) + tip @ np.linalg.qr(rng.normal(size=(3000, 3, 3)))[0]
    sides = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return points.reshape(-1, 3), (4 * np.arange(3000)[:, None, None] + sides).reshape(-1, 3)


def hidden(points, faces, rays):
    """The share of each bundle of rays that a mesh stops."""
    return RayCaster(points, faces).occluded(rays).mean(axis=1)


def sunlight(points):
    """30 bundles of 500 parallel rays through the space that points take up."""
    rng = np.random.default_rng(3)
    low, high = points.min(axis=0), points.max(axis=0)
    toward = rng.normal(size=(30, 1, 3)) * [1, 0.3, 1]
    toward /= np.linalg.norm(toward, axis=2, keepdims=True)
    start = rng.uniform(low, high, (30, 1, 3)) + rng.normal(0, 1.0, (30, 500, 3)) - 100 * toward
    return np.concatenate([start, np.broadcast_to(toward, start.shape)], axis=2).astype(np.float32)


@pytest.mark.parametrize(("made", "error"), [(houses, 0.02), (needles, 0.07)])
def test_a_twin_hides_what_the_tile_hides(made, error):
    points, faces = made()
    colors = np.random.default_rng(0).integers(0, 256, (len(points), 3), np.uint8)
    mesh = Mesh(points.astype(np.float32), vertex_normals(points, faces), faces.astype(np.int32), colors)
    twin = coarse(mesh, WANTED)
    assert len(mesh.vertices) > 8 * WANTED and 0 < len(twin.vertices) <= ALLOWED * WANTED
    rays = sunlight(points)
    expected = hidden(points, faces, rays)
    assert 0.2 < expected.mean() < 0.9
    assert np.abs(hidden(twin.vertices, twin.faces, rays) - expected).mean() < error
    np.testing.assert_allclose(np.linalg.norm(twin.normals, axis=1), 1, atol=1e-5)
    np.testing.assert_array_equal(coarse(mesh, WANTED).vertices, twin.vertices)


def test_decimation_alone_cannot_make_trees_coarse():
    points, faces = needles()
    left, sides = decimate(points, faces, WANTED)
    rays = sunlight(points)
    error = np.abs(hidden(left, sides, rays) - hidden(points, faces, rays)).mean()
    assert len(left) > ALLOWED * WANTED or error > 0.15


@pytest.mark.parametrize("wanted", [8, 100, 1000])
def test_merged_vertices_are_few_and_faces_keep_their_side(wanted):
    points, faces = shapes.blob(1.0, 0.0, np.random.default_rng(0), 0.05)
    found, kept = merged_in_cells(points + 1e3, faces, wanted)
    assert wanted / 4 < len(found) <= wanted and len(np.unique(kept)) == len(found)
    assert (np.sort(kept, axis=1)[:, :-1] < np.sort(kept, axis=1)[:, 1:]).all()
    a, b, c = (found[kept[:, corner]] - 1e3 for corner in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert 0.2 < volume / (4 / 3 * np.pi) < 1.0  # inscribed, and not inside out
    assert wanted < 1000 or volume > 0.95 * 4 / 3 * np.pi


def test_a_small_tile_is_its_own_twin():
    points, faces = shapes.blob(1.0, 0.0, np.random.default_rng(0), 0.3)
    normals = vertex_normals(points, faces)
    mesh = Mesh(points.astype(np.float32), normals, faces.astype(np.int32), np.zeros((len(points), 3), np.uint8))
    assert coarse(mesh, len(points)) is mesh
    assert twins(mesh, 1) == (mesh, None)


@pytest.mark.parametrize("tiles", [1, 60, 135, 4500])
def test_what_the_city_holds_of_a_tile_is_the_less_the_more_there_are(tiles):
    points, faces = houses()
    normals = vertex_normals(points, faces)
    mesh = Mesh(points.astype(np.float32), normals, faces.astype(np.int32), np.zeros((len(points), 3), np.uint8))
    far, distant = twins(mesh, tiles)
    assert FEW / 2 < len(far.vertices) <= ALLOWED * max(FEW, 0.06 * len(points))
    held = len((distant or far).vertices)
    assert tiles * held <= ALLOWED * max(TOTAL, 24 * tiles)
    assert (distant is None) == (tiles < 80)
