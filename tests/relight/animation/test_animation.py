import json
import struct

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from relight.animation.animation import Animation, Track, moved, skinned
from relight.animation.film import FILM, FilmRequest, Shot, animate, encode, frame_times
from relight.light.environment import Environment
from relight.transfer.analytic import analytic
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.gltfnodes import for_normals, matrix_from_trs

COMPONENT = {"float32": 5126, "uint8": 5121, "uint16": 5123, "uint32": 5125, "int8": 5120, "int16": 5122}
KIND = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Glb:
    """A GLB under construction, by hand and not through the library that reads it."""

    def __init__(self):
        self.json = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "nodes": [], "meshes": []}
        self.json |= {"scenes": [{"nodes": [0]}], "scene": 0, "skins": [], "animations": []}
        self._blob = b""

    def view(self, data, **fields):
        self._blob += b"\0" * (-len(self._blob) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self._blob), "byteLength": len(data), **fields})
        self._blob += data
        return len(self.json["bufferViews"]) - 1

    def add(self, array, normalized=False, **fields):
        array = np.asarray(array)
        width = 1 if array.ndim == 1 else array.shape[1]
        kind = {"componentType": COMPONENT[array.dtype.name], "type": KIND[width], "count": len(array)}
        self.json["accessors"].append({"bufferView": self.view(array.tobytes()), **kind, **fields})
        if normalized:
            self.json["accessors"][-1]["normalized"] = True
        return len(self.json["accessors"]) - 1

    def animate(self, node, path, times, values, interpolation=None, name="act"):
        if not self.json["animations"]:
            self.json["animations"].append({"name": name, "channels": [], "samplers": []})
        animation = self.json["animations"][0]
        sampler = {"input": self.add(np.float32(times)), "output": self.add(np.float32(values))}
        if interpolation:
            sampler["interpolation"] = interpolation
        animation["samplers"].append(sampler)
        target = {"node": node, "path": path}
        animation["channels"].append({"sampler": len(animation["samplers"]) - 1, "target": target})

    def save(self, path):
        document = {key: value for key, value in self.json.items() if value != []}
        document["buffers"] = [{"byteLength": len(self._blob)}]
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        blob = self._blob + b"\0" * (-len(self._blob) % 4)
        size = 12 + 8 + len(text) + 8 + len(blob)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
        path.write_bytes(struct.pack("<III", 0x46546C67, 2, size) + chunks)
        return path


def patch(side=4, seed=0):
    """A bumpy square of side x side vertices: vertices, unit normals, faces."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side))
    vertices = np.stack([x, y, 0.1 * rng.random(x.shape)], axis=-1).reshape(-1, 3).astype(np.float32)
    normals = rng.normal(size=vertices.shape) * 0.2 + [0.0, 0.0, 1.0]
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = index[:-1, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel()
    return vertices, normals, np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])


def glb_of_patch(**node):
    glb = Glb()
    vertices, normals, faces = patch()
    attributes = {"POSITION": glb.add(vertices), "NORMAL": glb.add(normals)}
    primitive = {"attributes": attributes, "indices": glb.add(faces.ravel().astype(np.uint16))}
    glb.json["meshes"].append({"primitives": [primitive]})
    glb.json["nodes"].append({"mesh": 0, **node})
    return glb, vertices, normals, faces


def test_a_turning_node_turns_its_mesh_along_the_great_circle(tmp_path):
    glb, vertices, normals, faces = glb_of_patch(translation=[1.0, 2.0, 3.0], scale=[2.0, 2.0, 2.0])
    keys = Rotation.from_rotvec([[0.1, 0.2, 0.3], [1.0, -0.4, 0.8], [2.0, 2.0, -1.0]])
    quats = keys.as_quat()
    quats[1] *= -1.0  # the same rotation: the way between must still be the shorter one
    glb.animate(0, "rotation", [0.0, 1.0, 3.0], quats)
    animation = Animation(glb.save(tmp_path / "turn.glb"))
    assert animation.duration_s == 3.0 and animation.name == "act" and animation.moving == [0]
    np.testing.assert_array_equal(animation.chunks[0].faces, faces)
    for time_s, before, share in ((0.0, 0, 0.0), (0.3, 0, 0.3), (1.0, 1, 0.0), (2.2, 1, 0.6), (3.0, 1, 1.0)):
        ((moved_vertices, moved_normals),) = animation.at(time_s)
        step = keys[before + 1] * keys[before].inv()  # about one axis, at an even rate
        turn = (Rotation.from_rotvec(share * step.as_rotvec()) * keys[before]).as_matrix()
        # Coordinates up to 5, stored as float32: half a rounding is 2.4e-7.
        np.testing.assert_allclose(moved_vertices, 2.0 * vertices @ turn.T + [1.0, 2.0, 3.0], atol=6e-7)
        np.testing.assert_allclose(moved_normals, normals @ turn.T, atol=3e-7)
    np.testing.assert_array_equal(animation.at(-5.0)[0][0], animation.at(0.0)[0][0])
    np.testing.assert_array_equal(animation.at(9.0)[0][0], animation.at(3.0)[0][0])


def test_keyframes_between_are_what_the_interpolation_says():
    rng = np.random.default_rng(1)
    times, keys = np.array([0.5, 1.0, 2.5, 3.0]), rng.normal(size=(4, 3, 3))
    track = Track(times, keys, "CUBICSPLINE")
    # Tangents differ on both sides of a key: one Hermite spline for each segment.
    for i in range(3):
        segment = CubicHermiteSpline(times[i : i + 2], keys[i : i + 2, 1], [keys[i, 2], keys[i + 1, 0]])
        for time_s in np.linspace(times[i], times[i + 1], 7):
            np.testing.assert_allclose(track.at(time_s), segment(time_s), atol=1e-13)
    steps, lines = Track(times, keys[:, 1], "STEP"), Track(times, keys[:, 1])
    np.testing.assert_array_equal(steps.at(2.4999), keys[1, 1])
    np.testing.assert_array_equal(steps.at(2.5), keys[2, 1])
    for column in range(3):
        assert lines.at(1.7)[column] == pytest.approx(np.interp(1.7, times, keys[:, 1, column]), abs=1e-14)
    assert np.linalg.norm(Track([0, 1], rng.normal(size=(2, 3, 4)), "CUBICSPLINE", True).at(0.4)) == pytest.approx(1)


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_a_rotation_of_zeros_is_refused(interpolation):
    keys = np.ones((3, 3, 4)) if interpolation == "CUBICSPLINE" else np.ones((3, 4))
    Track([0, 1, 2], keys, interpolation, spherical=True)
    keys[1] = 0.0
    Track([0, 1, 2], keys, interpolation)  # a translation may be zero
    with pytest.raises(InputError, match="rotation 0 0 0 0"):
        Track([0, 1, 2], keys, interpolation, spherical=True)


def test_normals_stay_upright_under_any_matrix():
    rng = np.random.default_rng(2)
    for mirror in (1.0, -1.0):
        matrix = matrix_from_trs([1, 2, 3], rng.normal(size=4), [0.3 * mirror, 2.0, 0.7])
        triangle = rng.normal(size=(3, 3))
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])[None].astype(np.float32)
        place, turned = moved(triangle.astype(np.float32), np.repeat(normal, 3, axis=0), matrix)
        edges = place[1:] - place[:1]
        assert np.abs(edges @ turned[0]).max() < 1e-6 * np.abs(edges).max()
        expected = np.linalg.inv(matrix[:3, :3]).T @ normal[0]  # which a mirror does not turn inside
        assert expected @ turned[0] == pytest.approx(np.linalg.norm(expected), rel=1e-6)
    flat = np.diag([1.0, 0.0, 1.0, 1.0])
    np.testing.assert_allclose(for_normals(flat) @ [0.0, 1.0, 0.0], [0.0, 1.0, 0.0])


def test_parents_move_their_children(tmp_path):
    glb, vertices, _, _ = glb_of_patch(rotation=Rotation.from_rotvec([0, 0, 0.5]).as_quat().tolist())
    # The file names the child first; the shown root is node 1. A column-major matrix in between.
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec([0.4, 0, 0]).as_matrix() * 1.5, [0, 0, 5]
    glb.json["nodes"] += [{"children": [2]}, {"children": [0], "matrix": matrix.T.ravel().tolist()}]
    glb.json["scenes"] = [{"nodes": [1]}]
    glb.animate(1, "translation", [0.0, 2.0], [[0, 0, 0], [4, 0, -2]])
    glb.animate(1, "scale", [0.0, 2.0], [[1, 1, 1], [3, 1, 1]], "STEP")
    animation = Animation(glb.save(tmp_path / "family.glb"))
    inner = vertices @ Rotation.from_rotvec([0, 0, 0.5]).as_matrix().T
    middle = inner @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(animation.at(1.0)[0][0], middle + np.array([2, 0, -1]), atol=1e-6)
    np.testing.assert_allclose(animation.at(2.0)[0][0], middle * [3, 1, 1] + [4, 0, -2], atol=2e-6)


def arm_glb(weights_type):
    """An upright strip of 9 rows from y = 0 to 2, its elbow at y = 1, on two joints; and its weights on the forearm."""
    rows = np.linspace(0.0, 2.0, 9)
    vertices = np.array([[x, y, 0.0] for y in rows for x in (-0.1, 0.1)], np.float32)
    normals = np.tile(np.float32([0, 0, 1]), (len(vertices), 1))
    corner = 2 * np.arange(8)[:, None]
    faces = np.concatenate([corner + np.array([0, 1, 2]), corner + np.array([1, 3, 2])])
    forearm = np.clip((vertices[:, 1] - 0.75) / 0.5, 0.0, 1.0)
    influence = np.stack([1 - forearm, forearm, 0 * forearm, 0 * forearm], axis=1)
    glb = Glb()
    if weights_type == np.float32:
        weights = glb.add(influence.astype(np.float32))
    else:
        largest = np.iinfo(weights_type).max
        weights = glb.add(np.round(influence * largest).astype(weights_type), normalized=True)
    joints = np.tile(np.uint8([0, 1, 0, 0]), (len(vertices), 1))
    attributes = {"POSITION": glb.add(vertices), "NORMAL": glb.add(normals), "JOINTS_0": glb.add(joints)}
    attributes["WEIGHTS_0"] = weights
    indices = glb.add(faces.ravel().astype(np.uint8))
    glb.json["meshes"].append({"primitives": [{"attributes": attributes, "indices": indices}]})
    # The mesh hangs on a node of its own that moves; a skin ignores it. The arm stands at (5, 0, 0).
    glb.json["nodes"] = [
        {"children": [1, 2]},
        {"mesh": 0, "skin": 0, "translation": [7.0, 7.0, 7.0]},
        {"translation": [5.0, 0.0, 0.0], "children": [3]},
        {"translation": [0.0, 1.0, 0.0]},
    ]
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[1, 1, 3] = -1.0
    glb.json["skins"].append({"joints": [2, 3], "inverseBindMatrices": glb.add(_columns(inverse))})
    bend = Rotation.from_rotvec([[0, 0, 0], [np.pi / 2, 0, 0]])
    glb.animate(3, "rotation", [0.0, 1.0], bend.as_quat())
    return glb, vertices, normals, forearm


def _columns(matrices):
    return np.ascontiguousarray(matrices.transpose(0, 2, 1).reshape(len(matrices), 16), np.float32)


@pytest.mark.parametrize("weights_type", [np.float32, np.uint16, np.uint8])
def test_an_arm_of_two_bones_bends_as_linear_blending_says(tmp_path, weights_type):
    glb, vertices, _, forearm = arm_glb(weights_type)
    animation = Animation(glb.save(tmp_path / "arm.glb"))
    assert animation.moving == [0]
    tolerance = 1e-6 if weights_type == np.float32 else 2.5 / np.iinfo(weights_type).max  # of a weight, reach 1.5
    for time_s in (0.0, 0.25, 0.6, 1.0):
        ((place, turned),) = animation.at(time_s)
        angle = time_s * np.pi / 2
        turn = Rotation.from_rotvec([angle, 0, 0]).as_matrix()
        bent = (vertices - [0, 1, 0]) @ turn.T + [0, 1, 0]
        expected = vertices + forearm[:, None] * (bent - vertices) + [5, 0, 0]
        np.testing.assert_allclose(place, expected, atol=tolerance)
        # Of a bend about x the blend of two turns is a turn by half the angle where both weigh the same.
        elbow = np.abs(vertices[:, 1] - 1.0) < 1e-6
        half = Rotation.from_rotvec([angle / 2, 0, 0]).as_matrix() @ [0, 0, 1]
        np.testing.assert_allclose(turned[elbow], np.tile(half, (2, 1)), atol=2 * tolerance)
        np.testing.assert_allclose(turned[forearm == 1], np.tile(turn @ [0, 0, 1], (8, 1)), atol=2 * tolerance)
        np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1.0, atol=1e-6)


def test_skinning_by_one_joint_is_moving():
    rng = np.random.default_rng(3)
    vertices, normals, _ = patch(seed=3)
    matrix = matrix_from_trs([1, -2, 0.5], rng.normal(size=4), [1.2, -0.5, 2.0])
    joints, weights = np.tile([1, 0], (len(vertices), 1)), np.tile(np.float32([1, 0]), (len(vertices), 1))
    place, turned = skinned(vertices, normals, joints, weights, np.stack([np.full((4, 4), np.nan), matrix]))
    expected, expected_turned = moved(vertices, normals, matrix)
    np.testing.assert_allclose(place, expected, atol=1e-6)
    np.testing.assert_allclose(turned, expected_turned, atol=1e-6)


def test_vertices_without_a_joint_follow_the_first_one_with_a_warning(tmp_path):
    glb, vertices, *_ = arm_glb(np.float32)
    view = glb.json["bufferViews"][glb.json["accessors"][0]["bufferView"]]
    glb._blob = glb._blob[: view["byteOffset"]] + bytes(16) + glb._blob[view["byteOffset"] + 16 :]
    with pytest.warns(DataWarning, match="1 vertices without a joint"):
        animation = Animation(glb.save(tmp_path / "loose.glb"))
    np.testing.assert_allclose(animation.at(1.0)[0][0][0], vertices[0] + [5, 0, 0], atol=1e-6)


@pytest.mark.parametrize("sparse", [False, True])
def test_morph_targets_add_up(tmp_path, sparse):
    rng = np.random.default_rng(4)
    glb, vertices, normals, _ = glb_of_patch()
    rows = np.array([1, 4, 5, 11], np.uint16)
    change = np.zeros_like(vertices)
    change[rows] = rng.normal(size=(4, 3))
    lean = (0.1 * rng.normal(size=vertices.shape)).astype(np.float32)
    if sparse:  # no buffer view below it: zeros
        where = {"bufferView": glb.view(rows.tobytes()), "componentType": 5123}
        what = {"bufferView": glb.view(change[rows].tobytes())}
        accessor = {"componentType": 5126, "type": "VEC3", "count": len(vertices)}
        glb.json["accessors"].append({**accessor, "sparse": {"count": 4, "indices": where, "values": what}})
        first = {"POSITION": len(glb.json["accessors"]) - 1}
    else:
        first = {"POSITION": glb.add(change)}
    second = {"POSITION": glb.add(np.tile(np.float32([0, 0, 1]), (16, 1))), "NORMAL": glb.add(lean)}
    glb.json["meshes"][0]["primitives"][0]["targets"] = [first, second]
    glb.json["meshes"][0]["weights"] = [0.5, 0.0]
    glb.json["nodes"] += [{"mesh": 0, "weights": [-1.0, 2.0], "translation": [3.0, 0.0, 0.0]}, {"mesh": 0}]
    glb.json["scenes"] = [{"nodes": [0, 1, 2]}]
    glb.animate(0, "weights", [0.0, 1.0, 2.0], np.float32([0, 0, 1, 0.5, -1, 1]))  # two weights a key
    animation = Animation(glb.save(tmp_path / "morph.glb"))
    for time_s, (a, b) in {0.0: (0, 0), 0.5: (0.5, 0.25), 1.5: (0.0, 0.75), 2.0: (-1, 1)}.items():
        (place, turned), (still, _), (still_by_mesh, _) = animation.at(time_s)
        np.testing.assert_allclose(still, vertices - change + [3, 0, 2], atol=1e-6)
        np.testing.assert_allclose(still_by_mesh, vertices + 0.5 * change, atol=1e-6)
        np.testing.assert_allclose(place, vertices + a * change + [0, 0, b], atol=1e-6)
        expected = normals + b * lean
        expected /= np.linalg.norm(expected, axis=1, keepdims=True)
        np.testing.assert_allclose(turned, expected, atol=1e-6)


def test_missing_normals_follow_the_faces_in_every_frame(tmp_path):
    glb, vertices, _, faces = glb_of_patch()
    primitive = glb.json["meshes"][0]["primitives"][0]
    del primitive["attributes"]["NORMAL"]
    flat = -vertices * np.float32([0, 0, 1])
    primitive["targets"] = [{"POSITION": glb.add(flat)}]
    glb.animate(0, "weights", [0.0, 1.0], np.float32([0, 1]))
    animation = Animation(glb.save(tmp_path / "bare.glb"))
    np.testing.assert_allclose(animation.at(1.0)[0][1], np.tile([0, 0, 1], (16, 1)), atol=1e-7)
    assert np.abs(animation.at(0.0)[0][1] - [0, 0, 1]).max() > 0.05
    np.testing.assert_array_equal(animation.chunks[0].faces, faces)


def test_chunks_stand_in_node_order_and_only_some_move(tmp_path):
    glb, vertices, *_ = glb_of_patch()
    colors = np.tile(np.float32([[0.0, 0.2140, 1.0]]), (16, 1))  # linear .214 is sRGB 127.5
    other = {"POSITION": glb.add(vertices + 5), "COLOR_0": glb.add(colors)}
    strip = glb.add(np.array([0, 1, 4, 5], np.uint32))
    glb.json["meshes"].append({"primitives": [{"attributes": other, "indices": strip, "mode": 5}]})
    glb.json["nodes"] += [{"mesh": 1}, {"mesh": 1}]
    glb.json["scenes"] = [{"nodes": [0, 1]}]  # the third node is in no scene
    glb.animate(0, "translation", [0.0, 1.0], [[0, 0, 0], [1, 0, 0]])
    animation = Animation(glb.save(tmp_path / "two.glb"))
    assert len(animation.chunks) == 2 and animation.moving == [0]
    np.testing.assert_array_equal(animation.chunks[1].faces, [[0, 1, 4], [4, 1, 5]])
    np.testing.assert_array_equal(animation.scene.chunks[1].colors_srgb[0], [0, 127, 255])
    np.testing.assert_array_equal(animation.frame(1.0).vertices[16:], animation.scene.vertices[16:])
    np.testing.assert_allclose(animation.frame(1.0).vertices[:16], vertices + np.array([1, 0, 0]), atol=1e-6)


def test_files_that_cannot_be_played_are_refused_in_one_line(tmp_path):
    glb, *_ = glb_of_patch()
    with pytest.raises(InputError, match="holds no animation"):
        Animation(glb.save(tmp_path / "still.glb"))
    glb.animate(0, "translation", [0.0, 1.0], [[0, 0, 0], [1, 0, 0]])
    good = glb.save(tmp_path / "good.glb")
    with pytest.raises(InputError, match="expected one of act"):
        Animation(good, "dance")
    assert Animation(good, "act").duration_s == Animation(good, 0).duration_s == 1.0
    with pytest.raises(InputError, match="no such file"):
        Animation(tmp_path / "none.glb")
    (tmp_path / "cut.glb").write_bytes(good.read_bytes()[:300])
    with pytest.raises(InputError, match="not a readable glTF"):
        Animation(tmp_path / "cut.glb")
    glb.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    with pytest.raises(InputError, match="uncompressed"):
        Animation(glb.save(tmp_path / "draco.glb"))
    glb, *_ = arm_glb(np.float32)
    glb.json["skins"][0]["joints"] = [2]
    with pytest.raises(InputError, match="must have shape"):
        Animation(glb.save(tmp_path / "skin.glb"))
    del glb.json["skins"][0]["inverseBindMatrices"]
    with pytest.raises(InputError, match="joints beyond the 1 of its skin"):
        Animation(glb.save(tmp_path / "joints.glb"))
    glb, *_ = glb_of_patch()
    glb.animate(0, "rotation", [0.0, 1.0], [[0, 0, 0], [1, 0, 0]])
    with pytest.raises(InputError, match="the rotation of node 0"):
        Animation(glb.save(tmp_path / "width.glb"))
    glb, *_ = glb_of_patch()
    glb.animate(0, "translation", [1.0, 0.0], [[0, 0, 0], [1, 0, 0]])
    with pytest.raises(InputError, match="must not fall"):
        Animation(glb.save(tmp_path / "back.glb"))
    glb, *_ = glb_of_patch()
    glb.json["accessors"][0]["count"] = 10_000
    glb.animate(0, "translation", [0.0, 1.0], [[0, 0, 0], [1, 0, 0]])
    with pytest.raises(InputError, match="is damaged"):
        Animation(glb.save(tmp_path / "short.glb"))
    glb, *_ = glb_of_patch()
    glb.json["nodes"] += [{"children": [2]}, {"children": [1]}]
    glb.animate(0, "translation", [0.0, 1.0], [[0, 0, 0], [1, 0, 0]])
    with pytest.raises(InputError, match="do not form a tree"):
        Animation(glb.save(tmp_path / "loop.glb"))


@pytest.fixture
def turning(tmp_path):
    glb, *_ = glb_of_patch()
    turns = Rotation.from_rotvec([[0, 0, 0], [0, 1.2, 0]]).as_quat()
    glb.animate(0, "rotation", [0.0, 0.5], turns)
    return Animation(glb.save(tmp_path / "turning.glb"))


def _lit(scene, time_s):
    return np.maximum(analytic(scene.normals, 3) @ Environment.load("noon").sh(3), 0.0).astype(np.float32)


def test_frames_show_the_motion_before_a_camera_that_stands(turning, tmp_path):
    import imageio.v3 as iio

    out = tmp_path / "out"
    wrote = animate(turning, _lit, Environment.load("noon"), FilmRequest(out, 4, encoded=False), Shot(None, 48, 36, 1))
    assert (wrote.frames, wrote.film, wrote.note) == (3, False, "")
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["0000.png", "0001.png", "0002.png"]
    first, second, last = (iio.imread(tmp_path / "out" / f"000{i}.png").astype(int) for i in range(3))
    assert first.shape == (36, 48, 3) and np.abs(first - last).max() > 40
    # The corner shows nothing but sky in every frame: neither camera nor exposure moved.
    np.testing.assert_array_equal(first[0, 0], last[0, 0])
    # The patch turns away: of the pixels that are not sky, ever fewer.
    sky = [np.abs(image - image[:1]).sum(axis=2) for image in (first, second, last)]
    assert (sky[0] > 60).sum() > (sky[2] > 60).sum() > 0
    with pytest.raises(InputError, match="exists already"):
        animate(turning, _lit, Environment.load("noon"), FilmRequest(out, 4), Shot(None, 48, 36, 1))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years")
    with pytest.raises(InputError, match="does not replace it"):
        animate(turning, _lit, Environment.load("noon"), FilmRequest(tmp_path / "mine", 4, overwrite=True))


def test_frame_times_fill_the_duration():
    np.testing.assert_allclose(frame_times(0.5, 4), [0.0, 0.25, 0.5])
    np.testing.assert_allclose(frame_times(0.7, 10), np.arange(8) / 10)  # 0.7 * 10 is just below 7 in float64
    np.testing.assert_array_equal(frame_times(0.0, 24), [0.0])
    for fps in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="above 0"):
            frame_times(1.0, fps)
    with pytest.raises(InputError, match="expected up to"):
        frame_times(1e6, 24)


def test_a_film_needs_an_encoder_and_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("relight.animation.film.shutil.which", lambda name: None)
    monkeypatch.setattr("relight.animation.film.find_spec", lambda name: None)
    assert "install ffmpeg" in encode(tmp_path, 24)
    arguments = tmp_path / "arguments"
    script = tmp_path / "ffmpeg"
    script.write_text(f'#!/bin/sh\necho "$@" > {arguments}\nfor last; do :; done\necho film > "$last"\n')
    script.chmod(0o755)
    monkeypatch.setattr("relight.animation.film.shutil.which", lambda name: str(script))
    assert encode(tmp_path, 12.5) == "" and (tmp_path / FILM).read_text() == "film\n"
    assert "-framerate 12.5 -i %04d.png" in arguments.read_text()
    script.write_text('#!/bin/sh\necho half > animation.mp4\necho "Unknown encoder libx264" >&2\nexit 1\n')
    note = encode(tmp_path, 24)
    assert "Unknown encoder libx264" in note and not (tmp_path / FILM).exists()
