"""relight.output.mesh_files: files read back by a parser of our own, open3d, imageio and the Khronos validator."""

import json
import struct
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import open3d as o3d
import pytest
from gltf_check import validator_issues

from relight import __version__
from relight.output.images import write_png
from relight.output.mesh_files import check_radiance, staged_file, write_glb, write_npy, write_ply
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.mesh import Mesh, vertex_normals
from splat2mesh.scene.scene import Scene

EXPOSURE = 0.7


def make_chunk(rng, vertex_count, face_count):
    """Random triangles: nothing symmetric, no two values alike."""
    vertices = rng.normal(size=(vertex_count, 3)).astype(np.float32)
    normals = rng.normal(size=(vertex_count, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    faces = np.stack([rng.choice(vertex_count, 3, replace=False) for _ in range(face_count)]).astype(np.int32)
    return Mesh(vertices, normals, faces, np.full((vertex_count, 3), 255, np.uint8))


@pytest.fixture
def scene():
    rng = np.random.default_rng(1)
    # Odd face counts end 16-bit indices off a 4-byte boundary, where the validator lets no floats start.
    return Scene([make_chunk(rng, 40, 33), make_chunk(rng, 25, 21)])


@pytest.fixture
def radiance():
    """Darks, values beyond the display and slightly negative ones, as truncated spherical harmonics give."""
    radiance = np.random.default_rng(2).exponential(0.6, (65, 3)).astype(np.float32)
    radiance[::9] *= -0.01
    return radiance


def read_glb(path):
    """The JSON document of a GLB file and, for each node, its arrays, by the glTF 2.0 specification."""
    data = Path(path).read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    json_length, json_kind = struct.unpack_from("<I4s", data, 12)
    assert json_kind == b"JSON"
    document = json.loads(data[20 : 20 + json_length])
    binary_length, binary_kind = struct.unpack_from("<I4s", data, 20 + json_length)
    assert binary_kind == b"BIN\0"
    binary = data[28 + json_length :]
    assert len(binary) == binary_length

    def read(index):
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        dtype = {5123: "<u2", 5125: "<u4", 5126: "<f4"}[accessor["componentType"]]
        size = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        offset = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(binary, dtype, accessor["count"] * size, offset).reshape(-1, size)

    primitives = []
    for node in document["scenes"][document["scene"]]["nodes"]:
        (primitive,) = document["meshes"][document["nodes"][node]["mesh"]]["primitives"]
        arrays = {name: read(index) for name, index in primitive["attributes"].items()}
        primitives.append({**arrays, "indices": read(primitive["indices"]), "accessors": primitive["attributes"]})
    return document, primitives


def srgb_bytes(linear):
    """IEC 61966-2-1, one value at a time."""
    value = min(max(float(linear), 0.0), 1.0)
    encoded = 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055
    return round(255 * encoded)


def test_glb_holds_every_chunk_bit_for_bit(tmp_path, scene, radiance):
    write_glb(tmp_path / "a.glb", scene, radiance, EXPOSURE)
    document, primitives = read_glb(tmp_path / "a.glb")
    assert len(primitives) == len(scene.chunks) == 2
    start = 0
    for chunk, primitive in zip(scene.chunks, primitives, strict=True):
        rows = slice(start, start + len(chunk.vertices))
        start = rows.stop
        np.testing.assert_array_equal(primitive["POSITION"], chunk.vertices)
        np.testing.assert_array_equal(primitive["indices"].reshape(-1, 3), chunk.faces)
        shown = np.clip(radiance[rows] * np.float32(EXPOSURE), 0, 1)
        np.testing.assert_array_equal(primitive["COLOR_0"], shown)
        # Unit already, so normalising in float64 may only change the last bit of a float32.
        np.testing.assert_allclose(primitive["NORMAL"], chunk.normals, rtol=2e-7, atol=0)
        bounds = document["accessors"][primitive["accessors"]["POSITION"]]
        np.testing.assert_array_equal(np.float32(bounds["min"]), chunk.vertices.min(axis=0))
        np.testing.assert_array_equal(np.float32(bounds["max"]), chunk.vertices.max(axis=0))


def test_glb_is_unlit_double_sided_and_says_how_it_was_made(tmp_path, scene, radiance):
    facts = {"environment": "stpeters", "angle_deg": 45.0}
    clipped = write_glb(tmp_path / "a.glb", scene, radiance, EXPOSURE, facts)
    assert 0 < clipped == sum(max(row) * np.float32(EXPOSURE) > 1 for row in radiance) < len(radiance)
    document, _ = read_glb(tmp_path / "a.glb")
    assert document["scenes"][0]["extras"] == {"exposure": EXPOSURE, "clipped_vertices": clipped, **facts}
    assert document["asset"]["generator"] == f"splat2mesh {__version__}"
    (material,) = document["materials"]
    assert material["extensions"] == {"KHR_materials_unlit": {}} and material["doubleSided"]
    assert material["pbrMetallicRoughness"]["baseColorFactor"] == [1, 1, 1, 1]
    assert document["extensionsUsed"] == ["KHR_materials_unlit"]


def test_glb_gives_back_unclipped_radiance(tmp_path, scene):
    radiance = np.random.default_rng(3).uniform(0, 1.9, (65, 3)).astype(np.float32)
    write_glb(tmp_path / "a.glb", scene, radiance, 0.5)
    document, primitives = read_glb(tmp_path / "a.glb")
    colors = np.concatenate([primitive["COLOR_0"] for primitive in primitives])
    np.testing.assert_array_equal(colors / document["scenes"][0]["extras"]["exposure"], radiance)


def test_glb_passes_the_khronos_validator(tmp_path, scene, radiance):
    write_glb(tmp_path / "a.glb", scene, radiance, EXPOSURE, {"environment": "sky"})
    issues = validator_issues(tmp_path / "a.glb")
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


def test_the_validator_sees_a_color_beyond_one(tmp_path, scene, radiance):
    write_glb(tmp_path / "a.glb", scene, radiance, EXPOSURE)
    data = bytearray((tmp_path / "a.glb").read_bytes())
    colors = np.clip(radiance[:40] * np.float32(EXPOSURE), 0, 1)
    struct.pack_into("<f", data, data.index(colors.tobytes()), 1.5)
    (tmp_path / "a.glb").write_bytes(data)
    messages = validator_issues(tmp_path / "a.glb")["messages"]
    assert [message["code"] for message in messages] == ["ACCESSOR_NON_CLAMPED"]


def test_glb_repairs_undefined_normals_and_says_how_many(tmp_path, scene, radiance):
    scene.chunks[0].normals[[3, 5]] = 0
    scene.chunks[1].normals[2] = [np.nan, 0, 0]
    scene.chunks[1].normals[4] = [0, 0, -2.5]
    with pytest.warns(DataWarning, match="3 vertices"):
        write_glb(tmp_path / "a.glb", scene, radiance, EXPOSURE)
    _, (first, second) = read_glb(tmp_path / "a.glb")
    around = [vertex_normals(chunk.vertices, chunk.faces) for chunk in scene.chunks]
    np.testing.assert_allclose(first["NORMAL"][[3, 5]], around[0][[3, 5]], atol=1e-6)  # float32
    np.testing.assert_allclose(second["NORMAL"][[2, 4]], [around[1][2], [0, 0, -1]], atol=1e-6)
    issues = validator_issues(tmp_path / "a.glb")
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


@pytest.mark.parametrize(("vertex_count", "dtype"), [(65535, "<u2"), (65536, "<u4")])
def test_glb_indices_take_16_bits_where_the_specification_lets_them(tmp_path, vertex_count, dtype):
    """The largest 16-bit index is 65534: glTF 2.0, section 3.7.2.1, keeps 65535 for primitive restart."""
    vertices = np.random.default_rng(4).normal(size=(vertex_count, 3)).astype(np.float32)
    normals = np.tile(np.float32([0, 0, 1]), (vertex_count, 1))
    faces = np.array([[0, 1, vertex_count - 1]], np.int32)
    scene = Scene([Mesh(vertices, normals, faces, np.zeros((vertex_count, 3), np.uint8))])
    write_glb(tmp_path / "a.glb", scene, np.full((vertex_count, 3), 0.5), 1.0)
    _, (primitive,) = read_glb(tmp_path / "a.glb")
    assert primitive["indices"].dtype == dtype
    np.testing.assert_array_equal(primitive["indices"].ravel(), faces.ravel())


def test_ply_as_open3d_reads_it(tmp_path, scene, radiance):
    write_ply(tmp_path / "a.ply", scene, radiance, EXPOSURE)
    mesh = o3d.io.read_triangle_mesh(str(tmp_path / "a.ply"))
    np.testing.assert_array_equal(np.asarray(mesh.vertices), scene.vertices)
    np.testing.assert_array_equal(np.asarray(mesh.vertex_normals), scene.normals)
    np.testing.assert_array_equal(np.asarray(mesh.triangles), scene.faces)
    expected = [[srgb_bytes(value * EXPOSURE) for value in row] for row in radiance]
    np.testing.assert_array_equal(np.asarray(mesh.vertex_colors) * 255, expected)


def test_npy_is_the_radiance_itself(tmp_path, scene, radiance):
    write_npy(tmp_path / "radiance.npy", scene, radiance.astype(np.float64))
    stored = np.load(tmp_path / "radiance.npy")
    assert stored.dtype == np.float32
    np.testing.assert_array_equal(stored, radiance)


def test_png_round_trip(tmp_path):
    image = np.random.default_rng(5).integers(0, 256, (7, 11, 3), dtype=np.uint8)
    write_png(tmp_path / "new folder" / "a.png", image)
    np.testing.assert_array_equal(iio.imread(tmp_path / "new folder" / "a.png"), image)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(OSError, match="disk full"), staged_file(tmp_path / "a.txt") as staging:
        staging.write_text("half of the n")
        raise OSError("disk full")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"
    with staged_file(tmp_path / "a.txt") as staging:
        staging.write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "new"


@pytest.mark.parametrize("shape", [(64, 3), (65, 4), (65,), (1, 65, 3)])
def test_radiance_of_another_shape_is_refused(scene, shape):
    with pytest.raises(InputError, match=r"must have shape \(65, 3\)"):
        check_radiance(scene, np.ones(shape))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_radiance_that_is_not_finite_is_refused_before_a_file_is_touched(tmp_path, scene, radiance, value):
    radiance[7, 1] = value
    for write in (
        lambda path: write_glb(path, scene, radiance, 1.0),
        lambda path: write_ply(path, scene, radiance, 1.0),
        lambda path: write_npy(path, scene, radiance),
    ):
        with pytest.raises(InputError, match="1 of 65 vertices is not finite"):
            write(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
