"""COLMAP models: text and binary read back exactly, broken ones are refused; choosing views that differ."""

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.render.view import View
from splat2mesh.views.cameras import read_cameras, spread_out, usable_views
from splat2mesh.views.colmap import read_colmap

PINHOLE = "7 PINHOLE 640 480 500.25 510.5 320.125 241.75"
POSED = "1 1 0 0 0 0.5 -0.25 2 7 a.png"


def some_views(count=5, seed=0):
    rng = np.random.default_rng(seed)
    views = []
    for k in range(count):
        eye = rng.normal(size=3) * 3
        views.append(View.look_at(eye, rng.normal(size=3), [0, -1, 0.1], 40.0 + k, 320 + k, 240 + 2 * k))
    return views


def write_text(folder, cameras, images, points=""):
    folder.mkdir()
    (folder / "cameras.txt").write_text("# Camera list\n" + "\n".join(cameras) + "\n")
    (folder / "images.txt").write_text("# Image list\n" + "".join(f"{image}\n\n" for image in images))
    (folder / "points3D.txt").write_text(points)
    return folder


def pose_text(view):
    x, y, z, w = Rotation.from_matrix(view.camera_from_world[:3, :3]).as_quat()
    return " ".join(repr(float(value)) for value in (w, x, y, z, *view.camera_from_world[:3, 3]))


def assert_views_equal(found, expected):
    assert len(found) == len(expected)
    for a, b in zip(found, expected, strict=True):
        assert (a.width, a.height, a.fx, a.fy, a.cx, a.cy) == (b.width, b.height, b.fx, b.fy, b.cx, b.cy)
        # Through a quaternion and back in float64.
        np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=1e-14)
        np.testing.assert_allclose(a.center, b.center, atol=1e-13)
        np.testing.assert_allclose(a.forward, b.forward, atol=1e-14)


def test_a_text_model_reads_back_exactly_in_the_order_of_the_image_ids(tmp_path):
    views = some_views()
    cameras = [
        f"{k + 1} PINHOLE {v.width} {v.height} {float(v.fx)!r} {float(v.fy)!r} {v.cx!r} {v.cy!r}"
        for k, v in enumerate(views)
    ]
    ids = [30, 4, 17, 2, 11]
    images = [f"{ids[k]} {pose_text(v)} {k + 1} {k}.png" for k, v in enumerate(views)]
    found = read_colmap(write_text(tmp_path / "model", cameras, images))
    assert_views_equal(found, [views[k] for k in np.argsort(ids)])


@pytest.mark.parametrize("named", [".", "sparse", "sparse/0"])
def test_a_model_is_found_in_the_folders_that_hold_it(tmp_path, named):
    (tmp_path / "sparse").mkdir()
    write_text(tmp_path / "sparse" / "0", [PINHOLE], [POSED])
    (views,) = read_cameras(tmp_path / named)
    assert len(views) == 1


def test_a_binary_model_written_by_colmap_itself_reads_back_exactly(tmp_path):
    views = some_views()
    model = pycolmap.Reconstruction()
    for k, view in enumerate(views, 1):
        camera = pycolmap.Camera(
            model="PINHOLE",
            width=view.width,
            height=view.height,
            params=[view.fx, view.fy, view.cx, view.cy],
            camera_id=k,
        )
        model.add_camera_with_trivial_rig(camera)
        image = pycolmap.Image(name=f"{k}.png", camera_id=k, image_id=k)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(view.camera_from_world[:3]))
    (tmp_path / "model").mkdir()
    model.write_binary(str(tmp_path / "model"))
    assert (tmp_path / "model" / "cameras.bin").is_file()
    assert_views_equal(read_colmap(tmp_path / "model"), views)


@pytest.mark.parametrize(
    ("camera", "intrinsics"),
    [
        ("1 SIMPLE_PINHOLE 640 480 500.25 320.5 241", (500.25, 500.25, 320.5, 241.0)),
        ("1 SIMPLE_RADIAL 640 480 500.25 320.5 241 -0.1", (500.25, 500.25, 320.5, 241.0)),
        ("1 RADIAL 640 480 500.25 320.5 241 -0.1 0.02", (500.25, 500.25, 320.5, 241.0)),
        ("1 OPENCV 640 480 500.25 498 320.5 241 0.1 -0.2 0.001 0.002", (500.25, 498.0, 320.5, 241.0)),
        ("1 SIMPLE_FISHEYE 640 480 500.25 320.5 241", (500.25, 500.25, 320.5, 241.0)),
        ("1 EUCM 640 480 500.25 498 320.5 241 0.6 1.1", (500.25, 498.0, 320.5, 241.0)),
    ],
    ids=lambda value: value.split()[1] if isinstance(value, str) else "",
)
def test_models_with_distortion_keep_focal_length_and_principal_point(tmp_path, camera, intrinsics):
    (view,) = read_colmap(write_text(tmp_path / "model", [camera], ["1 1 0 0 0 0 0 0 1 a.png"]))
    assert (view.width, view.height) == (640, 480)
    assert (view.fx, view.fy, view.cx, view.cy) == intrinsics


KINDS = list(map(pycolmap.CameraModelId, range(17)))
PANORAMA = pycolmap.CameraModelId(17)


def written_by_colmap(folder, kinds, binary=True):
    """A model of one image for each kind of camera, written by COLMAP."""
    model = pycolmap.Reconstruction()
    for k, (kind, view) in enumerate(zip(kinds, some_views(len(kinds)), strict=True), 1):
        model.add_camera_with_trivial_rig(
            pycolmap.Camera.create_from_model_id(k, kind, 500.0 + k, view.width, view.height)
        )
        image = pycolmap.Image(name=f"{k}.png", camera_id=k, image_id=k)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(view.camera_from_world[:3]))
    folder.mkdir()
    (model.write_binary if binary else model.write_text)(str(folder))
    return folder


@pytest.mark.parametrize("binary", [True, False])
def test_every_camera_of_colmap_keeps_focal_length_and_principal_point(tmp_path, binary):
    found = read_colmap(written_by_colmap(tmp_path / "model", KINDS, binary))
    middle = [(view.width / 2, view.height / 2) for view in some_views(len(KINDS))]
    assert [(view.fx, view.fy) for view in found] == [(500.0 + k, 500.0 + k) for k in range(1, len(KINDS) + 1)]
    assert [(view.cx, view.cy) for view in found] == middle


@pytest.mark.parametrize("binary", [True, False])
def test_panoramas_are_named_and_left_out_beside_pictures(tmp_path, binary):
    with pytest.raises(InputError, match="its pictures are panoramas, and only pinhole"):
        read_colmap(written_by_colmap(tmp_path / "all", [PANORAMA, PANORAMA], binary))
    found = read_colmap(written_by_colmap(tmp_path / "some", [PANORAMA, KINDS[0]], binary))
    assert found[0] == "are panoramas" and found[1].fx == 502.0
    with pytest.warns(DataWarning, match="of 2 cameras, 1 that are panoramas"):
        assert len(usable_views(tmp_path / "some")) == 1


def test_a_point_seen_in_two_images_does_not_disturb_the_poses(tmp_path):
    folder = write_text(tmp_path / "model", [PINHOLE], [], "1 0 0 5 10 20 30 0.1 3 0 4 0\n")
    images = [f"{key} 1 0 0 0 {key} 0 0 7 {key}.png\n320 240 1\n" for key in (3, 4)]
    (folder / "images.txt").write_text("".join(images))
    found = read_colmap(folder)
    np.testing.assert_array_equal([view.center for view in found], [[-3, 0, 0], [-4, 0, 0]])


@pytest.mark.parametrize("missing", [None, "folder", "images.txt"])
def test_a_folder_that_is_no_model_is_refused(tmp_path, missing):
    if missing is None:
        folder = tmp_path / "empty"
        folder.mkdir()
    elif missing == "folder":
        folder = tmp_path / "nothing"
    else:
        folder = write_text(tmp_path / "model", [PINHOLE], [POSED])
        (folder / missing).unlink()
    with pytest.raises(InputError, match=str(folder)) as error:
        read_colmap(folder)
    assert "\n" not in str(error.value)


BROKEN = {
    "no image": ([PINHOLE], []),
    "unknown model": (["7 LENSBABY 640 480 500 320 240"], [POSED]),
    "too few parameters": (["7 PINHOLE 640 480 500"], [POSED]),
    "unknown camera": ([PINHOLE], ["1 1 0 0 0 0 0 0 8 a.png"]),
    "prose for a camera": (["this is prose"], [POSED]),
    "prose for a pose": ([PINHOLE], ["this is prose"]),
    "NaN in a pose": ([PINHOLE], ["1 nan 0 0 0 0 0 0 7 a.png"]),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_model_is_refused_in_one_line_and_silently(tmp_path, case, capfd):
    folder = write_text(tmp_path / "model", *BROKEN[case])
    with pytest.raises(InputError, match=str(folder)) as error:
        read_colmap(folder)
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("content", [b"", b"junk\n", bytes(range(256))])
def test_a_broken_binary_model_is_refused(tmp_path, content):
    for name in ("cameras", "images", "points3D"):
        (tmp_path / f"{name}.bin").write_bytes(content)
    with pytest.raises(InputError, match=str(tmp_path)):
        read_colmap(tmp_path)


def test_spread_out_picks_distinct_views_that_lie_far_apart():
    # Four clusters of 25 cameras that differ by a hundredth of the clusters' distance.
    rng = np.random.default_rng(0)
    corners = np.repeat([[5.0, 0, 5], [-5, 0, 5], [-5, 0, -5], [5, 0, -5]], 25, axis=0)
    eyes = corners + rng.uniform(-0.05, 0.05, corners.shape)
    views = [View.look_at(eye, [0, 0, 0], [0, 1, 0], 40.0, 16) for eye in eyes]
    chosen = spread_out(views, 4)
    clusters = {tuple(np.sign(view.center[[0, 2]])) for view in chosen}
    assert len(clusters) == 4
    chosen = spread_out(views, 37)
    assert len({id(view) for view in chosen}) == 37
    order = [next(k for k, view in enumerate(views) if view is picked) for picked in chosen]
    assert order == sorted(order) and order[0] == 0


def test_spread_out_separates_cameras_in_one_place_by_direction():
    directions = [[0, 0, 1], [0.01, 0, 1], [0, 0.01, 1], [0, 0, -1], [0.01, 0, -1]]
    views = [View.look_at([0, 0, 0], direction, [0, 1, 0], 40.0, 16) for direction in directions]
    forward = [view.forward[2] for view in spread_out(views, 2)]
    np.testing.assert_allclose(sorted(forward), [-1, 1], atol=1e-3)


def test_spread_out_returns_all_where_there_are_no_more():
    views = some_views(3)
    for count in (3, 4, 100):
        chosen = spread_out(views, count)
        assert len(chosen) == 3 and all(a is b for a, b in zip(chosen, views, strict=True))
