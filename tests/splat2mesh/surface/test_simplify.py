"""Decimation by a size field: closed stays closed, flat stays flat, borders stay, small cells keep vertices."""

import numpy as np
import open3d as o3d
import pytest

from splat2mesh.surface.simplify import LONGEST, simplify


def sphere():
    mesh = o3d.geometry.TriangleMesh.create_sphere(1.0, 60)
    return np.asarray(mesh.vertices).copy(), np.asarray(mesh.triangles).astype(np.int32)


def plane(count=41):
    grid = np.linspace(0, 1, count)
    x, z = np.meshgrid(grid, grid, indexing="ij")
    points = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1)
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    one = np.stack([corner, corner + 1, corner + count], axis=1)
    two = np.stack([corner + 1, corner + count + 1, corner + count], axis=1)
    return points, np.concatenate([one, two]).astype(np.int32)


def directed(faces):
    starts, ends = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    return set(zip(starts.tolist(), ends.tolist(), strict=True)), len(starts)


def test_a_closed_surface_stays_closed_and_near():
    points, faces = sphere()
    fewer, kept, sizes, _ = simplify(points, faces, np.full(len(points), 0.3), 700)
    edges, count = directed(kept)
    assert len(edges) == count and edges == {(b, a) for a, b in edges}
    assert len(fewer) == len(sizes) == 700 and len(kept) == 2 * 700 - 4
    assert np.abs(np.linalg.norm(fewer, axis=1) - 1).max() < 0.01
    a, b, c = (fewer[kept[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) > 0).all()


def test_flat_ground_keeps_its_border_its_area_and_short_edges():
    points, faces = plane()
    fewer, kept, *_ = simplify(points, faces, np.full(len(points), 1 / 40), 10)
    assert 10 < len(fewer) < len(points) / 3, "edges would outgrow the cells"
    assert np.abs(fewer[:, 1]).max() < 1e-9
    a, b, c = (fewer[kept[:, k]] for k in range(3))
    # The pull towards middles rounds the four corners off by a part of a cell each.
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(1.0, abs=2e-3)
    assert np.linalg.norm(a - b, axis=1).max() <= LONGEST / 40 + 1e-9


def test_small_cells_keep_their_vertices():
    points, faces = sphere()
    sizes = np.where(points[:, 0] > 0, 0.05, 0.5)
    fewer, *_ = simplify(points, faces, sizes, 2000)
    assert (fewer[:, 0] > 0).sum() > 3 * (fewer[:, 0] < 0).sum()


def test_the_same_again_and_nothing_to_do():
    points, faces = sphere()
    sizes = np.full(len(points), 0.3)
    first, again = simplify(points, faces, sizes, 500), simplify(points, faces, sizes, 500)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, other)
    same = simplify(points, faces, sizes, 10**6)
    assert len(same[0]) == len(points) and len(same[1]) == len(faces)
