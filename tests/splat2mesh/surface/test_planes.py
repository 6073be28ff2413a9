"""Planes of bumpy walls, and which vertices take their normals; the walls are known exactly."""

import numpy as np
import pytest
from mesh_samples import arrays, sheet, sheet_points, sphere
from scipy.spatial.transform import Rotation

from splat2mesh.scene.mesh import vertex_normals
from splat2mesh.surface.patches import SeenPatches
from splat2mesh.surface.planes import LEAST_GAIN, SIGMAS, evened

SIDE = 0.12
"""Of the patches."""

HALF = np.array([2.0, 1.2, 1.5])
"""Half of the sides of a room about the origin."""

STEP, BUMPS = 0.04, 0.007
"""Edge of a mesh, and standard deviation of its heights: its normals scatter by 7 degrees."""


def plate(axis, way, heights, rng, bumps=BUMPS):
    """A bumpy side of the room, (points, faces), seen from within. heights: of places (V, 2) along the other axes, in
    order, into the room."""
    across = [other for other in range(3) if other != axis]
    counts = [round(2 * HALF[other] / STEP) + 1 for other in across]
    grid = sheet_points(*counts)[:, :2] * STEP - HALF[across]
    points = np.empty((len(grid), 3))
    points[:, across] = grid
    points[:, axis] = way * (HALF[axis] - heights(grid) - rng.normal(0, bumps, len(grid)))
    faces = sheet(*counts)
    inward = np.cross(*(points[faces[0, k]] - points[faces[0, 0]] for k in (1, 2)))[axis] * way < 0
    return points, faces if inward else faces[:, ::-1]


def joined(*parts):
    starts = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
    faces = np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=True)])
    return np.concatenate([points for points, _ in parts]), faces.astype(np.int32)


def flat(_):
    return 0.0


def room(rng, bumps=BUMPS, first=flat):
    """The six sides of the room; the one at low z has heights of its own."""
    sides = [(2, -1, first), (2, 1, flat), (0, -1, flat), (0, 1, flat), (1, -1, flat), (1, 1, flat)]
    return joined(*(plate(axis, way, heights, rng, bumps) for axis, way, heights in sides))


def areas_of(points, faces):
    corners = points[faces].astype(float)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.bincount(faces.ravel(), np.repeat(np.linalg.norm(crosses, axis=1), 3), len(points))


def even(points, faces, noise=BUMPS, side=SIDE):
    """Normals, and those for light where the surface is as thick as its noise."""
    normals, thickness = vertex_normals(points, faces), np.full(len(points), noise)
    patches = SeenPatches.of(points.astype(float), normals.astype(float), thickness, areas_of(points, faces), side)
    return normals, evened(points, normals, faces, thickness, patches)


def degrees(a, b):
    return np.degrees(np.arccos(np.clip((a.astype(float) * b).sum(axis=1), -1, 1)))


@pytest.fixture(scope="module")
def made():
    points, faces = room(np.random.default_rng(0))
    return points, faces, *even(points, faces)


def test_the_six_walls_are_found_under_their_bumps(made):
    planes = made[3].planes
    assert len(planes) == 6
    for axis in range(3):
        for way in (-1, 1):
            (wall,) = [each for each in planes if each.normal[axis] * way < -0.9]
            assert wall.offset == pytest.approx(-HALF[axis], abs=BUMPS / 5)  # of thousands of vertices
            assert degrees(wall.normal[None], -way * np.eye(3)[[axis]])[0] < 0.1
            assert wall.noise < BUMPS  # patches have averaged it
            assert wall.gain > LEAST_GAIN


def test_bumpy_walls_are_even_and_no_vertex_says_otherwise(made):
    points, _, normals, found = made
    near = HALF - np.abs(points) < SIGMAS * BUMPS
    inside = near.sum(axis=1) == 1  # not in a corner
    true = -np.sign(points) * near
    before, after = degrees(normals, true)[inside], degrees(found.normals, true)[inside]
    assert before.mean() > 6.5 and after.mean() < before.mean() / 3
    assert found.shares[inside].mean() > 0.9 and found.area > 0.85
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1, atol=1e-6)


def test_planes_turn_and_grow_with_the_scene(made):
    points, faces, _, found = made
    turn, scale, shift = Rotation.from_rotvec([0.3, -0.8, 0.4]).as_matrix(), 3.0, np.array([5.0, -2.0, 1.0])
    _, there = even(scale * points @ turn.T + shift, faces, scale * BUMPS, scale * SIDE)
    assert len(there.planes) == len(found.planes)
    for a in found.planes:  # the cubes of the patches stay as they are
        assert max(turn @ a.normal @ b.normal for b in there.planes) > np.cos(np.radians(0.2))
    assert np.median(degrees(there.normals, found.normals @ turn.T)) < 0.1


def test_what_stands_out_by_more_than_its_noise_stays_to_the_bit():
    """A leaning relief, a frame and a round pillar on one wall, a free column and a ball before it."""

    def heights(at):
        x, y = at.T
        relief = (0.1 + 0.2 * (x + 1.3)) * ((abs(x + 1.3) < 0.3) & (abs(y) < 0.3))
        frame = 0.05 * ((abs(x) < 0.4) & (abs(y) < 0.4) & ~((abs(x) < 0.3) & (abs(y) < 0.3)))
        return relief + frame + np.maximum(np.sqrt(np.maximum(0.6**2 - (x - 1.3) ** 2, 0)) - 0.52, 0)

    rng = np.random.default_rng(1)
    around, up = np.meshgrid(np.linspace(0, 2 * np.pi, 48), np.linspace(-1.2, 1.2, 61))
    column = np.stack([0.5 + 0.3 * np.cos(around), up, 0.3 * np.sin(around)], axis=-1).reshape(-1, 3), sheet(48, 61)
    ball = arrays(sphere(0.4, (-0.8, 0.2, 0.7), 30))
    walls = room(rng, first=heights)
    points, faces = joined(walls, column, ball)
    normals, found = even(points, faces)
    changed = (found.normals != normals).any(axis=1)
    out = HALF[2] + points[:, 2]
    first = np.arange(len(points)) < len(plate(2, -1, flat, rng)[0])
    inside = first & (np.abs(points[:, :2]) < HALF[:2] - 0.1).all(axis=1)
    place = np.abs(points[:, :2] - [-1.3, 0]).max(axis=1)
    leaning, framed = inside & (place < 0.25), inside & (np.abs(points[:, :2]) < 0.45).all(axis=1)
    round_things = inside & (out > 1.2 * SIGMAS * BUMPS) & (points[:, 0] > 0.5)
    steep = inside & (normals[:, 2] < np.cos(np.pi / 4))
    assert round_things.sum() > 100 and steep.sum() > 50 and leaning.sum() > 100
    assert not changed[round_things].any() and not changed[steep].any()
    own = np.array([[-0.2, 0, 1]]) / np.hypot(0.2, 1)  # the relief is a plane of its own, if any
    assert (degrees(found.normals, own)[leaning & changed] < 2).all()
    assert degrees(found.normals, np.eye(3)[[2]])[framed].mean() < degrees(normals, np.eye(3)[[2]])[framed].mean()
    free = np.arange(len(points)) >= len(walls[0])
    away = free & (np.abs(points[:, 1]) < 1.1)
    assert away.sum() > 2500 and not changed[away].any()
    wall = inside & (out < BUMPS) & (normals[:, 2] > np.cos(np.radians(15)))
    assert changed[wall].mean() > 0.95


def test_nothing_flat_nothing_changed():
    points, faces = arrays(sphere(1.0, resolution=60))
    for mesh in ((points, faces), (points, faces[:0])):
        normals, found = even(*mesh)
        np.testing.assert_array_equal(found.normals, normals)
        assert not found.shares.any() and found.area == 0 and found.planes == []
