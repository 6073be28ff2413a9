"""Scenes of several splats: each object as if alone, then where the layout says; one clear line for a bad layout."""

import json
import math

import numpy as np
import open3d as o3d
import pytest
from ball_splats import solid_ball
from scipy.spatial.transform import Rotation

import splat2mesh.layout
from splat2mesh import convert, plan_mesh
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.layout import is_layout, read_layout
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import source_parts, source_splats
from splat2mesh.splats.formats import read_splats, write_splats
from splat2mesh.splats.joining import joined
from splat2mesh.splats.placing import placed, similarity
from splat2mesh.surface.extract import EFFORTS, Effort

QUICK = Effort(views=12, pixels=96, cells=80)
"""A detail below draft: where a mesh comes to stand does not depend on its accuracy."""

SETTINGS = {"detail": "draft", "vertices": 1500, "max_chunk_vertices": 1000}
ATTRIBUTES = ("vertices", "normals", "faces", "colors_srgb")


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setitem(EFFORTS, "draft", QUICK)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the splat files `object.ply` and `deep/bust.spz`."""
    folder = tmp_path_factory.mktemp("layouts")
    (folder / "deep").mkdir()
    write_splats(folder / "object.ply", lopsided([1.5, -1.7, 0.8], 0.5))
    write_splats(folder / "deep" / "bust.spz", lopsided([-0.5, -2.0, 1.2], 0.6), "spz")
    return folder


def lopsided(knob, size):
    """A ball with a smaller one on it: no turn and no mirror image of it is the same."""
    return joined([solid_ball(), placed(solid_ball(), similarity(size, translation=knob))])


def layout(folder, *objects, name="room.json"):
    path = folder / name
    path.write_text(json.dumps({"objects": objects}), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def alone(folder):
    """Both files, converted by themselves."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EFFORTS, "draft", QUICK)
        return [convert(folder / name, **SETTINGS) for name in ("object.ply", "deep/bust.spz")]


TURN = Rotation.from_euler("xyz", [30, 80, -50], degrees=True)
QUAT_WXYZ = (3 * TURN.as_quat()[[3, 0, 1, 2]]).tolist()
OBJECTS = (
    {"splat": "object.ply", "position": [-1, 0.5, 0], "rotation_deg": 90},
    {"splat": "deep/bust.spz", "position": [2, 0, 0], "scale": 0.5, "quat_wxyz": QUAT_WXYZ},
)
PLACES = (
    similarity(1.0, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [-1, 0.5, 0]),
    similarity(0.5, TURN.as_matrix(), [2, 0, 0]),
)


@pytest.fixture(scope="module")
def room(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EFFORTS, "draft", QUICK)
        return convert(layout(folder, *OBJECTS), **SETTINGS)


def test_an_object_placed_nowhere_is_the_same_to_the_bit(folder, alone):
    found = convert(layout(folder, {"splat": "object.ply"}, name="one.json"), **SETTINGS)
    assert len(found.chunks) == len(alone[0].chunks) > 1
    for chunk, expected in zip(found.chunks, alone[0].chunks, strict=True):
        for name in ATTRIBUTES:
            np.testing.assert_array_equal(getattr(chunk, name), getattr(expected, name), name)
            assert getattr(chunk, name).dtype == getattr(expected, name).dtype


def test_each_object_is_what_it_is_alone_and_stands_where_the_layout_says(room, alone):
    entries = room.source["objects"]
    first = 0
    for entry, by_itself, place in zip(entries, alone, PLACES, strict=True):
        assert entry["chunks"] == [first, first + len(by_itself.chunks)]
        for chunk, expected in zip(room.chunks[slice(*entry["chunks"])], by_itself.chunks, strict=True):
            vertices = expected.vertices @ place[:3, :3].T + place[:3, 3]
            np.testing.assert_allclose(chunk.vertices, vertices, atol=1e-6)
            length = np.cbrt(np.linalg.det(place[:3, :3]))
            np.testing.assert_allclose(chunk.normals, expected.normals @ place[:3, :3].T / length, atol=1e-6)
            np.testing.assert_array_equal(chunk.faces, expected.faces)
            np.testing.assert_array_equal(chunk.colors_srgb, expected.colors_srgb)
        np.testing.assert_allclose(entry["scene_from_splat"], place @ by_itself.scene_from_splat, atol=1e-15)
        first = entry["chunks"][1]
    assert first == len(room.chunks)


def test_the_scene_lists_its_content(room, alone, folder):
    np.testing.assert_array_equal(room.scene_from_splat, np.eye(4))
    assert room.preview_camera is None
    assert room.source["file"] == "room.json" and room.source["path"] == str(folder / "room.json")
    assert [entry["name"] for entry in room.source["objects"]] == ["object", "bust"]
    assert [entry["file"] for entry in room.source["objects"]] == ["object.ply", "bust.spz"]
    for name in ("splats", "vertices", "faces", "views"):
        assert room.statistics[name] == sum(by_itself.statistics[name] for by_itself in alone)
    assert room.settings["detail"] == "draft" and room.settings["max_chunk_vertices"] == 1000
    reason = room.settings["objects"]["bust"]["up_from"]
    assert reason.startswith("assumed -y, since no plane stands out as a floor")
    assert room.settings["objects"]["bust"] == {
        "vertices": 1500,
        "up": "auto",
        "cameras": "virtual",
        "lod": "auto",
        "up_from": reason,
    }


def distances(splats, chunks):
    """From the centres of solid splats to the mesh of some chunks, (N,)."""
    tracer = o3d.t.geometry.RaycastingScene()
    for chunk in chunks:
        tracer.add_triangles(chunk.vertices, chunk.faces.astype(np.uint32))
    return tracer.compute_distance(splats.means[splats.opacities > 0.5]).numpy()


def test_it_reads_back_and_its_splats_stand_to_the_mesh_as_they_do_alone(room, alone, folder, tmp_path):
    room.save(tmp_path / "room")
    read = Scene.load(tmp_path / "room")
    assert read.source == room.source and read.settings == room.settings
    splats, paths = source_splats(read)
    assert paths == [folder / "object.ply", folder / "deep" / "bust.spz"] and len(splats) == room.statistics["splats"]
    for part, by_itself, place in zip(source_parts(read), alone, PLACES, strict=True):
        found = distances(part.splats, [read.chunks[i] for i in part.chunks]) / np.cbrt(np.linalg.det(place[:3, :3]))
        upright = placed(read_splats(part.path), by_itself.scene_from_splat)
        np.testing.assert_allclose(found, distances(upright, by_itself.chunks), atol=1e-5)  # float32 of lengths near 3
        assert np.median(found) < 0.02 * by_itself.diagonal  # trained centres lie below the surface


def test_one_object_hides_the_sky_from_another(folder, alone):
    """Rays straight up from below meet the object above: what relight needs to let them shadow one another."""
    low, high = alone[0].bounds
    above = {"splat": "object.ply", "position": [0, 3 * (high - low)[1], 0]}
    stacked = convert(layout(folder, {"splat": "object.ply"}, above, name="stack.json"), **SETTINGS)
    tracer = o3d.t.geometry.RaycastingScene()
    tracer.add_triangles(stacked.vertices, stacked.faces.astype(np.uint32))
    middle = (low + high) / 2
    rays = np.array([[*middle, 0, 1, 0], [*middle, 0, 1, 0]], np.float32)
    rays[:, 1] = high[1] + (high - low)[1] * np.array([0.5, 3.5])  # between the two, and over both
    assert tracer.test_occlusions(o3d.core.Tensor(rays)).numpy().tolist() == [True, False]


def test_the_same_splat_is_converted_once_and_its_places_are_distinct(folder, monkeypatch):
    calls = []
    original = splat2mesh.layout.converted
    monkeypatch.setattr(splat2mesh.layout, "converted", lambda *a, **k: calls.append(a[1]) or original(*a, **k))
    twins = [{"splat": "object.ply", "position": [x, 0, 0]} for x in (0, 5, 10)]
    path = layout(folder, *twins, {"splat": "object.ply", "vertices": 800, "name": "small"}, name="twins.json")
    found = convert(path, **SETTINGS)
    assert [call.vertices for call in calls] == [1500, 800]
    entries = found.source["objects"]
    assert [entry["name"] for entry in entries] == ["object", "object-2", "object-3", "small"]
    first, second = (found.chunks[entry["chunks"][0]] for entry in entries[:2])
    np.testing.assert_allclose(second.vertices, first.vertices + np.array([5, 0, 0]), atol=1e-6)
    count = sum(len(chunk.vertices) for chunk in found.chunks[slice(*entries[3]["chunks"])])
    assert count < 1000 and found.settings["objects"]["small"]["vertices"] == 800


def test_an_angle_turns_counter_clockwise_seen_from_above(folder):
    for angle, image in ((90, [1, 0, 0]), (-90, [-1, 0, 0]), (180, [0, 0, -1]), (450, [1, 0, 0]), (360, [0, 0, 1])):
        (placement,) = read_layout(layout(folder, {"splat": "object.ply", "rotation_deg": angle}, name="turn.json"))
        np.testing.assert_array_equal(placement.scene_from_upright[:3, :3] @ [0, 0, 1], image)
    (placement,) = read_layout(layout(folder, {"splat": "object.ply", "rotation_deg": 33.5}, name="turn.json"))
    expected = Rotation.from_euler("y", 33.5, degrees=True).as_matrix()
    np.testing.assert_allclose(placement.scene_from_upright[:3, :3], expected, atol=1e-15)


def test_scale_comes_first_and_position_last(folder):
    entry = {"splat": "object.ply", "scale": 3, "rotation_deg": 90, "position": [10, 20, 30]}
    (placement,) = read_layout(layout(folder, entry, name="order.json"))
    np.testing.assert_array_equal(placement.scene_from_upright @ [0, 1, 2, 1], [16, 23, 30, 1])


def test_warnings_and_errors_name_the_object(folder):
    splats = read_splats(folder / "object.ply")
    splats.means[:7, 0] = np.nan
    write_splats(folder / "holes.ply", splats)
    write_splats(folder / "few.ply", splats.take(slice(100, 105)))
    with pytest.warns(DataWarning, match="^left: dropped splats: 7 with a NaN"):
        convert(layout(folder, {"splat": "holes.ply", "name": "left"}, name="w.json"), **SETTINGS)
    path = layout(folder, {"splat": "object.ply"}, {"splat": "few.ply"}, name="few.json")
    with pytest.raises(InputError, match=r"^few: 5 of 5 splats are usable"):
        plan_mesh(path)


def test_the_plan_says_where_everything_goes(folder, room):
    found = plan_mesh(folder / "room.json", detail="draft")
    assert found["splats"] == room.statistics["splats"] and list(found["objects"]) == ["object", "bust"]
    for entry in room.source["objects"]:
        planned = found["objects"][entry["name"]]
        np.testing.assert_allclose(planned["scene_from_splat"], entry["scene_from_splat"], atol=1e-15)
        assert planned["splat"] == entry["path"]
    json.dumps(found)


def test_options_are_for_all_objects_that_do_not_say(folder):
    path = layout(folder, {"splat": "object.ply"}, {"splat": "object.ply", "up": "+z"}, name="up.json")
    found = plan_mesh(path, up="+y", detail="draft")["objects"]
    np.testing.assert_array_equal(found["object"]["scene_from_splat"], np.eye(4))
    assert found["object-2"]["scene_from_splat"] != found["object"]["scene_from_splat"]
    with pytest.raises(InputError, match="`cameras` sparse: in a layout, give each object its own"):
        convert(path, cameras="sparse")
    with pytest.raises(InputError, match="`detail` bold"):
        convert(path, detail="bold")
    with pytest.raises(InputError, match="`vertices` 0"):
        convert(path, vertices=0)


def test_a_layout_differs_from_a_sog(tmp_path):
    for name, text, expected in (
        ("room.json", '{"objects": []}', True),
        ("broken.json", "{", True),
        ("sog.json", '{"means": {}, "version": 2}', False),
        ("meta.json", "{", False),
        ("room.ply", "{}", False),
    ):
        (tmp_path / name).write_text(text)
        assert is_layout(tmp_path / name) == expected
    assert not is_layout(tmp_path / "nothing.json") and not is_layout(tmp_path)


GOOD = {"splat": "object.ply"}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "not valid JSON"),
        ("{", "not valid JSON"),
        (b"\xff\xfe", "not valid JSON"),
        ([1], "is not a layout"),
        ({}, "is not a layout"),
        ({"objects": []}, "is not a layout"),
        ({"objects": GOOD}, "is not a layout"),
        ({"objects": [GOOD], "light": "noon"}, "unknown key 'light'"),
        ('{"objects": [{"splat": "object.ply", "scale": 1, "scale": 2}]}', "'scale' appears twice"),
        ("object.ply", r"object 2: expected \{"),
        ({"position": [0, 0, 0]}, "object 2: lacks 'splat'"),
        ({"splat": 7}, "splat must be the name of a file, found 7"),
        ({"splat": ""}, "splat must be the name of a file"),
        ({"splat": "nothing.ply"}, r"object 2: .*nothing.ply does not exist: paths are relative to the layout"),
        ({**GOOD, "cameras": "sparse"}, r"sparse does not exist"),
        ({**GOOD, "positoin": [0, 0, 0]}, "unknown key 'positoin': expected splat name position"),
        ({**GOOD, "position": [0, 0]}, r"position must be \[3 finite numbers\], found \[0, 0\]"),
        ({**GOOD, "position": 5}, r"position must be \[3 finite numbers\], found 5"),
        ({**GOOD, "position": [0, math.nan, 0]}, r"position must be .* found \[0, NaN, 0\]"),
        ({**GOOD, "position": [0, math.inf, 0]}, "position must be"),
        ({**GOOD, "position": [0, "1", 0]}, "position must be"),
        ({**GOOD, "position": [0, True, 0]}, "position must be"),
        ({**GOOD, "position": [0, 1e30, 0]}, "position must be within"),
        ({**GOOD, "position": [0, 10**400, 0]}, "position must be"),
        ({**GOOD, "scale": -1}, "scale must be a positive factor, 1e-06 to 1e.06, found -1"),
        ({**GOOD, "scale": 0}, "scale must be a positive factor"),
        ({**GOOD, "scale": 1e9}, "scale must be a positive factor"),
        ({**GOOD, "scale": [1, 1, 2]}, r"scale must be a finite number, found \[1, 1, 2\]"),
        ({**GOOD, "scale": math.nan}, "scale must be a finite number, found NaN"),
        ({**GOOD, "rotation_deg": [0, 90, 0]}, r"rotation_deg must be a finite number, found \[0, 90, 0\]"),
        ({**GOOD, "quat_wxyz": [1, 0, 0]}, r"quat_wxyz must be \[4 finite numbers\]"),
        ({**GOOD, "quat_wxyz": [0, 0, 0, 0]}, "quat_wxyz must not be all zero"),
        ({**GOOD, "quat_wxyz": [1, 0, 0, 0], "rotation_deg": 0}, "not both"),
        ({**GOOD, "up": "x"}, "up must be one of auto"),
        ({**GOOD, "up": ["+y"]}, "up must be one of auto"),
        ({**GOOD, "vertices": 3}, "vertices must be a whole number of at least 4, found 3"),
        ({**GOOD, "vertices": 1000.0}, "vertices must be a whole number"),
        ({**GOOD, "vertices": True}, "vertices must be a whole number"),
        ({**GOOD, "name": ""}, "name must be a text"),
        ({**GOOD, "name": "object"}, "another object is called 'object' already"),
    ],
)  # fmt: skip
def test_a_bad_layout_gets_one_clear_line(tmp_path, content, message):
    """content: of the file, or (without `objects`) its second object."""
    (tmp_path / "object.ply").touch()
    path = tmp_path / "bad.json"
    if content == "object.ply" or (isinstance(content, dict) and content and "objects" not in content):
        content = {"objects": [GOOD, content]}
    if not isinstance(content, (str, bytes)):
        content = json.dumps(content)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=message) as caught:
        read_layout(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_a_layout_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        read_layout(tmp_path / "absent.json")
