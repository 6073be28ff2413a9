"""Cameras as files give them: numbers of three kinds of file become the same View."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.render.view import View
from splat2mesh.views.cameras_json import views_of_cameras_json
from splat2mesh.views.nerfstudio import TRAINING_FRAME, UNKNOWN_SIDE, candidates_of_transforms
from splat2mesh.views.poses import LOST, SLACK, view_of

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # of a pose: COLMAP's axes of a camera and OpenGL's


def pose(seed=0):
    """(4, 4) world_from_camera, rigid."""
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    matrix[:3, 3] = rng.normal(size=3)
    return matrix


def test_a_view_is_the_inverse_of_the_pose_it_is_made_of():
    view = view_of("a", (640, 480), (500.0, 510.0), None, pose())
    np.testing.assert_allclose(view.camera_from_world @ pose(), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(view.center, pose()[:3, 3], atol=1e-12)
    assert (view.width, view.height, view.fx, view.fy, view.cx, view.cy) == (640, 480, 500.0, 510.0, 320.0, 240.0)
    assert view_of("a", (640, 480), (500.0, 510.0), (300.0, 200.0), pose()).cx == 300.0


def test_a_rotation_of_few_digits_becomes_an_exact_one():
    rough = pose()
    rough[:3, :3] = rough[:3, :3].round(3)
    turn = view_of("a", (4, 4), (1.0, 1.0), None, rough).camera_from_world[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(turn.T, rough[:3, :3], atol=2e-3)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"size": (0, 480)}, "no usable picture: 0 x 480"),
        ({"focal": (500.0, 0.0)}, "no usable picture"),
        ({"size": ("a", 1)}, "holds no numbers"),
        ({"world_from_camera": np.eye(3)}, "holds no numbers"),
        ({"world_from_camera": np.diag([1.0 + 2 * SLACK, 1.0, 1.0, 1.0])}, "its rotation is invalid"),
        ({"world_from_camera": np.diag([-1.0, 1.0, 1.0, 1.0])}, "its rotation is invalid"),
    ],
)
def test_what_is_no_camera_is_one_line_that_names_it(change, says):
    good = {"size": (640, 480), "focal": (500.0, 500.0), "principal": None, "world_from_camera": pose()}
    with pytest.raises(InputError, match=says) as error:
        view_of("file: camera 3", **{**good, **change})
    assert str(error.value).startswith("file: camera 3")


def test_a_pose_that_was_not_found_is_no_view():
    lost = pose()
    lost[1, 3] = np.nan
    assert view_of("a", (4, 4), (1.0, 1.0), None, lost) == LOST


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_nor_is_one_whose_own_numbers_are_none(number):
    given = [(4, number), (1.0, 1.0), None], [(4, 4), (number, 1.0), None], [(4, 4), (1.0, 1.0), (2.0, number)]
    assert all(view_of("a", *each, pose()) == LOST for each in given)


def of_inria(matrix):
    return {
        **{"width": 64, "height": 48, "fx": 50.0, "fy": 51.0},
        **{"position": matrix[:3, 3].tolist(), "rotation": matrix[:3, :3].tolist()},
    }


def test_cameras_of_inria_are_poses_of_cameras_in_the_world():
    poses = [pose(0), pose(1)]
    views = views_of_cameras_json("cameras.json", [of_inria(each) for each in poses])
    for view, matrix in zip(views, poses, strict=True):
        np.testing.assert_allclose(np.linalg.inv(view.camera_from_world), matrix, atol=1e-12)
        assert (view.fx, view.fy, view.cx, view.cy) == (50.0, 51.0, 32.0, 24.0)
    with pytest.raises(InputError, match=r"camera 2 is not an INRIA camera \(KeyError: 'rotation'"):
        views_of_cameras_json("cameras.json", [of_inria(poses[0]), {"width": 1, "height": 1, "fx": 1, "fy": 1}])


def transforms(matrix, **more):
    return {"w": 64, "h": 48, "fl_x": 50.0, "frames": [{"transform_matrix": (matrix @ FLIP).tolist()}], **more}


def candidates(folder, content):
    return [views[0] for views in candidates_of_transforms(folder / "transforms.json", content, folder / "splat.ply")]


def test_cameras_of_nerfstudio_look_along_their_negative_z(tmp_path):
    (view,) = candidates(tmp_path, transforms(FLIP))  # whose transform_matrix is then the identity
    np.testing.assert_allclose(view.forward, [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(-view.camera_from_world[1, :3], [0, 1, 0], atol=1e-12)
    (view,) = candidates(tmp_path, transforms(pose()))
    np.testing.assert_allclose(np.linalg.inv(view.camera_from_world), pose(), atol=1e-12)
    assert view.fy == view.fx == 50.0


def test_the_frame_of_the_training_comes_first_and_scales_last(tmp_path):
    turn, scale = pose(3), 0.25
    (tmp_path / TRAINING_FRAME).write_text(json.dumps({"transform": turn[:3].tolist(), "scale": scale}))
    first, plain = candidates(tmp_path, transforms(pose()))
    np.testing.assert_allclose(first.center, scale * (turn @ pose())[:3, 3], atol=1e-12)
    np.testing.assert_allclose(first.camera_from_world[:3, :3], (turn @ pose())[:3, :3].T, atol=1e-12)
    np.testing.assert_allclose(plain.center, pose()[:3, 3], atol=1e-12)


def test_what_was_applied_to_a_colmap_frame_is_undone(tmp_path):
    applied, scale = pose(4), 2.0
    moved = applied @ pose()
    moved[:3, 3] *= scale
    more = {"applied_transform": applied[:3].tolist(), "applied_scale": scale}
    *_, undone = candidates(tmp_path, transforms(moved, **more))
    np.testing.assert_allclose(np.linalg.inv(undone.camera_from_world), pose(), atol=1e-12)


def test_the_angle_of_a_picture_gives_its_focal_length_and_a_missing_size_a_warning(tmp_path):
    content = {"camera_angle_x": np.pi / 2, "frames": [{"transform_matrix": np.eye(4).tolist()}]}
    with pytest.warns(DataWarning, match="gives no picture size"):
        (view,) = candidates(tmp_path, content)
    assert isinstance(view, View)
    np.testing.assert_allclose([view.width, view.fx, view.fy], [UNKNOWN_SIDE, UNKNOWN_SIDE / 2, UNKNOWN_SIDE / 2])


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"frames": [3]}, "holds no frames"),
        (transforms(pose(), camera_model="EQUIRECTANGULAR"), "panoramas"),
        ({"w": 4, "h": 4, "frames": [{"transform_matrix": np.eye(4).tolist()}]}, "frame 1 is not a nerfstudio frame"),
        (transforms(pose(), applied_transform=[[0.0] * 4] * 3), "its applied_transform is invalid"),
    ],
)
def test_damaged_transforms_are_one_line(tmp_path, content, says):
    with pytest.raises(InputError, match=says):
        candidates(tmp_path, content)
