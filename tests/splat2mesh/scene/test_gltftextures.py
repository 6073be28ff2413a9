"""Textures of glTF: the picture of each kind, where it lies, and one warning about what cannot be decoded."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image
from textured_quads import FOUR, packed, textured, write_square

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.gltf import GltfData
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.gltfmesh import placed_pieces, read_gltf
from splat2mesh.scene.gltftextures import GREY, SPECULAR_GLOSSINESS, Textures, base_color

MIDDLES = np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]])
SEEN = linear_from_srgb(FOUR.reshape(4, 3) / np.float32(255.0))
KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(60)
DEEP = np.array([[0, 12850], [40000, 65535]], np.uint16)


def read(path):
    """The MappedTexture of a file's material, and the Textures."""
    data = GltfData(path)
    textures = Textures(data)
    (piece,) = placed_pieces(data)
    return textures.on(base_color(data.document.materials[0])[1], piece.held), textures


def colors(path, places=MIDDLES):
    texture, textures = read(path)
    textures.warn_lost()
    return texture.color(places)


def extended(name, picture, **more):
    return [{"extensions": {name: {"source": picture}}, **more}]


@pytest.mark.parametrize("kind", ["PNG", "WEBP", "BMP"])
def test_a_picture_of_any_kind_shows_its_texels(tmp_path, kind):
    textures = extended("EXT_texture_webp", 0) if kind == "WEBP" else [{"source": 0}]
    path = write_square(tmp_path / "a.glb", textured(), [packed(FOUR, kind)], textures)
    np.testing.assert_array_equal(colors(path), SEEN)


def test_an_extension_goes_before_the_picture_that_stands_in_for_it_unless_it_cannot_be_decoded(tmp_path):
    pictures = [packed(255 - FOUR), packed(FOUR, "WEBP")]
    path = write_square(tmp_path / "a.glb", textured(), pictures, extended("EXT_texture_webp", 1, source=0))
    np.testing.assert_array_equal(colors(path), SEEN)
    pictures = [packed(FOUR), KTX2]
    path = write_square(tmp_path / "b.glb", textured(), pictures, extended("KHR_texture_basisu", 1, source=0))
    np.testing.assert_array_equal(colors(path), SEEN)


def test_what_cannot_be_decoded_is_grey_and_named_once(tmp_path):
    textures = extended("KHR_texture_basisu", 0)
    path = write_square(tmp_path / "a.glb", textured(), [KTX2], textures, extensionsRequired=["KHR_texture_basisu"])
    with pytest.warns(DataWarning, match=r"a\.glb: 1 textures cannot be decoded \(KHR_texture_basisu\)") as seen:
        np.testing.assert_allclose(colors(path), GREY, atol=3e-3)  # half a step of a byte
    assert len(seen) == 1
    texture, textures = read(path)
    assert not texture.decoded
    with pytest.raises(InputError, match="texture 0 has no picture"):
        textures.encoded(0)


def test_pictures_of_16_bits_keep_their_light(tmp_path):
    path = write_square(tmp_path / "a.glb", textured(), [packed(DEEP)], [{"source": 0}])
    grey = linear_from_srgb(DEEP.reshape(4, 1) / np.float32(65535.0))
    np.testing.assert_allclose(colors(path), np.repeat(grey, 3, axis=1), rtol=1e-6)


def deep_png(pixels):
    """The bytes of a PNG of 16 bits, (H, W, C) uint16 with 1 to 4 channels, written out by hand."""
    height, width, channels = pixels.shape
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in pixels)
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, 0)), (b"IDAT", zlib.compress(rows))]
    found = b"\x89PNG\r\n\x1a\n"
    for name, data in [*chunks, (b"IEND", b"")]:
        found += struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    return found


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_pictures_of_16_bits_of_every_kind_show_what_those_of_8_bits_do(tmp_path, channels):
    small = np.random.default_rng(0).integers(0, 256, (2, 2, channels)).astype(np.uint16)
    path = write_square(tmp_path / "a.glb", textured(), [deep_png(small * 257)], [{"source": 0}])
    shown = small[..., :3] if channels > 2 else np.repeat(small[..., :1], 3, axis=2)
    expected = linear_from_srgb(shown.reshape(4, 3) / np.float32(255.0))
    np.testing.assert_allclose(colors(path), expected, rtol=1e-6)
    alpha = small[..., -1].ravel() / 255.0 if channels in (2, 4) else np.ones(4)
    np.testing.assert_allclose(read(path)[0].alpha(MIDDLES), alpha, atol=1e-6)


@pytest.mark.parametrize(
    ("transform", "expected"),
    [
        ({"offset": [0.5, 0.0]}, lambda u, v: (u + 0.5, v)),
        ({"scale": [2.0, 1.0]}, lambda u, v: (2 * u, v)),
        # The two examples of the specification: the lower left quarter of the picture, turned; the origin below.
        (
            {"offset": [0.0, 1.0], "rotation": np.pi / 2, "scale": [0.5, 0.5]},
            lambda u, v: (0.5 * v, 1 - 0.5 * u),
        ),
        ({"offset": [0.0, 1.0], "scale": [1.0, -1.0]}, lambda u, v: (u, 1 - v)),
    ],
)
def test_coordinates_are_scaled_turned_and_moved(tmp_path, transform, expected):
    info = {"extensions": {"KHR_texture_transform": transform}}
    texture, _ = read(write_square(tmp_path / "a.glb", textured(info), [packed(FOUR)], [{"source": 0}]))
    given = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64)
    np.testing.assert_allclose(texture.uv, np.stack(expected(*given.T), axis=1), atol=1e-12)


def test_a_transform_may_name_other_coordinates(tmp_path):
    other = np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6], [0.7, 0.8]])
    for info in ({"texCoord": 1}, {"texCoord": 0, "extensions": {"KHR_texture_transform": {"texCoord": 1}}}):
        path = write_square(tmp_path / "a.glb", textured(info), [packed(FOUR)], [{"source": 0}], uv=other)
        np.testing.assert_allclose(read(path)[0].uv, other, atol=1e-7)


@pytest.mark.parametrize(("wrap", "inside"), [(10497, 0.1), (33071, 0.99), (33648, 0.9)])
def test_beyond_the_picture_samplers_repeat_clamp_or_mirror(tmp_path, wrap, inside):
    textures = [{"source": 0, "sampler": 0}]
    path = write_square(tmp_path / "a.glb", textured(), [packed(FOUR)], textures, samplers=[{"wrapS": wrap}])
    np.testing.assert_array_equal(colors(path, [[1.1, 0.25]]), colors(path, [[inside, 0.25]]))


def test_alpha_is_linear_between_texels_and_colour_comes_from_what_is_not_cut(tmp_path):
    pixels = np.zeros((1, 2, 4), np.uint8)
    pixels[0] = [[0, 0, 0, 0], [255, 128, 0, 255]]
    wraps = [{"wrapS": 33071, "wrapT": 33071}]
    path = write_square(tmp_path / "a.glb", textured(), [packed(pixels)], [{"source": 0, "sampler": 0}], samplers=wraps)
    texture, _ = read(path)
    along = np.array([0.0, 0.25, 0.4, 0.5, 0.75, 1.0])
    places = np.stack([along, np.full(6, 0.5)], axis=1)
    np.testing.assert_allclose(texture.alpha(places), [0.0, 0.0, 0.3, 0.5, 1.0, 1.0], atol=1e-6)
    orange = linear_from_srgb(np.array([255, 128, 0]) / np.float32(255.0))
    np.testing.assert_allclose(texture.color(places, 0.5), np.tile(orange, (6, 1)), rtol=1e-6)
    assert (texture.color(places[:1]) == 0.0).all()


@pytest.mark.parametrize(
    ("material", "factor", "index"),
    [
        ({}, [1, 1, 1, 1], None),
        ({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.2, 0.1, 1]}}, [0.5, 0.2, 0.1, 1], None),
        ({"diffuseFactor": [0.5, 0.2, 0.1, 0.9], "specularFactor": [0.04] * 3}, [0.5, 0.2, 0.1, 0.9], None),
        ({"diffuseTexture": {"index": 3}, "specularFactor": [0, 0, 0]}, [1, 1, 1, 1], 3),
        ({"diffuseFactor": [0, 0, 0, 1], "specularFactor": [1.0, 0.77, 0.34]}, [1.0, 0.77, 0.34, 1], None),
    ],
)
def test_the_colour_of_a_material_in_both_models(material, factor, index):
    from splat2mesh.base.gltf import Record
    from splat2mesh.base.inputs import loads

    if "pbrMetallicRoughness" not in material and material:
        material = {"extensions": {SPECULAR_GLOSSINESS: material}}
    import json

    found, texture = base_color(loads(json.dumps(material), object_hook=Record))
    assert found == factor and (texture and texture.index) == index


def test_pictures_that_are_too_large_are_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("splat2mesh.scene.gltftextures.MOST_TEXELS", 3)
    path = write_square(tmp_path / "a.glb", textured(), [packed(FOUR)], [{"source": 0}])
    with pytest.raises(InputError, match="pictures have over 3 pixels"):
        read(path)


def test_no_program_is_started_for_a_picture(tmp_path):
    """Pillow has other programs draw PostScript."""
    path = write_square(
        tmp_path / "a.glb", textured(), [b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 2 2\n"], [{"source": 0}]
    )
    with pytest.warns(DataWarning, match="another kind of picture"):
        colors(path)


def test_copies_stand_where_their_arrays_put_them(tmp_path):
    quarter = np.sqrt(0.5)
    copies = {
        "TRANSLATION": np.array([[0, 0, 0], [5, 0, 0], [0, 7, 0.0]]),
        "ROTATION": np.array([[0, 0, 0, 1], [0, quarter, 0, quarter], [0, 0, 0, 1]]),
        "SCALE": np.array([[1, 1, 1], [1, 1, 1], [2, 2, 2.0]]),
    }
    path = write_square(tmp_path / "a.glb", {}, copies=copies, extensionsRequired=["EXT_mesh_gpu_instancing"])
    found = read_gltf(path)
    # The second is turned by 90 degrees about y: z goes to x, x to -z.
    bounds = [found.points[found.faces[2 * k : 2 * k + 2]].reshape(-1, 3) for k in range(3)]
    low = [each.min(axis=0) for each in bounds]
    high = [each.max(axis=0) for each in bounds]
    np.testing.assert_allclose(low, [[0, 0, 0], [5, 0, -1], [0, 7, 0]], atol=1e-6)
    np.testing.assert_allclose(high, [[1, 0, 1], [6, 0, 0], [2, 7, 2]], atol=1e-6)
    single = read_gltf(write_square(tmp_path / "b.glb", {}, copies={"TRANSLATION": np.array([[1, 2, 3.0]])}))
    np.testing.assert_allclose(single.points.min(axis=0), [1, 2, 3])


@pytest.mark.parametrize(
    ("copies", "says"),
    [
        ({"TRANSLATION": np.zeros((2, 3)), "SCALE": np.ones((3, 3))}, "have a TRANSLATION of shape"),
        ({"TRANSLATION": np.zeros((2, 2))}, "have a TRANSLATION of shape"),
        ({"SCALE": np.full((2, 3), np.nan)}, "not finite"),
    ],
)
def test_copies_of_other_shapes_are_refused(tmp_path, copies, says):
    with pytest.raises(InputError, match=says):
        read_gltf(write_square(tmp_path / "a.glb", {}, copies=copies))


def test_more_copies_than_can_be_placed_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("splat2mesh.base.gltfnodes.MOST_NODES", 3)
    path = write_square(tmp_path / "a.glb", {}, copies={"TRANSLATION": np.zeros((4, 3))})
    with pytest.raises(InputError, match="are 4, expected at most 3"):
        read_gltf(path)
    monkeypatch.setattr("splat2mesh.scene.gltfmesh.FREE_CORNERS", 1)
    path = write_square(tmp_path / "b.glb", {}, copies={"SCALE": np.ones((3, 3))})
    monkeypatch.setattr("splat2mesh.base.gltf.GltfData.size", 1, raising=False)
    assert len(read_gltf(path).faces) == 2 * 3


def test_palettes_keep_their_alpha(tmp_path):
    image = Image.fromarray(np.dstack([FOUR, np.array([[255, 0], [255, 255]], np.uint8)])).quantize(8)
    from io import BytesIO

    content = BytesIO()
    image.save(content, "PNG")
    texture, _ = read(write_square(tmp_path / "a.glb", textured(), [content.getvalue()], [{"source": 0}]))
    np.testing.assert_array_equal(texture.alpha(MIDDLES), [1.0, 0.0, 1.0, 1.0])
