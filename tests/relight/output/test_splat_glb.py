"""relight.output.splat_glb: KHR_gaussian_splatting by its specification, and the rest by the Khronos validator."""

import json
import struct

import numpy as np
import pytest
from gltf_check import validator_issues
from lit_ball import TILT
from splat_samples import make_splats

from relight.output.splat_glb import EXTENSION, write_splat_glb
from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.placing import placed
from splat2mesh.splats.splats import Splats

REQUIRED = {"ROTATION": "VEC4", "SCALE": "VEC3", "OPACITY": "SCALAR", "SH_DEGREE_0_COEF_0": "VEC3"}


def read(path):
    """(primitive, dict of arrays by attribute, number of splats)."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    assert document["extensionsUsed"] == [EXTENSION] and "extensionsRequired" not in document
    (primitive,) = document["meshes"][0]["primitives"]
    arrays = {}
    for name, index in primitive["attributes"].items():
        accessor = document["accessors"][index]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        assert (
            accessor["componentType"] == 5126
            and REQUIRED.get(name.rpartition(":")[2], accessor["type"]) == accessor["type"]
        )
        start = document["bufferViews"][accessor["bufferView"]].get("byteOffset", 0)
        arrays[name] = np.frombuffer(binary, "<f4", accessor["count"] * width, start).reshape(-1, width)
    return primitive, arrays


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_it_holds_the_splats_in_the_scene_frame_by_the_specification(tmp_path, degree):
    splats = make_splats(40, degree)
    assert write_splat_glb(tmp_path / "a.glb", splats, TILT) == 40
    primitive, arrays = read(tmp_path / "a.glb")
    assert primitive["mode"] == 0
    assert primitive["extensions"] == {EXTENSION: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}}
    expected = placed(splats, TILT)
    np.testing.assert_array_equal(arrays["POSITION"], expected.means)
    np.testing.assert_array_equal(arrays[f"{EXTENSION}:SCALE"], expected.scales)
    np.testing.assert_array_equal(arrays[f"{EXTENSION}:ROTATION"], np.roll(expected.quats_wxyz, -1, axis=1))
    np.testing.assert_array_equal(arrays[f"{EXTENSION}:OPACITY"][:, 0], expected.opacities)
    coefficients = [f"{EXTENSION}:SH_DEGREE_{d}_COEF_{o}" for d in range(degree + 1) for o in range(2 * d + 1)]
    np.testing.assert_array_equal(np.stack([arrays[name] for name in coefficients], axis=1), expected.sh)
    assert set(arrays) == {"POSITION", "COLOR_0", *(f"{EXTENSION}:{n}" for n in REQUIRED), *coefficients}
    points = arrays["COLOR_0"]
    np.testing.assert_allclose(points[:, :3], linear_from_srgb(np.clip(splats.colors_diffuse, 0, 1)), atol=1e-6)


def test_the_validator_complains_of_nothing_but_the_names_that_it_does_not_know(tmp_path):
    write_splat_glb(tmp_path / "a.glb", make_splats(30, 3), TILT)
    issues = validator_issues(tmp_path / "a.glb")["messages"]
    # It knows neither this extension nor that extensions may prefix attributes by their name.
    assert {each["code"] for each in issues} <= {"UNSUPPORTED_EXTENSION", "MESH_PRIMITIVE_INVALID_ATTRIBUTE"}
    assert all(f"/attributes/{EXTENSION}:" in each["pointer"] for each in issues if each["severity"] == 0)
    # With names of the kind that it does know, the file has no issue.
    data = (tmp_path / "a.glb").read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    text = data[20 : 20 + length].decode().replace(f'"{EXTENSION}:', '"_')
    text += " " * (length - len(text.encode()))
    (tmp_path / "b.glb").write_bytes(data[:20] + text.encode() + data[20 + length :])
    assert {each["code"] for each in validator_issues(tmp_path / "b.glb")["messages"]} <= {"UNSUPPORTED_EXTENSION"}


def test_damaged_and_hidden_splats_are_left_out_and_the_damaged_counted(tmp_path):
    splats = make_splats(20, 0)
    means, opacities = splats.means.copy(), splats.opacities.copy()
    means[3], opacities[7] = np.nan, 0.0
    splats = Splats(means, splats.scales, splats.quats_wxyz, opacities, splats.sh)
    with pytest.warns(DataWarning, match="left out 1 of 20 splats that are damaged"):
        assert write_splat_glb(tmp_path / "a.glb", splats, np.eye(4)) == 18
    _, arrays = read(tmp_path / "a.glb")
    np.testing.assert_array_equal(arrays["POSITION"], np.delete(splats.means, [3, 7], axis=0))


@pytest.mark.parametrize("degree", [0, 3])
def test_the_package_reads_its_own_file(tmp_path, degree):
    splats = make_splats(40, degree)
    write_splat_glb(tmp_path / "a.glb", splats, TILT)
    found, expected = read_splats(tmp_path / "a.glb"), placed(placed(splats, TILT), np.diag([1.0, -1, -1, 1]))
    for name in ("means", "scales", "opacities", "sh"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-6)
    np.testing.assert_allclose(found.covariances(), expected.covariances(), atol=1e-6)
