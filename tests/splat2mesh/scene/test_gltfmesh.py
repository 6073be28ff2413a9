"""Base colours of glTF materials on the vertices of a mesh: factors, textures, their own colours, what is missing."""

import base64
import io
import json

import imageio.v3 as iio
import numpy as np
import pytest
from attack_samples import _Blob, _glb

from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.color import linear_from_srgb, srgb_from_linear
from splat2mesh.scene.meshfile import read_mesh

POINTS = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
UV = np.float32([[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]])
PIXELS = np.uint8([[[10, 20, 30], [250, 130, 0]], [[255, 0, 0], [0, 90, 200]]])
SEEN = PIXELS.reshape(4, 3)[[0, 1, 3, 2]]
"""The texels at UV: v counts down from the first row."""


def png(pixels=PIXELS):
    packed = io.BytesIO()
    iio.imwrite(packed, pixels, extension=".png")
    return packed.getvalue()


def stored(path, *surfaces, colors=None, uri=None, uv=UV, content=None):
    """A .glb with a quad for each pbrMetallicRoughness, 2 apart; None for no material. Its texture 0 is PIXELS."""
    blob, primitives, materials = _Blob(), [], []
    for number, surface in enumerate(surfaces):
        attributes = {"POSITION": blob.add(POINTS + np.float32([0, 0, 2 * number]), 5126, "VEC3")}
        if uv is not None:
            attributes["TEXCOORD_0"] = blob.add(uv, 5126, "VEC2")
        if colors is not None:
            attributes["COLOR_0"] = blob.add(np.float32(colors), 5126, "VEC3")
        indices = blob.add(np.uint32([0, 1, 2, 0, 2, 3]), 5125, "SCALAR")
        primitives.append({"attributes": attributes, "indices": indices})
        if surface is not None:
            primitives[-1]["material"] = len(materials)
            materials.append({"pbrMetallicRoughness": surface})
    uri = uri or "data:image/png;base64," + base64.b64encode(png() if content is None else content).decode()
    pictures = {"images": [{"uri": uri}], "textures": [{"source": 0}]}
    made = blob.document(meshes=[{"primitives": primitives}], nodes=[{"mesh": 0}], materials=materials, **pictures)
    path.write_bytes(_glb(made, blob.data))
    return path


TEXTURED = {"baseColorTexture": {"index": 0}}


def test_a_texture_is_seen_where_its_coordinates_lie(tmp_path):
    mesh = read_mesh(stored(tmp_path / "a.glb", TEXTURED))
    np.testing.assert_array_equal(mesh.vertices, POINTS)
    np.testing.assert_array_equal(mesh.colors_srgb, SEEN)


def test_a_factor_is_linear_and_that_of_its_own_surface(tmp_path):
    red = {"baseColorFactor": [1.0, 0.0, linear_from_srgb(0.2).item(), 1.0]}
    found = read_mesh(stored(tmp_path / "a.glb", red, None, {})).colors_srgb
    np.testing.assert_array_equal(found, 4 * [[255, 0, 51]] + 8 * [[255, 255, 255]])


def test_vertices_factor_and_texture_are_multiplied_as_light(tmp_path):
    path = stored(tmp_path / "a.glb", TEXTURED | {"baseColorFactor": [0.5, 1, 0.25, 1]}, colors=4 * [[0.9, 0.3, 0.6]])
    product = linear_from_srgb(SEEN / 255.0) * [0.45, 0.3, 0.15]
    np.testing.assert_allclose(read_mesh(path).colors_srgb, 255 * srgb_from_linear(product), atol=0.51)


def test_a_reader_that_paints_for_itself_gets_the_colours_of_vertices_alone(tmp_path):
    grey = 4 * [[0.5, 0.5, 0.5]]
    found = read_mesh(stored(tmp_path / "a.glb", TEXTURED, colors=grey), painted=False).colors_srgb
    np.testing.assert_array_equal(found, np.full((4, 3), 188))
    found = read_mesh(stored(tmp_path / "b.glb", TEXTURED, uri="none.png"), painted=False).colors_srgb
    assert (found == 255).all()


def test_a_picture_beside_a_gltf_is_read(tmp_path):
    (tmp_path / "a b.png").write_bytes(png())
    np.testing.assert_array_equal(read_mesh(stored(tmp_path / "a.glb", TEXTURED, uri="a%20b.png")).colors_srgb, SEEN)


def test_without_coordinates_the_factor_is_left(tmp_path):
    found = read_mesh(stored(tmp_path / "a.glb", TEXTURED | {"baseColorFactor": [1, 0, 0, 1]}, uv=None)).colors_srgb
    np.testing.assert_array_equal(found, 4 * [[255, 0, 0]])


@pytest.mark.parametrize("broken", [{"uri": "none.png"}, {"content": png()[:40]}, {"content": b"\xabKTX 20\xbb" * 9}])
def test_pictures_that_cannot_be_read_are_said_once(tmp_path, broken):
    with pytest.warns(DataWarning, match=r"a\.glb: 1 textures cannot be decoded") as warned:
        mesh = read_mesh(stored(tmp_path / "a.glb", TEXTURED, TEXTURED, **broken))
    assert len(warned) == 1 and len(mesh.vertices) == 8


@pytest.mark.filterwarnings("error")
def test_more_pictures_than_are_kept_at_a_time_are_decoded_again(tmp_path, monkeypatch):
    monkeypatch.setattr("splat2mesh.scene.gltftextures.MOST_TEXELS", 5)
    path = stored(tmp_path / "a.glb", *(dict(TEXTURED) for _ in range(3)))
    size, text = int.from_bytes(path.read_bytes()[12:16], "little"), path.read_bytes()
    document = json.loads(text[20 : 20 + size])
    document["images"] *= 3
    document["textures"] = [{"source": number} for number in range(3)]
    for number, material in enumerate(document["materials"]):
        material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": number}
    path.write_bytes(_glb(document, text[28 + size :]))
    np.testing.assert_array_equal(read_mesh(path).colors_srgb, np.tile(SEEN, (3, 1)))
