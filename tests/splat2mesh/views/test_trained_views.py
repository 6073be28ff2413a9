"""The cameras of a capture: every kind read to the same views, found beside the splat, and checked against it."""

import json

import numpy as np
import pytest
from ball_splats import solid_ball
from scipy.spatial.transform import Rotation

from scenes.cameras import write_colmap
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.render.view import View
from splat2mesh.splats.formats import write_splats
from splat2mesh.splats.placing import placed, similarity
from splat2mesh.views.cameras import cameras_beside, read_cameras, trained_views, usable_views

GL = np.diag([1.0, -1.0, -1.0, 1.0])


def orbit(count=12, radius=6.0, width=320, height=240):
    """Cameras around the origin that all look at it, none of them level."""
    rng = np.random.default_rng(0)
    eyes = rng.normal(size=(count, 3))
    eyes *= radius / np.linalg.norm(eyes, axis=1, keepdims=True)
    return [View.look_at(eye, [0, 0, 0], [0.1, -1, 0.2], 50.0, width, height) for eye in eyes]


def world_from_camera(view):
    return np.linalg.inv(view.camera_from_world)


def cameras_json(views):
    return [
        {
            "id": k,
            "img_name": f"{k:05d}",
            "width": view.width,
            "height": view.height,
            "position": world_from_camera(view)[:3, 3].tolist(),
            "rotation": world_from_camera(view)[:3, :3].tolist(),
            "fx": view.fx,
            "fy": view.fy,
        }
        for k, view in enumerate(views)
    ]


def transforms(views, **more):
    view = views[0]
    shared = {"fl_x": view.fx, "fl_y": view.fy, "cx": view.cx, "cy": view.cy, "w": view.width, "h": view.height}
    frames = [{"file_path": "a.png", "transform_matrix": (world_from_camera(v) @ GL).tolist()} for v in views]
    return {"camera_model": "OPENCV", "k1": 0.01, **shared, **more, "frames": frames}


def store(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))
    return path


def assert_same_views(found, expected):
    assert len(found) == len(expected)
    for a, b in zip(found, expected, strict=True):
        for name in ("width", "height", "fx", "fy", "cx", "cy"):
            assert getattr(a, name) == pytest.approx(getattr(b, name), rel=1e-14)
        # An inverse and a polar decomposition in float64.
        np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=1e-12)


def moved_views(views, matrix):
    """Views in a world moved by a similarity (4, 4)."""
    scale = np.cbrt(np.linalg.det(matrix[:3, :3]))
    found = []
    for view in views:
        pose = matrix @ world_from_camera(view)
        pose[:3, :3] /= scale
        found.append(View(view.width, view.height, view.fx, view.fy, view.cx, view.cy, np.linalg.inv(pose)))
    return found


def test_cameras_json_is_read_as_inria_means_it(tmp_path):
    views = orbit()
    (found,) = read_cameras(store(tmp_path / "any name", cameras_json(views)))
    assert_same_views(found, views)


def test_transforms_json_is_read_as_nerfstudio_means_it(tmp_path):
    views = orbit()
    (found,) = read_cameras(store(tmp_path / "transforms.json", transforms(views)))
    assert_same_views(found, views)
    (found,) = read_cameras(tmp_path)  # the folder that holds it
    assert_same_views(found, views)


def test_intrinsics_of_single_frames_overrule_the_shared_ones(tmp_path):
    views = [*orbit(3), *orbit(3, width=100, height=200)]
    content = transforms(views)
    for frame, view in zip(content["frames"], views, strict=True):
        frame |= {"fl_x": view.fx, "fl_y": view.fy, "cx": view.cx, "cy": view.cy, "w": view.width, "h": view.height}
    (found,) = read_cameras(store(tmp_path / "a.json", content))
    assert_same_views(found, views)


def test_angles_instead_of_focal_lengths_and_pictures_of_unknown_size(tmp_path):
    view = View.look_at([0, 0, -3], [0, 0, 0], [0, -1, 0], 50.0, 800)
    frames = transforms([view])["frames"]
    path = store(tmp_path / "transforms_train.json", {"camera_angle_x": np.radians(50.0), "frames": frames})
    with pytest.warns(DataWarning, match="gives no picture size"):
        (found,) = read_cameras(path)
    assert_same_views(found, [view])


def test_colmap_stays_what_it_was(tmp_path):
    (tmp_path / "cameras.txt").write_text("7 PINHOLE 640 480 500 510 320 240\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0.5 -0.25 2 7 a.png\n\n")
    (tmp_path / "points3D.txt").write_text("")
    ((view,),) = read_cameras(tmp_path)
    assert (view.fx, view.fy) == (500, 510)
    np.testing.assert_array_equal(view.camera_from_world[:3, 3], [0.5, -0.25, 2])


@pytest.fixture
def output(tmp_path):
    """The output folder of a training by INRIA's code, with the ball that its cameras look at."""
    splat = tmp_path / "garden" / "point_cloud" / "iteration_30000" / "point_cloud.ply"
    splat.parent.mkdir(parents=True)
    write_splats(splat, solid_ball())
    store(tmp_path / "garden" / "cameras.json", cameras_json(orbit()))
    return splat


def test_cameras_of_the_training_are_found_by_themselves_unless_refused(output, tmp_path, monkeypatch):
    assert_same_views(trained_views(None, output, solid_ball()), orbit())
    assert trained_views("none", output, solid_ball()) == []
    assert cameras_beside(output.parent) == tmp_path / "garden" / "cameras.json"
    monkeypatch.chdir(output.parent)
    assert_same_views(trained_views(None, "point_cloud.ply", solid_ball()), orbit())
    elsewhere = tmp_path / "garden" / "exports" / "final" / "point_cloud.ply"
    assert cameras_beside(elsewhere) is None and trained_views(None, elsewhere, solid_ball()) == []


def test_cameras_that_see_nothing_of_the_splat_are_of_another_scene(output):
    aside = moved_views(orbit(), similarity(translation=[50.0, 0, 0]))
    path = store(output.parents[2] / "cameras.json", cameras_json(aside))
    with pytest.raises(InputError, match=r"none of its 12 cameras sees a solid splat .*`cameras` none") as error:
        trained_views(None, output, solid_ball())
    assert "\n" not in str(error.value)
    with pytest.raises(InputError, match=r"none of its 12 cameras sees .* give those of this capture"):
        trained_views(path, output, solid_ball())


def test_blind_and_lost_cameras_are_dropped_and_counted(output):
    views = orbit()
    content = cameras_json([*views, *moved_views(views[:2], similarity(translation=[50.0, 0, 0])), views[0]])
    content[-1]["position"] = [float("nan")] * 3
    path = store(output.parent / "c.json", content)
    with pytest.warns(DataWarning, match="of 15 cameras, 1 that have no finite numbers and 2 that see no solid splat"):
        assert_same_views(trained_views(path, output, solid_ball()), views)


@pytest.mark.parametrize("spoilt", ["width", "fx"])
def test_a_camera_whose_own_numbers_are_none_is_dropped_and_counted(output, spoilt):
    views = orbit()
    content = [*cameras_json(views), cameras_json(views)[0] | {spoilt: float("nan")}]
    with pytest.warns(DataWarning, match="of 13 cameras, 1 that have no finite numbers"):
        assert_same_views(trained_views(store(output.parent / "c.json", content), output, solid_ball()), views)


@pytest.mark.parametrize("word", ["nan", "-inf"])
def test_a_colmap_image_without_numbers_is_dropped_and_counted(tmp_path, word):
    views = orbit()
    write_colmap(tmp_path, views)
    lines = (tmp_path / "images.txt").read_text().splitlines(keepends=True)
    row = next(k for k, line in enumerate(lines) if line.startswith("3 "))
    words = lines[row].split()
    lines[row] = " ".join([words[0], word, *words[2:]]) + "\n"
    (tmp_path / "images.txt").write_text("".join(lines))
    with pytest.warns(DataWarning, match="of 12 cameras, 1 that have no finite numbers"):
        found = trained_views(tmp_path, "a.ply", solid_ball())
    centers = [view.center for number, view in enumerate(views, 1) if number != 3]
    np.testing.assert_allclose([view.center for view in found], centers, atol=1e-9)
    with pytest.warns(DataWarning, match="of 12 cameras, 1 that"):
        assert len(usable_views(tmp_path)) == 11


@pytest.mark.parametrize("names", [["0", "1", "2"], ["2", "11", "3"], ["0", ".", "1"]])
def test_of_several_colmap_models_the_one_with_most_cameras_that_see_the_splat_is_used(tmp_path, names):
    """The first has 2, the second 9 that see it and one that does not, the third more that see nothing."""
    aside = moved_views(orbit(), similarity(translation=[50.0, 0, 0]))
    for name, views in zip(names, [orbit()[:2], [*orbit()[:9], aside[0]], aside], strict=True):
        (tmp_path / "sparse" / name).mkdir(parents=True, exist_ok=True)
        write_colmap(tmp_path / "sparse" / name, views)
    with pytest.warns(DataWarning) as seen:
        assert len(trained_views(tmp_path, "a.ply", solid_ball())) == 9
    used, dropped = (str(warning.message) for warning in seen)
    chosen = "sparse" if names[1] == "." else f"sparse/{names[1]}"
    assert f"of its 3 COLMAP models {chosen} is used, the one with most usable cameras (9; sparse/" in used
    assert "of 10 cameras, 1 that see no solid splat" in dropped


def test_a_model_that_is_named_is_used(tmp_path):
    for name, views in (("0", orbit()[:2]), ("1", orbit())):
        (tmp_path / name).mkdir()
        write_colmap(tmp_path / name, views)
    assert len(trained_views(tmp_path / "0", "a.ply", solid_ball())) == 2


def test_a_damaged_model_beside_a_good_one_is_left_out(tmp_path):
    for name in "01":
        (tmp_path / name).mkdir()
        write_colmap(tmp_path / name, orbit())
    (tmp_path / "0" / "images.txt").write_text("this is prose")
    with pytest.warns(DataWarning, match=r"left out 1 of 2 COLMAP models: .*0: cannot read images\.txt"):
        assert len(usable_views(tmp_path)) == 12


TURN = similarity(0.4, Rotation.from_euler("xyz", [70, 20, 10], degrees=True).as_matrix(), [0.3, -0.2, 0.1])


def bumpy():
    """Splats that look the same from no two sides: the ball, and a small one beside it."""
    from splat2mesh.splats.joining import joined

    return joined([solid_ball(), placed(solid_ball(), similarity(0.3, translation=[2.4, 0.8, 0.0]))])


@pytest.mark.parametrize("beside", ["splat", "transforms"])
def test_nerfstudios_training_frame_is_applied_where_the_splat_is_in_it(tmp_path, monkeypatch, beside):
    monkeypatch.setattr("splat2mesh.views.cameras.CLEARLY", 0.999)  # two balls look much alike from everywhere
    scale = 0.4
    rigid = TURN.copy()
    rigid[:3] /= scale
    folder = tmp_path / ("run" if beside == "splat" else "data")
    path = store(tmp_path / "data" / "transforms.json", transforms(orbit()))
    store(folder / "dataparser_transforms.json", {"transform": rigid[:3].tolist(), "scale": scale})
    splat = tmp_path / "run" / "splat.ply"
    trained = placed(bumpy(), TURN)
    assert_same_views(trained_views(path, splat, trained), moved_views(orbit(), TURN))
    # A splat of a trainer that takes the poses as they are, though nerfstudio ran too.
    assert_same_views(trained_views(path, splat, bumpy()), orbit())


def test_a_splat_in_colmaps_frame_undoes_what_nerfstudio_applied(tmp_path, monkeypatch):
    monkeypatch.setattr("splat2mesh.views.cameras.CLEARLY", 0.999)  # two balls look much alike from everywhere
    applied = similarity(rotation=[[1, 0, 0], [0, 0, 1], [0, -1, 0]], translation=[0.5, 0, -2.0])
    content = transforms(moved_views(orbit(), applied), applied_transform=applied[:3].tolist())
    path = store(tmp_path / "transforms.json", content)
    assert_same_views(trained_views(path, tmp_path / "a.ply", bumpy()), orbit())
    assert_same_views(trained_views(path, tmp_path / "a.ply", placed(bumpy(), applied)), moved_views(orbit(), applied))


def without(content, key):
    return [{name: value for name, value in content[0].items() if name != key}]


INRIA = cameras_json(orbit(1))
BAD = {
    "no JSON": ("{", "not valid JSON"),
    "a number": ("7", "holds no cameras; expected a COLMAP folder"),
    "another object": ('{"splats": []}', "holds no cameras"),
    "a list of numbers": ("[1, 2]", "holds no cameras"),
    "empty": ("[]", "its list is empty"),
    "no frames": ('{"frames": []}', "its list is empty"),
    "no position": (without(INRIA, "position"), "camera 1 is not an INRIA camera .*position"),
    "no focal length": (without(INRIA, "fx"), "camera 1 is not an INRIA camera .*fx"),
    "short position": ([INRIA[0] | {"position": [1, 2]}], "camera 1 is not an INRIA camera"),
    "no size": ([INRIA[0] | {"width": 0}], "no usable picture: 0 x 240"),
    "text": ([INRIA[0] | {"fx": "wide"}], "holds no numbers"),
    "no rotation": ([INRIA[0] | {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 2]]}], "its rotation is invalid"),
    "mirror": ([INRIA[0] | {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}], "its rotation is invalid"),
    "no matrix": ({"frames": [{"fl_x": 1}]}, "frame 1 is not a nerfstudio frame"),
    "panorama": (transforms(orbit(1), camera_model="EQUIRECTANGULAR"), "panoramas"),
    "bad applied": (transforms(orbit(1), applied_transform=[[0, 0, 0, 0]] * 3), "applied_transform is invalid"),
}


@pytest.mark.parametrize("case", BAD)
@pytest.mark.filterwarnings("ignore:.*gives no picture size")
def test_bad_camera_files_are_refused_in_one_line(tmp_path, case):
    content, message = BAD[case]
    path = tmp_path / "bad.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(InputError, match=message) as error:
        trained_views(path, tmp_path / "a.ply", solid_ball())
    assert "\n" not in str(error.value) and "bad.json" in str(error.value)


def test_a_missing_file_and_a_folder_of_something_else(tmp_path):
    with pytest.raises(InputError, match=r"cannot read .*nothing"):
        read_cameras(tmp_path / "nothing")
    with pytest.raises(InputError, match="no COLMAP model lies in this folder; expected a COLMAP folder"):
        read_cameras(tmp_path)
