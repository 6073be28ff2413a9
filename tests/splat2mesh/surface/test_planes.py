"""Planes under the fog of their walls, and which vertices take their normals; the walls are known exactly."""

import numpy as np
import pytest
from disc_splats import discs
from mesh_samples import sheet, sheet_points
from place_splats import box, joined
from scipy.spatial.transform import Rotation

from splat2mesh.scene.mesh import vertex_normals
from splat2mesh.splats.placing import placed, similarity
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.planes import SIGMAS, Plane, on_planes, planes_of

PIXEL, BAND, REACH = 0.01, 0.2, 4.0
HALF = np.array([2.0, 1.2, 1.5])
"""Half of the sides of a room about the origin."""

SCATTER, DEEP = 0.015, 0.05
"""Standard deviation of the Gaussians on the walls about them, and mean depth of the fog before those."""

STEP, BUMPS = 0.02, 0.004
"""Edge of a mesh, and standard deviation of its heights: its normals scatter by 10 degrees."""


def fogged(walls, rng):
    """Splats of walls, each Gaussian scattered about its wall, and of a fog before them that reaches into the room."""
    inward = Rotation.from_quat(walls.quats_wxyz, scalar_first=True).apply([0, 0, 1])
    inward *= -np.sign((inward * walls.means).sum(axis=1))[:, None]
    count = len(walls.means)
    on = walls.means + inward * rng.normal(0, SCATTER, count)[:, None]
    off = walls.means + inward * rng.exponential(DEEP, count)[:, None]
    turned = Rotation.random(count, rng=rng).as_quat(scalar_first=True)
    fog = Splats(off, np.tile([0.06, 0.06, 0.02], (count, 1)), turned, np.full(count, 0.15), walls.sh)
    return joined(Splats(on, walls.scales, walls.quats_wxyz, walls.opacities, walls.sh), fog)


@pytest.fixture(scope="module")
def room():
    return fogged(box(-HALF, HALF, 0.05, inwards=True), np.random.default_rng(1))


@pytest.fixture(scope="module")
def walls(room):
    return planes_of(room, np.zeros(3), REACH, BAND, PIXEL)


def test_the_six_walls_are_found_under_their_fog(walls):
    assert len(walls) == 6
    for axis in range(3):
        for way in (-1, 1):
            (wall,) = [each for each in walls if abs(each.normal[axis] * np.sign(each.offset) - way) < 0.1]
            # Thousands of Gaussians know their plane to half a millimetre; fog on one side of it moves it more.
            assert abs(wall.offset) == pytest.approx(HALF[axis], abs=SCATTER)
            assert np.degrees(np.arccos(min(abs(wall.normal[axis]), 1))) < 0.3
            assert wall.noise < DEEP


def test_planes_turn_and_grow_with_the_scene(room, walls):
    turn, scale, shift = Rotation.from_rotvec([0.3, -0.8, 0.4]).as_matrix(), 3.0, np.array([5.0, -2.0, 1.0])
    moved = placed(room, similarity(scale=scale, rotation=turn, translation=shift))
    there = planes_of(moved, shift, scale * REACH, scale * BAND, scale * PIXEL)
    assert len(there) == len(walls)
    for a, b in zip(walls, there, strict=True):
        normal = turn @ a.normal
        side = np.sign(normal @ b.normal)
        np.testing.assert_allclose(side * normal, b.normal, atol=2e-4)  # float32 positions
        assert side * b.offset == pytest.approx(scale * a.offset + normal @ shift, abs=2e-3)


def test_a_round_thing_or_nothing_has_no_planes():
    rng = np.random.default_rng(4)
    ways = rng.normal(size=(8000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ball = discs(ways, ways, 0.03, 0.001)
    assert planes_of(ball, np.zeros(3), REACH, 0.02, PIXEL) == []
    assert planes_of(ball.take(np.arange(0)), np.zeros(3), REACH, 0.02, PIXEL) == []
    assert planes_of(ball, np.zeros(3), REACH, 0.0, PIXEL) == []


def wall_mesh(height_of, rng, size=120):
    """A bumpy wall in z = 0 that heights (V,) of places (V, 2) stand out of: points, faces, normals."""
    points = sheet_points(size, size).astype(float) * STEP
    points[:, 2] = height_of(points) + rng.normal(0, BUMPS, len(points))
    faces = sheet(size, size)
    return points, faces, vertex_normals(points, faces)


WALL = [Plane(np.array([0.0, 0.0, 1.0]), 0.0, BUMPS, 1e4)]


def tilt(normals):
    """Degrees between normals and the wall's."""
    return np.degrees(np.arccos(np.clip(normals[:, 2].astype(float), -1, 1)))


def test_a_bumpy_wall_is_even_and_lies_in_its_fog():
    points, faces, normals = wall_mesh(lambda at: 0.06, np.random.default_rng(0))
    found, shares, area = on_planes(WALL, points, normals, faces, BAND)
    before, after = tilt(normals).mean(), tilt(found).mean()
    assert before > 7 and after < before / 3
    assert shares.mean() > 0.9 and area == pytest.approx(shares.mean(), abs=0.02)


def test_what_stands_out_by_more_than_its_noise_stays_to_the_bit():
    """A box of a relief, a frame, and a round half-column."""

    def heights(at):
        x, y = at[:, 0], at[:, 1]
        relief = 0.3 * STEP * ((abs(x - 0.5) < 0.2) & (abs(y - 0.5) < 0.2))
        frame = 0.08 * ((abs(x - 0.5) < 0.3) & (abs(y - 1.7) < 0.3) & ~((abs(x - 0.5) < 0.2) & (abs(y - 1.7) < 0.2)))
        column = np.sqrt(np.maximum(0.3**2 - (x - 1.7) ** 2, 0))
        return 10 * relief + frame + column

    points, faces, normals = wall_mesh(heights, np.random.default_rng(1))
    found, shares, area = on_planes(WALL, points, normals, faces, BAND)
    high = points[:, 2] > 2 * SIGMAS * BUMPS  # of the mixture: other things than noise lie near the wall too
    assert high.mean() > 0.3
    np.testing.assert_array_equal(found[high], normals[high])
    steep = tilt(normals) > 45
    assert steep.sum() > 200
    np.testing.assert_array_equal(found[steep], normals[steep])
    flat = (points[:, 2] < SIGMAS * BUMPS) & (tilt(normals) < 15)
    assert tilt(found[flat]).mean() < tilt(normals[flat]).mean() / 3
    assert (shares[~high] > 0).mean() > 0.7


def test_without_planes_normals_stay_to_the_bit():
    points, faces, normals = wall_mesh(lambda at: 0.0, np.random.default_rng(2), 20)
    for planes in ([], [WALL[0]._replace(offset=1.0)]):
        found, shares, area = on_planes(planes, points, normals, faces, BAND)
        np.testing.assert_array_equal(found, normals)
        assert not shares.any() and area == 0
