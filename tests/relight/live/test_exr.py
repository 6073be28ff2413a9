"""The page's own reader of OpenEXR pictures, run by node, against OpenEXR's."""

import json
import shutil
import subprocess
from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
import pytest
from color_primaries import PRIMARIES, expected_matrix

ROOT = Path(__file__).parents[3]

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")

READ = {
    "none": OpenEXR.NO_COMPRESSION,
    "rle": OpenEXR.RLE_COMPRESSION,
    "zips": OpenEXR.ZIPS_COMPRESSION,
    "zip": OpenEXR.ZIP_COMPRESSION,
    "piz": OpenEXR.PIZ_COMPRESSION,
}

SIZES = [(1, 1), (2, 1), (16, 8), (37, 19), (128, 64), (5, 70)]
"""Width, height: odd ones, and more rows than a block of each kind."""


def read(folder, files):
    """What the reader says of each file, and its picture where it read one."""
    pairs = [[str(file), str(folder / f"{i}.f32")] for i, file in enumerate(files)]
    script = ROOT / "tests/support/read_exr.mjs"
    done = subprocess.run(
        ["node", script, ROOT / "relight/live/web", json.dumps(pairs)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    for said, (_, out) in zip(json.loads(done.stdout), pairs, strict=True):
        picture = np.fromfile(out, np.float32).reshape(*said["size"][::-1], 3) if "size" in said else None
        yield said, picture


def write(path, channels, compression):
    channels = {name: np.ascontiguousarray(each) for name, each in channels.items()}  # strides are ignored
    OpenEXR.File({"compression": compression, "type": OpenEXR.scanlineimage}, channels).write(str(path))
    return path


def light(width, height, dtype, seed=0, smooth=False):
    rng = np.random.default_rng(seed)
    image = np.exp(rng.normal(0, 3, (height, width, 3))) if not smooth else np.ones((height, width, 3))
    if smooth:  # long runs, and fewer than 16,384 values: the wavelet of 14 bits
        image[height // 3 :, : width // 2] = [0.25, 7.0, 0.0]
    return np.minimum(image, 6e4).astype(dtype)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("compression", READ)
def test_every_pixel_is_that_of_openexr(tmp_path, compression, dtype, smooth):
    images = [light(*size, dtype, seed, smooth) for seed, size in enumerate(SIZES)]
    files = [write(tmp_path / f"{i}.exr", {"RGB": image}, READ[compression]) for i, image in enumerate(images)]
    for (said, found), image in zip(read(tmp_path, files), images, strict=True):
        assert "error" not in said, said
        np.testing.assert_array_equal(found, image.astype(np.float32))


def test_more_than_16384_values_take_the_wavelet_of_16_bits(tmp_path):
    image = light(256, 128, np.float16)
    assert len(np.unique(image.view(np.uint16))) > 1 << 14
    [(_, found)] = read(tmp_path, [write(tmp_path / "a.exr", {"RGB": image}, READ["piz"])])
    np.testing.assert_array_equal(found, image.astype(np.float32))


def test_alpha_layers_and_grey(tmp_path):
    """Names of channels lie in the file by alphabet, whatever order they were given in."""
    image, other = light(20, 10, np.float16), light(20, 10, np.float32, 1)
    both = {"RGBA": np.dstack([image, np.ones((10, 20), np.float16)]), "depth": other[..., 0]}
    layer = {f"sky.{name}": other[..., k] for k, name in enumerate("RGB")}
    files = [
        write(tmp_path / "alpha.exr", both, READ["piz"]),
        write(tmp_path / "layer.exr", layer, READ["zip"]),
        write(tmp_path / "grey.exr", {"Y": other[..., 1]}, READ["zips"]),
    ]
    expected = [image, other, np.repeat(other[..., 1:2], 3, axis=2)]
    for (_, found), wanted in zip(read(tmp_path, files), expected, strict=True):
        np.testing.assert_array_equal(found, wanted.astype(np.float32))


def test_of_several_layers_the_picture_is_the_light(tmp_path):
    image, other = light(20, 10, np.float32), light(20, 10, np.float32, 1)
    layer = {f"V.Combined.{name}": image[..., k] for k, name in enumerate("RGB")}
    layer |= {f"V.AO.{name}": other[..., k] for k, name in enumerate("RGB")}
    grey = {"Y": image[..., 1]} | {f"AO.{name}": other[..., k] for k, name in enumerate("RGB")}
    files = [write(tmp_path / "a.exr", layer, READ["zip"]), write(tmp_path / "b.exr", grey, READ["zip"])]
    (_, found), (_, without) = read(tmp_path, files)
    np.testing.assert_array_equal(found, image)
    np.testing.assert_array_equal(without, np.repeat(image[..., 1:2], 3, axis=2))


@pytest.mark.parametrize("space", PRIMARIES)
def test_primaries_are_converted_as_they_are_where_pictures_are_lit(tmp_path, space):
    image = np.random.default_rng(3).random((10, 20, 3), np.float32) + np.float32(0.1)
    stored = (image @ expected_matrix(PRIMARIES[space]).T).astype(np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header | {"chromaticities": PRIMARIES[space]}, {"RGB": stored}).write(str(tmp_path / "a.exr"))
    line = " ".join(f"{each:.6f}" for each in PRIMARIES[space])
    packed = imagecodecs.rgbe_encode(stored).replace(b"\n\n", f"\nPRIMARIES= {line}\n\n".encode(), 1)
    (tmp_path / "a.hdr").write_bytes(packed)
    (_, found), (_, other) = read(tmp_path, [tmp_path / "a.exr", tmp_path / "a.hdr"])
    np.testing.assert_allclose(found, image, atol=1e-5)
    assert (np.abs(other - image) <= 3 / 128 * image.max(axis=2, keepdims=True)).all()


def test_no_light_is_negative_or_without_a_number(tmp_path):
    image = np.array([[[1.0, -2.0, np.nan], [np.inf, 0.5, -np.inf]]], np.float32)
    [(_, found)] = read(tmp_path, [write(tmp_path / "a.exr", {"RGB": image}, READ["none"])])
    np.testing.assert_array_equal(found, [[[1, 0, 0], [0, 0.5, 0]]])


def test_what_is_not_read_is_said_in_one_line(tmp_path):
    image = light(64, 32, np.float16)
    (tmp_path / "not.exr").write_bytes(b"#?RADIANCE\n\n-Y 1 +X 1\n1234")
    files = [
        write(tmp_path / "b44.exr", {"RGB": image}, OpenEXR.B44_COMPRESSION),
        write(tmp_path / "dwaa.exr", {"RGB": image}, OpenEXR.DWAA_COMPRESSION),
        write(tmp_path / "depth.exr", {"Z": image[..., 0]}, READ["zip"]),
        tmp_path / "not.exr",
    ]
    messages = [said["error"] for said, _ in read(tmp_path, files)]
    assert messages == [
        "an .exr packed by B44: save it with ZIP or PIZ",
        "an .exr packed by DWAA: save it with ZIP or PIZ",
        "an .exr without R, G and B: it has Z",
        "not an OpenEXR picture",
    ]


@pytest.mark.parametrize("compression", READ)
def test_damaged_files_are_pictures_or_one_line(tmp_path, compression):
    """Cut anywhere, a file is refused. With a byte flipped it may be read, but nothing else than an Error comes out."""
    whole = write(tmp_path / "whole.exr", {"RGB": light(40, 40, np.float16)}, READ[compression]).read_bytes()
    rng, files = np.random.default_rng(1), []
    for i in range(60):
        damaged = bytearray(whole)
        if i < 20:
            damaged = damaged[: rng.integers(0, len(whole) - 1)]
        else:
            damaged[rng.integers(0, len(whole))] ^= 1 << rng.integers(8)
        files.append(tmp_path / f"{i}.exr")
        files[-1].write_bytes(damaged)
    said = [each for each, _ in read(tmp_path, files)]
    assert all("error" in each for each in said[:20])
    assert all(each["kind"] == "Error" and "\n" not in each["error"] for each in said if "error" in each)
