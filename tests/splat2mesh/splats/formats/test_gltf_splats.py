"""Splats in glTF: as ratified, quantised, placed by nodes, compressed by SPZ; damage."""

import json
from dataclasses import replace

import numpy as np
import pytest
from splat_gltf import NAME, attributes_of, glb_bytes, splat_glb, spz_glb
from splat_samples import assert_same, make_splats, store

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.formats import kind_of, read_splats, write_splats
from splat2mesh.splats.formats.register import looks_like_splat
from splat2mesh.splats.placing import placed, similarity

UP = np.diag([1.0, -1.0, -1.0, 1.0])
"""From the y-up frame of glTF to the y-down one of a PLY."""
FIELDS = "means", "scales", "quats_wxyz", "opacities", "sh"


def assert_close(found, expected, atol=1e-5):
    for name in ("means", "scales", "opacities", "sh"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=atol, err_msg=name)
    np.testing.assert_allclose(found.covariances(), expected.covariances(), atol=atol)


@pytest.mark.parametrize("degree", range(4))
def test_a_file_as_ratified(tmp_path, degree):
    splats = make_splats(50, degree)
    path = store(tmp_path, "a.glb", splat_glb(attributes_of(splats)))
    assert kind_of(path) == "glb" and looks_like_splat(path)
    found = read_splats(path)
    assert_close(found, placed(splats, UP))
    assert found.facts.up == (0, -1, 0) and "y axis points up" in found.facts.up_from


def test_nodes_place_their_splats_and_meshes_are_left_out(tmp_path):
    splats = make_splats(30, 2)
    turn = [0.0, np.sin(0.4), 0.0, np.cos(0.4)]
    nodes = [
        {"children": [1, 2, 3], "translation": [5, 0, 0]},
        {"mesh": 0, "rotation": turn, "scale": [2, 2, 2]},
        {"mesh": 0},
        {"mesh": 1},
    ]
    triangle = {"primitives": [{"attributes": {"POSITION": 0}}]}
    data = splat_glb(attributes_of(splats), nodes, meshes=[triangle])
    with pytest.warns(DataWarning, match="skipped 1 meshes: only splats are read"):
        found = read_splats(store(tmp_path, "a.glb", data))
    c, s = np.cos(0.8), np.sin(0.8)
    first = similarity(2.0, [[c, 0, s], [0, 1, 0], [-s, 0, c]], (5, 0, 0))
    assert_close(found.take(slice(0, 30)), placed(splats, UP @ first), atol=3e-5)
    assert_close(found.take(slice(30, 60)), placed(splats, UP @ similarity(translation=(5, 0, 0))), atol=3e-5)


def test_quantised_attributes(tmp_path):
    splats = make_splats(40, 0)
    arrays = attributes_of(splats)
    arrays[f"{NAME}:ROTATION"] = np.rint(arrays[f"{NAME}:ROTATION"] * 32767).astype("<i2")
    arrays[f"{NAME}:OPACITY"] = np.rint(arrays[f"{NAME}:OPACITY"] * 255).astype("u1")
    found = read_splats(store(tmp_path, "a.glb", splat_glb(arrays)))
    np.testing.assert_allclose(found.opacities, splats.opacities, atol=0.51 / 255)
    np.testing.assert_allclose(found.covariances(), placed(splats, UP).covariances(), atol=1e-3)


def test_a_gltf_beside_its_buffer(tmp_path):
    splats = make_splats(30, 1)
    data = splat_glb(attributes_of(splats))
    length = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + length])
    document["buffers"][0]["uri"] = "a.bin"
    (tmp_path / "a.bin").write_bytes(data[28 + length :])
    path = store(tmp_path, "a.gltf", json.dumps(document).encode())
    assert kind_of(path) == "glb" and looks_like_splat(path)
    assert_close(read_splats(path), placed(splats, UP))


@pytest.mark.parametrize("version", ["_compression_spz_2", "_compression_spz"])
def test_compressed_by_spz(tmp_path, version):
    splats = make_splats(60, 2)
    splats = replace(splats, sh=splats.sh / 8)
    write_splats(tmp_path / "a.spz", splats, "spz")
    spz = (tmp_path / "a.spz").read_bytes()
    found = read_splats(store(tmp_path, "a.glb", spz_glb(spz, NAME + version)))
    assert_close(found, read_splats(tmp_path / "a.spz"))
    draft = read_splats(store(tmp_path, "b.glb", spz_glb(spz, "KHR_spz_gaussian_splats_compression", inside=False)))
    assert_same(draft, found)
    with pytest.raises(InputError, match="SPZ"):
        read_splats(store(tmp_path, "c.glb", spz_glb(spz[:-50])))


def test_linear_colours_are_converted(tmp_path):
    splats = make_splats(30, 1)
    splats = replace(splats, sh=(splats.sh * 0.1).astype(np.float32))
    linear = linear_from_srgb(splats.colors_diffuse.clip(0, 1))
    arrays = attributes_of(splats)
    arrays[f"{NAME}:SH_DEGREE_0_COEF_0"] = (linear - 0.5) / 0.28209479
    with pytest.warns(DataWarning, match="converted the linear colours of 30 splats"):
        found = read_splats(store(tmp_path, "a.glb", splat_glb(arrays, extension={"colorSpace": "lin_rec709_display"})))
    np.testing.assert_allclose(found.colors_diffuse, splats.colors_diffuse, atol=1e-5)


def test_what_cannot_be_used_gets_one_line(tmp_path, monkeypatch):
    splats = make_splats(20, 1)
    arrays = attributes_of(splats)

    def without(name):
        return splat_glb({key: value for key, value in arrays.items() if not key.endswith(name)})

    document = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
    document |= {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}
    stretched = splat_glb(arrays, [{"mesh": 0, "scale": [1, 2, 1]}])
    for data, message in (
        (glb_bytes(document, b""), "holds no Gaussian splats .*: relight takes mesh files directly"),
        (glb_bytes({"asset": {"version": "2.0"}}, b""), "expected a primitive with KHR_gaussian_splatting"),
        (without("POSITION"), "have no POSITION"),
        (without("SCALE"), "lack SCALE or ROTATION"),
        (without("OPACITY"), "lack OPACITY or SH_DEGREE_0_COEF_0"),
        (splat_glb(arrays | {f"{NAME}:SCALE": splats.scales[:7]}), r"SCALE of the splats must have shape \(20, 3\)"),
        (splat_glb(arrays | {"POSITION": splats.opacities}), "POSITION of the splats must have shape"),
        (stretched, "scaled alike in all directions"),
        (splat_glb(arrays, [{"mesh": 0, "scale": [-1, 1, 1]}]), "mirrors"),
        (splat_glb(arrays)[:-200], "not a readable glTF"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            read_splats(store(tmp_path, "a.glb", data))
        assert "\n" not in str(caught.value)
    assert not looks_like_splat(store(tmp_path, "b.glb", glb_bytes(document, b"")))
    monkeypatch.setattr("splat2mesh.base.inputs.FREE", 1000)
    many = splat_glb(arrays, [{"mesh": 0, "children": [*range(1, 2000)]}, *[{"mesh": 0}] * 1999])
    with pytest.raises(InputError, match="announces"):
        read_splats(store(tmp_path, "c.glb", many))
