"""The ceiling of a room: the share of lines of sight that leak, and views that close it where no camera looked up."""

import json

import numpy as np
import open3d as o3d
import pytest
from place_splats import room

from scenes.cameras import write_inria_cameras
from splat2mesh import convert
from splat2mesh.render.view import View
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.surface import place
from splat2mesh.surface.extract import EFFORTS, Effort
from splat2mesh.views import standpoints
from splat2mesh.views.eyes import Eye
from splat2mesh.views.overhead import PAST, UP_LEAST, Overhead
from splat2mesh.views.viewpoints import bounds_of, even_directions

UP = np.array([0.0, 1.0, 0.0])


def below_a_ceiling(count=400, height=2.0):
    """An Overhead of one point under a wide ceiling, all of whose rays upward meet it."""
    directions = even_directions(count)
    with np.errstate(divide="ignore"):
        distance = np.where(directions[:, 1] > 0, height / directions[:, 1], np.inf)[None]
    return Overhead.of(np.zeros((1, 3)), directions, distance, UP, [Eye(np.zeros(3), 0.1)])


def square(height, low, high):
    points = np.array([[low, height, -9], [high, height, -9], [high, height, 9], [low, height, 9]], np.float32)
    return points, np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def test_lines_go_up_to_what_is_opaque():
    overhead = below_a_ceiling()
    way = overhead.lines[:, 3:]
    np.testing.assert_allclose(way[:, 1], 2.0, rtol=1e-6)
    assert (way @ UP > UP_LEAST * np.linalg.norm(way, axis=1)).all()
    assert len(way) == pytest.approx(400 * (1 - UP_LEAST) / 2, abs=2), "the cap's share of the sphere"


def test_a_closed_ceiling_leaks_nothing_an_open_one_everything():
    overhead = below_a_ceiling()
    assert overhead.leak(*square(2.0, -9, 9)) == 0.0
    assert overhead.leak(*square(2.0, 5, 9)) == 1.0
    assert overhead.leak(*square(2.0, 0, 9)) == pytest.approx(0.5, abs=0.02)


def test_what_lies_past_the_ceiling_closes_nothing():
    overhead = below_a_ceiling()
    assert overhead.leak(*square(2.0 * PAST * 0.99, -20, 20)) == 0.0
    assert overhead.leak(*square(2.0 * PAST * 1.01, -20, 20)) == 1.0


def test_nothing_to_judge_is_no_leak():
    overhead = below_a_ceiling()
    assert overhead.leak(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)) == 0.0
    none = overhead._replace(lines=overhead.lines[:0])
    assert none.leak(*square(2.0, 5, 9)) == 0.0


def test_a_room_knows_its_ceiling_and_a_garden_none():
    splats = room()
    found = standpoints.standpoints(splats, bounds_of(splats), up=UP).overhead
    reached = found.lines[:, :3] + found.lines[:, 3:]
    assert np.median(np.abs(reached[:, 1] - 2.4)) < 0.1
    assert standpoints.standpoints(splats, bounds_of(splats)).overhead is None, "up is unknown"
    assert standpoints.standpoints(splats, bounds_of(splats), "outside", up=UP).overhead is None


@pytest.fixture(scope="module")
def quick():
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EFFORTS, "draft", Effort(views=12, pixels=96, cells=80))
        patch.setattr(standpoints, "EYES", 4)
        yield


def captured(folder, pitches):
    """A room's splat and its INRIA cameras: eight ways from each of two places, at each of some pitches."""
    splat = folder / "point_cloud" / "iteration_7000" / "point_cloud.ply"
    splat.parent.mkdir(parents=True)
    write_inria_ply(splat, room(0.06))
    views = []
    for eye in ([-0.8, 1.2, 0.0], [0.0, 1.2, -0.6]):
        for turn in np.arange(8) * np.pi / 4:
            for pitch in pitches:
                ahead = [np.cos(turn), np.tan(pitch), np.sin(turn)]
                views.append(View.look_at(np.array(eye), np.array(eye) + ahead, UP, 60.0, 96))
    write_inria_cameras(folder / "cameras.json", views)
    assert len(json.loads((folder / "cameras.json").read_text())) == len(views)
    return splat


def open_above(scene):
    """Share of the directions up from the middle of the room in which the mesh is open."""
    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles(o3d.core.Tensor(scene.vertices.copy()), o3d.core.Tensor(scene.faces.astype(np.uint32)))
    up = even_directions(2000)
    up = up[up[:, 1] > UP_LEAST]
    rays = np.hstack([np.tile([-0.8, 1.3, 0.3], (len(up), 1)), up]).astype(np.float32)
    return 1.0 - caster.test_occlusions(o3d.core.Tensor(rays)).numpy().mean()


def test_a_ceiling_that_no_camera_saw_is_closed(quick, tmp_path, monkeypatch):
    splat = captured(tmp_path, [-0.3])
    scene = convert(splat, detail="draft", up="+y")
    assert scene.settings["cameras"] == "trained" and scene.statistics["views"] == 16 + 6 * 4
    monkeypatch.setattr(place, "MOST_LEAK", 1.0)
    alone = convert(splat, detail="draft", up="+y")
    assert alone.statistics["views"] == 16
    assert open_above(alone) > 0.5
    assert open_above(scene) < 0.01


def test_cameras_that_saw_the_ceiling_stay_alone(quick, tmp_path, monkeypatch):
    monkeypatch.setitem(EFFORTS, "draft", Effort(views=24, pixels=96, cells=80))
    scene = convert(captured(tmp_path, [-0.3, 0.4, 1.2]), detail="draft", up="+y")
    assert scene.statistics["views"] == 48
