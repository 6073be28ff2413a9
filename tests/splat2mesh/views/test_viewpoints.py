"""Virtual cameras: together they see what there is to see, from where a visitor could stand, the same every time."""

import numpy as np
import open3d as o3d
import pytest
from disc_splats import discs, plain
from generated import UP, caster, dilated_splats, scene, seen_points, times_seen
from scipy.spatial.transform import Rotation

from scenes.cameras import FLIP
from splat2mesh.render.opacityfield import field_depth
from splat2mesh.splats.splats import Splats
from splat2mesh.views import viewpoints
from splat2mesh.views.viewpoints import (
    CANDIDATE_PIXELS,
    ELEVATIONS_DEG,
    PICTURE_ASPECT,
    bounds_of,
    candidate_views,
    even_directions,
    near_plane,
    picture_view,
    virtual_views,
)

VIEWS, PIXELS = 32, 256
"""Those of the draft."""


def joined(*parts):
    names = ("means", "scales", "quats_wxyz", "opacities", "sh")
    return Splats(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def closed_box(half, spacing):
    """Opaque flat splats on the six walls of a box around the origin, facing inwards."""
    half, walls = np.asarray(half, float), []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        u, v = np.meshgrid(*(np.arange(-half[other] + spacing / 2, half[other], spacing) for other in others))
        for side in (-1, 1):
            points, normals = np.zeros((u.size, 3)), np.zeros((u.size, 3))
            points[:, others] = np.stack([u.ravel(), v.ravel()], axis=1)
            points[:, axis], normals[:, axis] = side * half[axis], -side
            normals[:, (axis + 1) % 3] += 1e-6  # no normal is exactly -z, where the smallest rotation is not defined
            walls.append(discs(points, normals, 0.7 * spacing, 1e-3))
    return joined(*walls)


def room_in_a_haze(half=(2.0, 1.2, 1.6)):
    """A coloured room, open above, and behind its walls what training leaves outside a room: large faint blobs."""
    rng = np.random.default_rng(0)
    walls = closed_box(half, 0.1)
    above = (walls.means[:, 1] < -0.99 * half[1]) & (np.abs(walls.means[:, [0, 2]]) < [1.2, 1.0]).all(axis=1)
    walls = walls.take(~above)
    patches = rng.normal(0, 1, (7, 7, 7, 3))
    cells = ((walls.means / half + 1) / 2 * 6).round().astype(int)
    walls = Splats(walls.means, walls.scales, walls.quats_wxyz, walls.opacities, patches[tuple(cells.T)][:, None])
    haze = rng.uniform(-1.6, 1.6, (4000, 3)) * half
    haze = haze[(np.abs(haze) > np.array(half) + 0.1).any(axis=1)]
    return joined(walls, plain(haze, 0.12, opacity=0.25))


def ball(count=6000, center=(0.0, 0.0, 0.0)):
    normals = even_directions(count)
    return discs(normals + center, normals, 0.7 * np.sqrt(4 * np.pi / count), 1e-3)


def eyes_of(views):
    return np.array([view.center for view in views])


def same(first, second):
    return len(first) == len(second) and all(
        a.camera_from_world.tobytes() == b.camera_from_world.tobytes()
        and (a.width, a.height, a.fx, a.fy, a.cx, a.cy) == (b.width, b.height, b.fx, b.fy, b.cx, b.cy)
        for a, b in zip(first, second, strict=True)
    )


def coverage(kind, count, times):
    """Share of the surface seen by the capture that so many of the chosen views see as well."""
    truth, seen, _ = scene(kind, count)
    splats = dilated_splats(kind, count)
    views = virtual_views(splats, VIEWS, PIXELS, UP)
    assert 0.7 * VIEWS < len(views) <= 1.25 * VIEWS  # fewer where few candidates are sharp, more for what they miss
    near = near_plane(bounds_of(splats))
    points, normals = seen_points(truth, seen)
    return (times_seen(truth, points, normals, views, near)[:, None] >= times).mean(axis=0), views


def test_an_object_is_seen_everywhere_twice_and_from_all_around():
    (once, twice), views = coverage("object", 20_000, [1, 2])
    assert once > 0.995 and twice > 0.95
    eyes = eyes_of(views) * FLIP
    middle = scene("object")[0].vertices.mean(axis=0)
    around = (eyes - middle) / np.linalg.norm(eyes - middle, axis=1, keepdims=True)
    # 32 even directions leave no direction farther than 27 degrees from one; twice that is a gap.
    assert np.degrees(np.arccos((even_directions(200) @ around.T).max(axis=1))).max() < 55
    distance = caster(scene("object")[0]).compute_signed_distance(o3d.core.Tensor(eyes.astype(np.float32))).numpy()
    assert distance.min() > 0


@pytest.mark.parametrize(
    ("kind", "count", "least"), [("tabletop", 30_000, (0.92, 0.87)), ("room", 40_000, (0.82, 0.65))]
)
def test_most_of_a_crowded_scene_is_seen(kind, count, least):
    # What no candidate sees, between solids and under shelves, keeps this from 1.
    share, _ = coverage(kind, count, [1, 2])
    assert (share > least).all()


def test_nobody_looks_out_of_a_sealed_object():
    center = np.array([5.0, 1.0, -2.0])
    eyes = eyes_of(candidate_views(ball(center=center), 24, UP))
    assert np.linalg.norm(eyes - center, axis=1).min() > 1
    assert len(eyes) > 48  # there are places beside the ball, in the corners of its box


def test_a_room_is_seen_from_inside():
    half = np.array([2.0, 1.2, 1.6])
    splats = room_in_a_haze(half)
    eyes = eyes_of(virtual_views(splats, VIEWS, PIXELS, UP))
    assert (np.abs(eyes) < half).all(axis=1).mean() > 0.8


def test_an_object_is_shown_whole_upright_and_from_slightly_above():
    truth, _, _ = scene("object")
    splats = dilated_splats("object")
    view = picture_view(splats, UP)
    right, down, forward = view.camera_from_world[:3, :3]
    assert view.width / view.height == PICTURE_ASPECT
    assert right @ UP == pytest.approx(0, abs=1e-9) and down @ UP < 0
    elevation = np.degrees(np.arcsin(-forward @ UP))
    assert ELEVATIONS_DEG[1] <= elevation <= ELEVATIONS_DEG[0]
    pixels, depth = view.project(truth.vertices * FLIP)
    assert (depth > near_plane(bounds_of(splats))).all()
    assert (pixels >= 0).all() and (pixels <= [view.width, view.height]).all()
    assert (np.ptp(pixels, axis=0) / [view.width, view.height]).max() > 0.6


def test_the_picture_turns_with_the_scene():
    # The four sides of a ball differ in colour only: the same one must be chosen in any frame.
    splats = ball()
    rng = np.random.default_rng(0)
    speckled = rng.normal(0, 1, (len(splats), 1, 3)) * (splats.means[:, :1, None] > 0.3)
    splats = Splats(splats.means, splats.scales, splats.quats_wxyz, splats.opacities, speckled)
    assert picture_view(splats, UP).center[0] > 0.5
    turn = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # -y to +z
    x, y, z, w = (turn * Rotation.from_quat(splats.quats_wxyz[:, [1, 2, 3, 0]])).as_quat().T
    means, quats = turn.apply(splats.means), np.stack([w, x, y, z], axis=1)
    turned = Splats(means, splats.scales, quats, splats.opacities, splats.sh)
    view = picture_view(turned, turn.apply(UP))
    assert np.allclose(turn.apply(UP), [0, 0, 1]) and view.center[0] > 0.5 and view.center[2] > 0.3


def test_views_are_the_same_every_time_and_as_large_as_wanted(monkeypatch):
    splats = dilated_splats("object")
    first = virtual_views(splats, 12, 100, UP)
    monkeypatch.setattr("splat2mesh.base.threads.all_cores", lambda: 1)
    again = virtual_views(splats, 12, 100, UP)
    assert same(first, again) and 9 <= len(first) <= 15
    assert not same(first, virtual_views(splats, 12, 100, UP, seed=1))
    assert {max(view.width, view.height) for view in first} == {100}


def test_a_sketch_covers_what_the_splats_cover():
    splats = dilated_splats("object")
    sketch = viewpoints.thinned(splats, np.random.default_rng(0), 4000)
    assert len(sketch) == 4000
    near, bounds = near_plane(bounds_of(splats)), bounds_of(splats)
    shared = []
    for view in candidate_views(splats, 8, UP)[:8]:
        whole, thin = (np.isfinite(field_depth(part, view, near).depth) for part in (splats, sketch))
        shared.append((whole & thin).sum() / (whole | thin).sum())
    # The outline grows by the wider splats: a pixel or two all around of a disc of some 50.
    assert np.mean(shared) > 0.85
    chosen = virtual_views(splats, VIEWS, PIXELS, UP)
    truth, seen, _ = scene("object")
    assert (times_seen(truth, *seen_points(truth, seen), chosen, near_plane(bounds)) >= 2).mean() > 0.95
    few = splats.take(slice(3999))
    assert viewpoints.thinned(few, np.random.default_rng(0)) is few


def test_the_box_holds_the_solid_part_only():
    rng = np.random.default_rng(0)
    cube = plain(rng.uniform(-1, 1, (5000, 3)) * [1, 2, 3] + [10, 0, 0], 0.01, opacity=0.8)
    stray = plain(rng.uniform(-100, 100, (15, 3)), 0.1, opacity=0.9)
    haze = plain(rng.uniform(-50, 50, (5000, 3)), 1.0, opacity=0.1)
    bounds = bounds_of(joined(cube, stray, haze))
    # The half percent cut off on each side is of the order of the margin of 2% of the diagonal, 0.15.
    np.testing.assert_allclose(bounds, [[9, -2, -3], [11, 2, 3]], atol=0.2)
    assert near_plane(bounds) == pytest.approx(0.005 * np.linalg.norm(np.ptp(bounds, axis=0)))


def test_candidates_are_small_and_hold_the_scene():
    splats = ball(2000)
    views = candidate_views(splats, 10, UP)
    assert all(max(view.width, view.height) == CANDIDATE_PIXELS for view in views)
    for view in views[:10]:
        pixels, depth = view.project(splats.means)
        assert (pixels >= 0).all() and (pixels <= [view.width, view.height]).all() and (depth > 0).all()


def test_directions_are_unit_and_even():
    directions = even_directions(500)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-12)
    assert np.linalg.norm(directions.mean(axis=0)) < 0.01
    cosine = directions @ directions.T - 2 * np.eye(500)
    nearest = np.arccos(cosine.max(axis=1))
    # A hexagonal packing of 500 discs on the sphere has 2 sqrt(2 pi / (sqrt(3) 500)) = 0.17 between neighbours.
    assert nearest.min() > 0.6 * 0.17 and nearest.max() < 1.2 * 0.17


def test_nothing_but_fog_gives_no_views():
    fog = plain(np.random.default_rng(0).normal(size=(500, 3)), 0.05, opacity=0.02)
    assert virtual_views(fog, 8, 64, UP) == []
