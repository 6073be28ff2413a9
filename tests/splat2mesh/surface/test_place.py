"""The whole way for places: rooms from within without holes, a garden that keeps its table, and the sky set apart."""

import numpy as np
import open3d as o3d
import pytest
from place_splats import garden, room

from splat2mesh import convert
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.surface.extract import EFFORTS, Effort
from splat2mesh.views import standpoints
from splat2mesh.views.viewpoints import even_directions


@pytest.fixture(scope="module", autouse=True)
def quick():
    """Small views from few eyes: what is tested does not depend on accuracy."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EFFORTS, "draft", Effort(views=12, pixels=96, cells=80))
        patch.setattr(standpoints, "PLACES", 2500)  # some beside the table, of which enough rays
        patch.setattr(standpoints, "EVENLY", 256)  # go under it
        patch.setattr(standpoints, "EYES", 6)
        patch.setattr("splat2mesh.pipeline.AROUND", 8)
        yield


def made(folder, splats, **settings):
    write_inria_ply(folder / "splat.ply", splats)
    return convert(folder / "splat.ply", detail="draft", up="+y", **settings)


@pytest.fixture(scope="module")
def from_the_room(tmp_path_factory):
    return made(tmp_path_factory.mktemp("room"), room(0.06))


@pytest.fixture(scope="module")
def from_the_garden(tmp_path_factory):
    with pytest.warns(DataWarning, match="far background"):
        return made(tmp_path_factory.mktemp("garden"), garden(0.08))


def caster(scene):
    found = o3d.t.geometry.RaycastingScene()
    found.add_triangles(o3d.core.Tensor(scene.vertices.copy()), o3d.core.Tensor(scene.faces.astype(np.uint32)))
    return found


def hits(scene, eye, directions):
    """Distance of what rays meet, inf where nothing, and whether it is a front."""
    rays = np.concatenate([np.tile(eye, (len(directions), 1)), directions], axis=1).astype(np.float32)
    hit = caster(scene).cast_rays(o3d.core.Tensor(rays))
    front = (hit["primitive_normals"].numpy() * directions).sum(axis=1) < 0
    return hit["t_hit"].numpy(), front


@pytest.mark.slow
def test_the_walls_of_a_room_have_the_normals_of_planes(from_the_room):
    scene, found = from_the_room, from_the_room.statistics
    assert 6 <= found["planes"] <= 12 and found["on_planes"] > 0.6
    along = np.abs(scene.normals).max(axis=1)
    assert (along > np.cos(np.radians(1))).mean() > 0.6


@pytest.mark.slow
def test_a_room_has_no_holes_and_shows_its_front(from_the_room):
    directions = even_directions(2000)
    eye = np.array([-0.8, 1.3, 0.3])
    distance, front = hits(from_the_room, eye, directions)
    assert np.isfinite(distance).mean() > 0.995
    assert front[np.isfinite(distance)].mean() > 0.995
    # The walls and the floor, where nothing stands before them: the nearest of the six planes.
    with np.errstate(divide="ignore"):
        planes = np.maximum((np.array([-2, 0, -1.5]) - eye) / directions, (np.array([2, 2.4, 1.5]) - eye) / directions)
    error = distance - planes.min(axis=1)
    assert np.median(np.abs(error[np.isfinite(error)])) < 0.03


def test_the_scene_says_where_the_capture_stood(from_the_room, tmp_path):
    capture = from_the_room.capture
    assert capture["from"] == "inside" and len(capture["eyes"]) > 0
    eye = np.array(from_the_room.preview_camera["eye"])
    assert (np.abs(eye - [0, 1.2, 0]) < [2, 1.2, 1.5]).all(), "the preview looks from within the room"
    from_the_room.save(tmp_path / "scene")
    assert Scene.load(tmp_path / "scene").capture == capture


@pytest.mark.slow
def test_a_table_that_stands_on_nothing_is_kept(from_the_garden):
    assert from_the_garden.capture["from"] == "both"
    spots = np.stack(np.meshgrid([-0.4, 0, 0.4], [-0.4, 0, 0.4]), axis=-1).reshape(-1, 2)
    for x, z in spots:
        distance, front = hits(from_the_garden, np.array([x, 2.0, z]), np.array([[0.0, -1.0, 0.0]]))
        assert front[0] and distance[0] == pytest.approx(1.2, abs=0.08)


def test_the_far_background_is_set_apart_with_its_splats(from_the_garden, tmp_path):
    far = from_the_garden.background_splats
    truth = np.flatnonzero(np.abs(garden(0.08).means).max(axis=1) > 20)
    assert np.isin(truth, far).mean() > 0.99
    assert np.abs(from_the_garden.vertices).max() < 20
    assert from_the_garden.background, "it is kept as a mesh of its own"
    from_the_garden.save(tmp_path / "scene")
    again = Scene.load(tmp_path / "scene")
    np.testing.assert_array_equal(again.background_splats, far)
    np.testing.assert_array_equal(again.vertices, from_the_garden.vertices)
    assert len(again.background) == len(from_the_garden.background)


@pytest.mark.slow
def test_the_same_bytes_again_on_any_number_of_threads(from_the_room, tmp_path, monkeypatch):
    monkeypatch.setattr("splat2mesh.base.threads.all_cores", lambda: 1)
    again = made(tmp_path, room(0.06))
    for name in ("vertices", "normals", "faces", "colors_srgb"):
        np.testing.assert_array_equal(getattr(again, name), getattr(from_the_room, name))


def test_from_outside_is_the_way_of_objects(tmp_path):
    scene = made(tmp_path, room(0.1), stand="outside", vertices=2000)
    assert scene.capture == {"from": "outside"} and scene.settings["from"] == "outside"


def test_nonsense_is_refused(tmp_path):
    with pytest.raises(InputError, match="`stand` above: expected one of auto inside outside"):
        made(tmp_path, room(0.2), stand="above")
    with pytest.raises(InputError, match="inside a surface"):
        made(tmp_path, room(0.1), eyes=[(0.0, 0.01, 0.0)])
