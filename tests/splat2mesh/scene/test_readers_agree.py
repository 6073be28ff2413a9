"""Well-formed mesh files hold the triangles that open3d reads of them, and every vertex once."""

import json
import struct

import numpy as np
import open3d as o3d
import pytest
from attack_samples import _Blob, _glb

from splat2mesh.scene.meshfile import read_mesh


def assert_same_triangles(path):
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        before = o3d.io.read_triangle_mesh(str(path))
    mesh = read_mesh(path)
    ours, theirs = (
        np.sort(np.round(np.asarray(points)[np.asarray(faces)], 5).reshape(-1, 9).view("f8,f8,f8,f8,f8,f8,f8,f8,f8"), 0)
        for points, faces in ((mesh.vertices.astype(float), mesh.faces), (before.vertices, before.triangles))
    )
    np.testing.assert_array_equal(ours, theirs)
    held = np.hstack([mesh.vertices, mesh.normals, mesh.colors_srgb])
    assert len(np.unique(held, axis=0)) == len(held) == len(np.unique(mesh.faces))


@pytest.mark.parametrize("kind", ["f {0} {1} {2}", "f {0}/{3} {1}/{4} {2}/{3}", "f {0}//{3} {1}//{4} {2}//{3}"])
@pytest.mark.parametrize("materials", [False, True])
def test_obj(tmp_path, kind, materials):
    rng = np.random.default_rng(3)
    lines = ["v {} {} {}".format(*row) for row in rng.integers(-2, 3, (9, 3))]
    lines += ["vt 0 0", "vt 1 0", "vt 0 1", "vn 0 0 1", "vn 1 0 0", "vn 0 1 0"]
    for number in range(24):
        if materials and number % 5 == 2:
            lines.append(f"usemtl m{rng.integers(3)}")
        if materials and number % 7 == 3:
            lines.append(f"g part{number}")
        lines.append(kind.format(*(rng.permutation(9)[:3] + 1), *rng.integers(1, 4, 2)))
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    assert_same_triangles(tmp_path / "a.obj")


def test_stl_binary_and_ascii(tmp_path):
    rng = np.random.default_rng(1)
    corners, normals = rng.integers(-1, 2, (20, 3, 3)), np.eye(3)[rng.integers(0, 3, 20)]
    pairs = list(zip(normals, corners, strict=True))
    facets = b"".join(struct.pack("<12fH", *normal, *triangle.ravel(), 0) for normal, triangle in pairs)
    (tmp_path / "a.stl").write_bytes(b"made here".ljust(80) + struct.pack("<I", 20) + facets)
    assert_same_triangles(tmp_path / "a.stl")
    text = "solid a\n"
    for normal, triangle in pairs:
        rows = "".join("vertex {} {} {}\n".format(*corner) for corner in triangle)
        text += "facet normal {} {} {}\nouter loop\n".format(*normal) + rows + "endloop\nendfacet\n"
    (tmp_path / "b.stl").write_text(text + "endsolid a\n")
    assert_same_triangles(tmp_path / "b.stl")


@pytest.mark.parametrize("seed", range(6))
def test_glb_of_several_meshes_materials_and_nodes(tmp_path, seed):
    rng, blob, meshes = np.random.default_rng(seed), _Blob(), []
    for _ in range(3):
        primitives = []
        for _ in range(int(rng.integers(1, 3))):
            points = rng.integers(-2, 3, (6, 3)).astype("<f4")
            attributes = {"POSITION": blob.add(points, 5126, "VEC3")}
            blob.accessors[-1] |= {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
            if rng.random() < 0.5:
                attributes["NORMAL"] = blob.add(np.eye(3, dtype="<f4")[rng.integers(0, 3, 6)], 5126, "VEC3")
            if rng.random() < 0.4:
                attributes["TEXCOORD_0"] = blob.add(rng.integers(0, 2, (6, 2)).astype("<f4"), 5126, "VEC2")
            indices = blob.add(rng.integers(0, 6, 12).astype("<u4"), 5125, "SCALAR")
            primitive = {"attributes": attributes, "indices": indices}
            primitives.append(primitive | ({"material": int(rng.integers(2))} if rng.random() < 0.7 else {}))
        meshes.append({"primitives": primitives})
    nodes = [{"mesh": 2, "children": [1], "scale": [2, 1, 1]}, {"mesh": 0, "translation": [3, 0, 0]}, {"mesh": 1}]
    document = blob.document(meshes=meshes, nodes=nodes, materials=[{"name": "a"}, {"name": "b"}])
    document["scenes"] = [{"nodes": [0, 2]}]
    (tmp_path / "a.glb").write_bytes(_glb(document, blob.data))
    assert_same_triangles(tmp_path / "a.glb")


def test_quantized_gltf_is_read_as_its_extension_says(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    blob = _Blob()
    packed = np.zeros((4, 4), "<u2")
    packed[:, :3] = points * 65535
    blob.add(packed, 5123, "VEC3")
    blob.accessors[0] |= {"normalized": True}
    blob.views[0]["byteStride"] = 8
    faces = blob.add(np.array([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3], "<u2"), 5123, "SCALAR")
    meshes = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": faces}]}]
    node = {"mesh": 0, "scale": [10, 10, 10], "translation": [1, 2, 3]}
    extension = {"extensionsRequired": ["KHR_mesh_quantization"], "extensionsUsed": ["KHR_mesh_quantization"]}
    document = blob.document(meshes=meshes, nodes=[node], **extension)
    (tmp_path / "q.glb").write_bytes(_glb(document, blob.data))
    np.testing.assert_allclose(read_mesh(tmp_path / "q.glb").vertices, points[[0, 2, 1, 3]] * 10 + [1, 2, 3])
    (tmp_path / "q.gltf").write_text(json.dumps(document | {"extensionsRequired": ["EXT_meshopt_compression"]}))
    with pytest.raises(ValueError, match="needs EXT_meshopt_compression"):
        read_mesh(tmp_path / "q.gltf")


def test_a_mesh_far_from_the_origin_keeps_its_shape(tmp_path):
    near = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    far = near.replace("v 0 0 0", "v 1e7 0 0").replace("v 1 0 0", "v 10000001 0 0")
    far = far.replace("v 0 1 0", "v 1e7 1 0").replace("v 0 0 1", "v 1e7 0 1")
    (tmp_path / "near.obj").write_text(near)
    (tmp_path / "far.obj").write_text(far)
    with pytest.warns(UserWarning, match="moved by"):
        mesh = read_mesh(tmp_path / "far.obj")
    shifted = mesh.vertices - mesh.vertices[0]
    np.testing.assert_array_equal(shifted, read_mesh(tmp_path / "near.obj").vertices)
