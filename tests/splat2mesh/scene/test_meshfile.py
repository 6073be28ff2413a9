"""Mesh files: PLY both ways bit by bit, OBJ, STL, OFF and GLB in, junk refused without a sound."""

import json
import struct
import tempfile
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest

from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import READABLE_SUFFIXES, read_mesh, write_mesh_ply

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
PENTAGON = "v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 2 0\nv -1 1 0\n"


def random_mesh(vertices=300, faces=500, seed=0):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(vertices, 3))
    return Mesh(
        (rng.normal(size=(vertices, 3)) * 1e3).astype(np.float32),
        (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        rng.integers(0, vertices, (faces, 3), dtype=np.int32),
        rng.integers(0, 256, (vertices, 3), dtype=np.uint8),
    )


def stored(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def ascii_ply(vertices, faces):
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(str, vertex)) for vertex in vertices]
    lines += [" ".join(map(str, (len(face), *face))) for face in faces]
    return "\n".join(lines) + "\n"


def glb(vertices, faces, colors_linear):
    """A minimal binary glTF with float linear vertex colours, put together from the specification."""
    arrays = [np.asarray(vertices, "<f4"), np.asarray(colors_linear, "<f4"), np.asarray(faces, "<u4").ravel()]
    body = b"".join(array.tobytes() for array in arrays)
    starts = np.cumsum([0] + [array.nbytes for array in arrays])
    kinds = [("VEC3", 5126), ("VEC3", 5126), ("SCALAR", 5125)]
    accessors = [
        {"bufferView": k, "componentType": component, "count": len(array), "type": kind}
        for k, (array, (kind, component)) in enumerate(zip(arrays, kinds, strict=True))
    ]
    accessors[0] |= {"min": arrays[0].min(axis=0).tolist(), "max": arrays[0].max(axis=0).tolist()}
    views = [{"buffer": 0, "byteOffset": int(s), "byteLength": a.nbytes} for s, a in zip(starts, arrays, strict=False)]
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(body)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def triangles_of(mesh):
    """The corners of every face, turned so that the lowest comes first: a sorted list that keeps duplicates."""
    turned = []
    for face in mesh.vertices[mesh.faces].tolist():
        first = face.index(min(face))
        turned.append(tuple(tuple(corner) for corner in face[first:] + face[:first]))
    return sorted(turned)


def area(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(float) for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_ply_round_trip_keeps_every_bit_and_every_run_writes_the_same_bytes(tmp_path):
    mesh = random_mesh()
    write_mesh_ply(tmp_path / "a.ply", mesh)
    write_mesh_ply(tmp_path / "b.ply", mesh)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    read = read_mesh(tmp_path / "a.ply")
    for name in ("vertices", "normals", "faces", "colors_srgb"):
        found, expected = getattr(read, name), getattr(mesh, name)
        assert found.dtype == expected.dtype, name
        np.testing.assert_array_equal(found, expected, name)


def test_every_colour_byte_survives_the_ply(tmp_path):
    mesh = random_mesh(256)
    codes = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    write_mesh_ply(tmp_path / "a.ply", Mesh(mesh.vertices, mesh.normals, mesh.faces, codes))
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.ply").colors_srgb, codes)


def test_obj_polygons_become_fans_with_all_their_faces(tmp_path):
    shifted = "".join(f"v {x + 5} {y} 1\n" for x, y in [(0, 0), (1, 0), (1, 1), (0, 1)])
    text = SQUARE + PENTAGON + shifted + "f 1 2 3 4\nf 5 6 7 8 9\nf 10 11 12\nf 10 12 13\n"
    mesh = read_mesh(stored(tmp_path, "mixed.obj", text))
    assert len(mesh.faces) == 2 + 3 + 2
    # Areas by hand: two unit squares, and the pentagon by the shoelace formula.
    assert area(mesh) == pytest.approx(1 + 5 + 1, abs=1e-6)
    normals = np.cross(*(mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)))
    assert (normals[:, 2] > 0).all()  # the fans keep the polygons' sense
    assert {face[0] for face in mesh.faces[2:5].tolist()} == {mesh.faces[2, 0]}


@pytest.mark.parametrize(
    "face",
    [
        "f 1 2 3 4",
        "f\t1 2 3 4",
        "  f 1 2 3 4",
        "f -4 -3 -2 -1",
        "f 1// 2// 3// 4//",
        "f 1 2 3 4\r",
        "usemtl a\nf 1 2 3 4",
    ],
)
def test_obj_quads_in_every_spelling(tmp_path, face):
    (tmp_path / "a.mtl").write_text("newmtl a\n")
    mesh = read_mesh(stored(tmp_path, "quad.obj", "mtllib a.mtl\n" + SQUARE + face + "\n"))
    assert triangles_of(mesh) == sorted(
        [((0, 0, 0), (1, 0, 0), (1, 1, 0)), ((0, 0, 0), (1, 1, 0), (0, 1, 0))], key=lambda face: face
    )


def test_a_triangle_obj_keeps_the_vertex_order_of_open3d(tmp_path):
    rng = np.random.default_rng(0)
    text = "".join("v {} {} {}\n".format(*row) for row in rng.normal(size=(40, 3)))
    text += "".join("f {} {} {}\n".format(*rng.choice(40, 3, replace=False) + 1) for _ in range(70))
    path = stored(tmp_path, "a.obj", text)
    direct = o3d.io.read_triangle_mesh(str(path))
    mesh = read_mesh(path)
    # open3d's parser of decimals is off by a rounding here and there.
    np.testing.assert_allclose(mesh.vertices, np.asarray(direct.vertices), rtol=3e-7)
    np.testing.assert_array_equal(mesh.faces, np.asarray(direct.triangles))


def test_fan_triangulation_leaves_no_file_behind(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = tmp_path / "models"
    folder.mkdir()
    read_mesh(stored(folder, "quad.obj", SQUARE + "f 1 2 3 4\n"))
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["models", "quad.obj"]


def test_ply_quads_and_stl_keep_their_triangles(tmp_path):
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    mesh = read_mesh(stored(tmp_path, "q.ply", ascii_ply(corners, [(0, 1, 2, 3)])))
    assert len(mesh.faces) == 2 and area(mesh) == 1.0
    stl = bytes(80) + struct.pack("<I", 2)
    for face in ((0, 1, 2), (0, 2, 3)):
        stl += struct.pack("<12fH", 0, 0, 1, *np.ravel([corners[k] for k in face]), 0)
    mesh = read_mesh(stored(tmp_path, "a.stl", stl))
    assert len(mesh.faces) == 2 and area(mesh) == 1.0


def test_glb_colours_are_linear_and_come_back_as_srgb(tmp_path):
    rng = np.random.default_rng(2)
    srgb = rng.integers(0, 256, (30, 3), dtype=np.uint8)
    vertices, faces = rng.normal(size=(30, 3)).astype(np.float32), np.arange(30).reshape(10, 3)
    mesh = read_mesh(stored(tmp_path, "a.glb", glb(vertices, faces, linear_from_srgb(srgb / 255.0))))
    np.testing.assert_array_equal(mesh.vertices, vertices)
    np.testing.assert_array_equal(mesh.colors_srgb, srgb)


def test_missing_colours_are_white_and_missing_normals_are_computed(tmp_path):
    mesh = read_mesh(stored(tmp_path, "a.obj", SQUARE + "f 1 2 3\nf 1 3 4\n"))
    np.testing.assert_array_equal(mesh.colors_srgb, np.full((4, 3), 255))
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1]] * 4)


JUNK = {"text": b"this is no mesh\n" * 20, "empty": b"", "zeros": bytes(500), "noise": bytes(range(256)) * 8}


@pytest.mark.parametrize("suffix", READABLE_SUFFIXES)
@pytest.mark.parametrize("kind", JUNK)
def test_junk_by_any_name_is_refused_silently(tmp_path, suffix, kind, capfd):
    path = stored(tmp_path, "junk" + suffix, JUNK[kind])
    with pytest.raises(InputError, match=str(path)):
        read_mesh(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".stl"])
@pytest.mark.parametrize("share", [0.3, 0.7, 0.95, 0.999])
def test_a_file_cut_short_is_refused_and_never_read_in_part(tmp_path, suffix, share, capfd):
    whole = random_mesh()
    if suffix == ".ply":
        write_mesh_ply(tmp_path / "whole.ply", whole)
        content = (tmp_path / "whole.ply").read_bytes()
    elif suffix == ".glb":
        content = glb(whole.vertices, whole.faces, whole.colors_srgb / 255.0)
    else:
        records = [struct.pack("<12fH", 0, 0, 1, *corners.ravel(), 0) for corners in whole.vertices[whole.faces]]
        content = bytes(80) + struct.pack("<I", len(records)) + b"".join(records)
    read_mesh(stored(tmp_path, "all" + suffix, content))
    path = stored(tmp_path, "cut" + suffix, content[: int(len(content) * share)])
    with pytest.raises(InputError, match=str(path)):
        read_mesh(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_vertices_that_are_not_finite_are_refused_with_their_count(tmp_path, value):
    mesh = random_mesh()
    mesh.vertices[7, 1] = mesh.vertices[9] = value
    write_mesh_ply(tmp_path / "a.ply", mesh)
    with pytest.raises(InputError, match="2 of 300 vertices are not finite"):
        read_mesh(tmp_path / "a.ply")


@pytest.mark.parametrize("corner", [4, 99, -1, 2**31 - 1])
def test_faces_beyond_the_vertices_are_refused(tmp_path, corner):
    path = stored(tmp_path, "a.ply", ascii_ply([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, corner)]))
    with pytest.raises(InputError, match="beyond the 4 there are"):
        read_mesh(path)


def test_a_mesh_without_triangles_is_refused(tmp_path):
    for name, content in {
        "a.ply": ascii_ply([(0, 0, 0), (1, 0, 0)], []),
        "a.obj": SQUARE,
        "b.obj": SQUARE + "l 1 2\n",
    }.items():
        with pytest.raises(InputError, match="no triangles"):
            read_mesh(stored(tmp_path, name, content))


def test_missing_files_folders_and_other_suffixes_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such mesh file"):
        read_mesh(tmp_path / "nothing.ply")
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(InputError, match="no such mesh file"):
        read_mesh(tmp_path / "folder.ply")
    with pytest.raises(InputError, match=r"expected one of \.ply \.obj"):
        read_mesh(stored(tmp_path, "a.fbx", b"x"))


def test_a_good_mesh_is_read_silently_from_any_kind_of_path(tmp_path, capfd):
    folder = tmp_path / "a folder with spaces and ü"
    folder.mkdir()
    write_mesh_ply(folder / "a.PLY", random_mesh())
    assert len(read_mesh(str(folder / "a.PLY")).faces) == 500
    assert len(read_mesh(Path(folder, "a.PLY")).faces) == 500
    assert capfd.readouterr() == ("", "")
