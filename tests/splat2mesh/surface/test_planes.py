"""Planes under the fog of their walls, and depth maps that settle on them; the walls are known exactly."""

import numpy as np
import pytest
from disc_splats import discs
from place_splats import box, joined, wall
from scipy.spatial.transform import Rotation

from splat2mesh.render.opacityfield import FieldDepth, field_depth
from splat2mesh.render.view import View
from splat2mesh.splats.placing import placed, similarity
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.planes import planes_of
from splat2mesh.surface.settle import PackedPlanes, band_of

PIXEL, LEVEL = 0.01, 0.6
HALF = np.array([2.0, 1.2, 1.5])
"""Half of the sides of a room about the origin."""

SCATTER, DEEP = 0.015, 0.05
"""Standard deviation of the Gaussians on the walls about them, and mean depth of the fog before those."""


def fogged(walls, rng, share=1.0):
    """Splats of walls, each Gaussian scattered about its wall, and of a fog before them that reaches into the room."""
    inward = Rotation.from_quat(walls.quats_wxyz, scalar_first=True).apply([0, 0, 1])
    inward *= -np.sign((inward * walls.means).sum(axis=1))[:, None]
    count = len(walls.means)
    on = walls.means + inward * rng.normal(0, SCATTER, count)[:, None]
    chosen = rng.random(count) < share
    off = (walls.means + inward * rng.exponential(DEEP, count)[:, None])[chosen]
    turned = Rotation.random(len(off), rng=rng).as_quat(scalar_first=True)
    fog = Splats(off, np.tile([0.06, 0.06, 0.02], (len(off), 1)), turned, np.full(len(off), 0.15), walls.sh[chosen])
    return joined(Splats(on, walls.scales, walls.quats_wxyz, walls.opacities, walls.sh), fog)


def room(rng, spacing=0.05):
    return fogged(box(-HALF, HALF, spacing, inwards=True), rng)


def six_views(size=128):
    ways = np.concatenate([np.eye(3), -np.eye(3)])
    return [View.look_at([0.1, 0.05, -0.1], way, [0.1, 1, 0.2], 92, size) for way in ways]


def looked(splats, views):
    return [field_depth(splats, view, 0.05, LEVEL) for view in views]


def found(splats, views, seen):
    band = band_of(views, seen)
    return PackedPlanes.of(planes_of(splats, np.zeros(3), 4.0, band, PIXEL, LEVEL), views, seen, band)


def points_of(view, depth):
    return view.center + view.ray_directions() * depth[..., None]


def out_of_room(points):
    """Signed distance from the nearest wall of the room, positive inside: (...)."""
    return (HALF - np.abs(points)).min(axis=-1)


@pytest.fixture(scope="module")
def scene():
    splats = room(np.random.default_rng(1))
    views = six_views()
    seen = looked(splats, views)
    return splats, views, seen, found(splats, views, seen)


def test_the_six_walls_are_found_under_their_fog(scene):
    planes = scene[3].planes
    planes = planes * np.sign(planes[:, 3:])  # offsets positive
    for axis in range(3):
        for way in (-1, 1):
            near = planes[planes[:, axis] * way > 0.9]
            assert len(near) == 1
            # A thousand Gaussians scattered by 15 mm know their plane to half a millimetre; fog takes the rest.
            assert near[0, 3] == pytest.approx(HALF[axis], abs=SCATTER / 3)
            assert np.degrees(np.arccos(min(near[0, axis] * way, 1))) < 0.3
    assert len(planes) == 6


def test_depths_in_the_fog_settle_on_the_wall(scene):
    _, views, seen, planes = scene
    before, after, moved = [], [], []
    for view, each in zip(views, seen, strict=True):
        settled = planes.settled(view, each)
        before.append(out_of_room(points_of(view, each.depth)).ravel())
        after.append(out_of_room(points_of(view, settled.depth)).ravel())
        moved.append((settled.depth != each.depth).ravel())
        there = settled.depth != each.depth
        assert (settled.spread[there] <= each.spread[there]).all()
        walls = np.abs(settled.normal[there]).max(axis=-1)
        np.testing.assert_allclose(walls, 1, atol=2e-5)
    before, after, moved = (np.concatenate(each) for each in (before, after, moved))
    assert moved.mean() > 0.8
    assert np.median(before) > 0.03  # the fog, on the room's side
    assert np.percentile(np.abs(after[moved]), 99) < SCATTER / 2


def test_planes_turn_and_grow_with_the_scene(scene):
    splats = scene[0]
    turn, scale, shift = Rotation.from_rotvec([0.3, -0.8, 0.4]).as_matrix(), 3.0, np.array([5.0, -2.0, 1.0])
    moved = placed(splats, similarity(scale=scale, rotation=turn, translation=shift))
    band = 0.2
    here = planes_of(splats, np.zeros(3), 4.0, band, PIXEL, LEVEL)
    there = planes_of(moved, shift, scale * 4.0, scale * band, scale * PIXEL, LEVEL)
    assert len(here) == len(there) >= 6
    for a, b in zip(here[:6], there[:6], strict=True):
        normal = turn @ a.normal
        side = np.sign(normal @ b.normal)
        np.testing.assert_allclose(side * normal, b.normal, atol=2e-4)  # float32 positions
        assert side * b.offset == pytest.approx(scale * a.offset + normal @ shift, abs=2e-3)


def test_what_stands_out_by_more_than_its_noise_stays_to_the_bit():
    """A crisp frame 6 cm before a foggy wall, four times the scatter there."""
    rng = np.random.default_rng(2)
    frame = wall([-0.4, -0.4, 1.44], [0, 0.8, 0], [0.8, 0, 0], 0.02)
    behind = room(rng)
    hidden = (np.abs(behind.means[:, :2]) < 0.42).all(axis=1) & (behind.means[:, 2] > 1)
    splats, views = joined(behind.take(np.flatnonzero(~hidden)), frame), six_views()
    seen = looked(splats, views)
    planes = found(splats, views, seen)
    settled_walls = seen_frame = 0
    for view, each in zip(views, seen, strict=True):
        settled = planes.settled(view, each)
        at = points_of(view, each.depth)
        inside = (np.abs(at[..., :2]) < 0.37).all(axis=-1) & (np.abs(at[..., 2] - 1.44) < 0.02)
        seen_frame += int(inside.sum())
        np.testing.assert_array_equal(settled.depth[inside], each.depth[inside])
        np.testing.assert_array_equal(settled.normal[inside], each.normal[inside])
        settled_walls += int((settled.depth != each.depth).sum())
    assert settled_walls > 5000 and seen_frame > 500


def test_a_window_stays_open():
    rng = np.random.default_rng(3)
    splats = room(rng)
    glass = (np.abs(splats.means[:, :2]) < 0.5).all(axis=1) & (splats.means[:, 2] > 1)
    outside = wall([-6, -6, 5], [0, 12, 0], [12, 0, 0], 0.2)
    splats, views = joined(splats.take(np.flatnonzero(~glass)), outside), six_views()
    seen = looked(splats, views)
    planes = found(splats, views, seen)
    view, each = views[2], seen[2]
    through = points_of(view, np.where(np.isfinite(each.depth), each.depth, 0))[..., 2] > 4.5
    assert through.sum() > 100
    np.testing.assert_array_equal(planes.settled(view, each).depth[through], each.depth[through])


@pytest.mark.parametrize("shape", ["ball", "column"])
def test_round_things_have_no_planes(shape):
    """Fuzzy ones, seen from around: the fog alone would let a plane pass."""
    rng = np.random.default_rng(4)
    normals = rng.normal(size=(8000, 3))
    if shape == "column":
        normals[:, 1] = 0
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = 0.6 * normals
    if shape == "column":
        points[:, 1] = rng.uniform(-1, 1, len(points))
    points += normals * rng.normal(0, SCATTER, len(points))[:, None]
    splats = discs(points, normals, 0.05, 0.005)
    views = [View.look_at(3 * np.array([np.sin(a), 0.2, np.cos(a)]), np.zeros(3), [0, 1, 0], 40, 64) for a in range(6)]
    seen = looked(splats, views)
    planes = found(splats, views, seen)
    for view, each in zip(views, seen, strict=True):
        settled = planes.settled(view, each)
        changed = settled.depth != each.depth
        assert (changed & np.isfinite(each.depth)).sum() < 0.02 * np.isfinite(each.depth).sum()


def test_nothing_seen_gives_no_planes():
    empty = room(np.random.default_rng(5)).take(np.arange(0))
    view = six_views(8)[0]
    nothing = FieldDepth(
        np.full((8, 8), np.nan, np.float32),
        *(np.zeros((8, 8, 3), np.float32), np.full((8, 8), np.nan, np.float32)),
        *(np.zeros((8, 8, 3), np.float32), np.zeros((8, 8), np.float32)),
    )
    assert band_of([view], [nothing]) == 0
    planes = PackedPlanes.of(planes_of(empty, np.zeros(3), 1.0, 0.1, PIXEL, LEVEL), [view], [nothing], 0.1)
    assert len(planes.planes) == 0 and planes.settled(view, nothing) is nothing


def test_the_share_of_a_mesh_on_the_planes(scene):
    corners = np.array([[-2, -1, 1.5], [2, -1, 1.5], [2, 1, 1.5], [-2, 1, 1.5]], float)
    points = np.concatenate([corners, corners - [0, 0, 0.6]])  # one rectangle on a wall, one before it
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)
    assert scene[3].share_of(points, faces, np.array([0, 0, 1.2]), 4.0) == pytest.approx(0.5, abs=1e-12)
