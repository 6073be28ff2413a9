"""glTF, out and in: what `Glb` writes is read; strips, fans, transforms and sparse arrays by hand."""

import numpy as np
import pytest
from attack_samples import _glb
from scipy.spatial.transform import Rotation

from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import FAN, STRIP, TRIANGLES, GltfData, entry, triangles
from splat2mesh.base.gltfnodes import matrix_from_trs
from splat2mesh.proxy import bodies_glb
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.glb import Glb
from splat2mesh.scene.gltfmesh import read_gltf

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@pytest.mark.parametrize("wide", [False, True])
def test_what_glb_writes_is_read(tmp_path, wide):
    colors = np.array([[255, 0, 0], [0, 128, 0], [7, 7, 7], [0, 0, 255]]) / 255.0
    normals = np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0, -1]], np.float32)
    file = Glb()
    indices = file.triangles(FACES) if wide else file.indices(FACES, len(POINTS))
    attributes = {"POSITION": file.positions(POINTS), "NORMAL": file.values(normals)}
    attributes["COLOR_0"] = file.values(linear_from_srgb(colors).astype(np.float32))
    file.mesh("body", attributes, indices=indices)
    file.save(tmp_path / "a.glb", {"key": 1})
    found = read_gltf(tmp_path / "a.glb")
    np.testing.assert_array_equal(found.points[found.faces], POINTS[FACES])
    np.testing.assert_array_equal(found.normals[found.faces], normals[FACES])
    np.testing.assert_allclose(found.colors[found.faces], colors[FACES], atol=1e-6)  # sRGB to linear float32 and back
    assert GltfData(tmp_path / "a.glb").document.scenes[0].extras == {"key": 1}
    assert file.content() == file.content()


def test_every_proxy_is_read_where_it_stands(tmp_path):
    bodies = [(POINTS, FACES), (POINTS + np.float32(5.0), FACES[:2])]
    (tmp_path / "a.glb").write_bytes(bodies_glb(bodies, "-convcolonly"))
    found = read_gltf(tmp_path / "a.glb")
    expected = np.concatenate([points[faces] for points, faces in bodies])
    np.testing.assert_array_equal(found.points[found.faces], expected)
    names = [node.name for node in GltfData(tmp_path / "a.glb").document.nodes]
    assert names == ["proxy_000-convcolonly", "proxy_001-convcolonly"]


def test_strips_and_fans_keep_the_sense_of_their_triangles():
    assert triangles(np.arange(5), STRIP).tolist() == [[0, 1, 2], [2, 1, 3], [2, 3, 4]]
    assert triangles(np.arange(5), FAN).tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert triangles(np.arange(7), TRIANGLES).tolist() == [[0, 1, 2], [3, 4, 5]]
    assert all(len(triangles(np.arange(2), mode)) == 0 for mode in (TRIANGLES, STRIP, FAN))


def test_a_transform_scales_then_turns_then_moves():
    rng = np.random.default_rng(0)
    move, quat, scale, point = rng.normal(size=3), rng.normal(size=4), rng.normal(size=3), rng.normal(size=3)
    expected = Rotation.from_quat(quat).apply(point * scale) + move
    np.testing.assert_allclose((matrix_from_trs(move, quat, scale) @ [*point, 1.0])[:3], expected, rtol=1e-12)


def document(**more):
    """A file of POINTS and FACES, as JSON and bytes."""
    blob = POINTS.tobytes() + FACES.astype("<u2").tobytes()
    views = [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 24}]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
    ]
    shown = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
    shown |= {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]}
    return shown | {"accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": 72}]} | more, blob


def test_a_mirrored_node_keeps_its_outside_outside(tmp_path):
    (tmp_path / "a.glb").write_bytes(_glb(*document(nodes=[{"mesh": 0, "scale": [-1, 1, 1]}])))
    found = read_gltf(tmp_path / "a.glb")
    a, b, c = (found.points[found.faces[:, corner]] for corner in range(3))
    # The volume of a closed body, 1/6 of the triple products, is positive where faces look out.
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(1 / 6)


def test_nodes_below_others_take_their_transforms_one_after_the_other(tmp_path):
    nodes = [{"scale": [2, 2, 2], "children": [1]}, {"mesh": 0, "translation": [1, 0, 0]}]
    (tmp_path / "a.glb").write_bytes(_glb(*document(nodes=nodes)))
    found = read_gltf(tmp_path / "a.glb")
    np.testing.assert_array_equal(found.points[found.faces], 2.0 * (POINTS[FACES] + [1, 0, 0]))


def test_normalised_integers_are_shares_of_their_range(tmp_path):
    raw, blob = document()
    raw["bufferViews"].append({"buffer": 0, "byteOffset": 72, "byteLength": 4})
    raw["buffers"] = [{"byteLength": 76}]
    raw["accessors"].append({"bufferView": 2, "componentType": 5120, "count": 4, "type": "SCALAR", "normalized": True})
    (tmp_path / "a.glb").write_bytes(_glb(raw, blob + np.array([-128, -127, 0, 127], "i1").tobytes()))
    assert GltfData(tmp_path / "a.glb").array(2, "it").tolist() == [-1.0, -1.0, 0.0, 1.0]


@pytest.mark.parametrize("index", [-1, 3, True, "0", None, 0.0])
def test_entries_are_named_by_whole_numbers_of_those_that_are_there(index):
    assert entry([7, 8, 9], 2) == 9
    with pytest.raises(IndexError, match="of 3"):
        entry([7, 8, 9], index)


def test_a_view_that_goes_beyond_its_buffer_is_refused(tmp_path):
    raw, blob = document()
    raw["accessors"][0]["count"] = 5
    (tmp_path / "a.glb").write_bytes(_glb(raw, blob))
    with pytest.raises(InputError, match=r"the mesh of node 0 is damaged \(60 bytes of 72\)"):
        read_gltf(tmp_path / "a.glb")
