"""A tile's GLB: valid, and what went in comes out, far from the origin too; the same for its PLY."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from gltf_check import validator_issues
from random_meshes import random_mesh

from splat2mesh.base.errors import InputError
from splat2mesh.scene.meshfile import mesh_from_ply_bytes, mesh_ply_bytes
from splat2mesh.tiles.tileset import glb_bytes

FAR = np.array([20_000.0, 50.0, -9_000.0])


@pytest.fixture(scope="module")
def mesh():
    return random_mesh()


def glb_of(mesh, shift):
    color = np.random.default_rng(1).uniform(size=mesh.vertices.shape)
    return color, glb_bytes(replace(mesh, vertices=mesh.vertices.astype(np.float64) + shift), color)


def test_it_is_valid(mesh, tmp_path):
    (tmp_path / "tile.glb").write_bytes(glb_of(mesh, FAR)[1])
    found = validator_issues(tmp_path / "tile.glb")
    assert found["numErrors"] == found["numWarnings"] == 0


@pytest.mark.parametrize("shift", [np.zeros(3), FAR])
def test_it_holds_what_was_put_in(mesh, shift):
    color, data = glb_of(mesh, shift)
    size = struct.unpack("<I", data[12:16])[0]
    document, blob = json.loads(data[20 : 20 + size]), data[28 + size :]
    columns = []
    for view, kind in zip(document["bufferViews"], ("<f4", "<f4", "<u2", "<u4"), strict=True):
        part = blob[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        columns.append(np.frombuffer(part, kind))
    places = columns[0].reshape(-1, 3) + np.array(document["nodes"][0]["translation"])
    np.testing.assert_allclose(places, mesh.vertices + shift, atol=1e-6)  # float32 about the tile's middle
    np.testing.assert_allclose(columns[1].reshape(-1, 3), mesh.normals, atol=1e-6)
    np.testing.assert_allclose(columns[2].reshape(-1, 4)[:, :3] / 65535, color, atol=1e-5)
    np.testing.assert_array_equal(columns[3].reshape(-1, 3), mesh.faces)


def test_the_ply_of_a_tile_comes_back_bit_by_bit_and_a_damaged_one_is_reported(mesh):
    data = mesh_ply_bytes(mesh)
    found = mesh_from_ply_bytes(data)
    for name in ("vertices", "normals", "faces", "colors_srgb"):
        np.testing.assert_array_equal(getattr(found, name), getattr(mesh, name))
    for broken in (data[:-1], data[:100], b"", data + b"\0"):
        with pytest.raises(InputError, match="damaged"):
            mesh_from_ply_bytes(broken)
