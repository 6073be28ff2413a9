"""The octree of a surface: cells of several sizes, and a mesh through them without a crack."""

import numpy as np
import pytest

from splat2mesh.surface.dualmesh import dual_mesh
from splat2mesh.surface.octree import BITS, HALF, corners_of, leaves_of

RADIUS = 20.3


def keys_of(level, cells):
    x, y, z = (np.asarray(cells, np.int64) + HALF).T
    return ((np.int64(level) << BITS | x) << BITS | y) << BITS | z


def requested(levels):
    """Cells around a sphere, of level levels[0] where x > -4 and of levels[1] where x < 4: there they overlap."""
    rng = np.random.default_rng(0)
    points = rng.standard_normal((60_000, 3))
    points *= RADIUS / np.linalg.norm(points, axis=1)[:, None]
    offsets = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 3)
    keys = []
    for level, here in zip(levels, (points[:, 0] > -4, points[:, 0] < 4), strict=True):
        cells = np.unique(np.floor(points[here] / 2**level).astype(np.int64), axis=0)
        keys.append(keys_of(level, (cells[:, None] + offsets).reshape(-1, 3)))
    return np.unique(np.concatenate(keys))


@pytest.fixture(scope="module", params=[(0, 0), (0, 1), (0, 2)])
def sphere(request):
    leaves = leaves_of(requested(request.param))
    corners = corners_of(leaves)
    values = (np.linalg.norm(corners.positions, axis=1) - RADIUS).astype(np.float32)
    return leaves, corners, values, dual_mesh(leaves, corners, values, np.ones_like(values), 0.5)


def test_leaves_do_not_overlap(sphere):
    leaves = sphere[0]
    levels = leaves >> (3 * BITS)
    cells = np.stack([(leaves >> (BITS * k) & ((1 << BITS) - 1)) - HALF for k in (2, 1, 0)], axis=1)
    by_level = {level: set(map(tuple, cells[levels == level])) for level in np.unique(levels)}
    for level in by_level:
        for coarser in range(level + 1, max(by_level) + 1):
            parents = set(map(tuple, np.array(sorted(by_level[level])) >> (coarser - level)))
            assert not parents & by_level.get(coarser, set())


def test_leaves_far_from_one_another_share_no_corner():
    cells = 9 * np.array([[i, j, -i] for i in range(-20, 20) for j in range(30)])
    leaves = np.sort(keys_of(0, cells))
    corners = corners_of(leaves)
    assert len(corners.positions) == len(np.unique(corners.positions, axis=0)) == 8 * len(leaves)
    places = {tuple(place) for place in (cells[:, None] + [0, 1, 1]).reshape(-1, 3).tolist()}
    assert {tuple(place) for place in corners.positions[corners.of_leaf[:, 3]].tolist()} == places


def test_the_mesh_is_closed_and_near_the_surface(sphere):
    vertices, faces, levels = sphere[3]
    starts, ends = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    edges = set(zip(starts.tolist(), ends.tolist(), strict=True))
    assert len(edges) == len(starts), "two faces run along an edge in the same direction"
    assert edges == {(b, a) for a, b in edges}, "an edge has one face only"
    # The mean of a cell's crossings lies within the cell: a sagitta below the sphere at most.
    error = np.abs(np.linalg.norm(vertices, axis=1) - RADIUS)
    assert (error < 0.2 * 2.0**levels).all()


def test_faces_look_outwards(sphere):
    vertices, faces, _ = sphere[3]
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) > -1e-9).all()


def test_corners_without_weight_take_no_part(sphere):
    leaves, corners, values, (_, faces, _) = sphere
    weights = (corners.positions[:, 1] > 0).astype(np.float32)
    vertices, fewer, _ = dual_mesh(leaves, corners, values, weights, 0.5)
    assert 0 < len(fewer) < len(faces)
    assert vertices[:, 1].min() > 0
