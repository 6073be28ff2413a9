"""SPZ from another implementation's writer, and the frame in which it comes back; the header-less .splat."""

import gzip
import struct
from dataclasses import replace

import gsply
import imagecodecs
import numpy as np
import pytest
from splat_samples import assert_same, make_splats, store
from turned_splats import turned_y_up

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.cleaning import clean
from splat2mesh.splats.facts import NO_FACTS
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.formats.spz import _unpacked


@pytest.fixture
def spz_writer():
    """Another implementation's writer (gsply, C++); it stores arrays as they are: turn them first."""
    gsply.use_backend("cpp")

    def write(path, splats, version):
        data = gsply.GSData.from_arrays(
            means=splats.means,
            scales=np.log(splats.scales),
            quats=splats.quats_wxyz,
            opacities=np.log(splats.opacities / (1 - splats.opacities)),
            sh0=splats.sh[:, 0],
            shN=splats.sh[:, 1:] if splats.degree else None,
            format="ply",
        )
        gsply.write_spz(path, data, version=version)
        return path

    yield write
    gsply.use_backend("python")


def assert_close_to_spz(found, splats, rotation):
    """Equal to the quantisation: 2^-12 for positions, 1/16 for log scales, bytes for the rest."""
    np.testing.assert_allclose(found.means, splats.means, atol=0.5001 * 2**-12)
    np.testing.assert_allclose(np.log(found.scales), np.log(splats.scales), atol=0.5001 / 16)
    np.testing.assert_allclose(found.opacities, splats.opacities, atol=0.51 / 255)
    np.testing.assert_allclose(found.sh[:, 0], splats.sh[:, 0], atol=0.51 / 255 / 0.15)
    np.testing.assert_allclose(found.sh[:, 1:], splats.sh[:, 1:], atol=0.51 / 128)
    # Directions of the principal axes agree up to sign, so compare what they do to a vector of variances.
    shape = replace(found, scales=splats.scales).covariances()
    largest = (splats.scales.max(axis=1) ** 2)[:, None, None]
    np.testing.assert_allclose(shape / largest, splats.covariances() / largest, atol=rotation)


def small_color_splats(n, degree):
    """Splats whose coefficients fit the ranges of SPZ."""
    splats = make_splats(n, degree)
    return replace(splats, sh=np.clip(splats.sh / 4, -0.95, 0.95))


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("version", [3, 4])
def test_spz_comes_back_in_the_frame_of_the_ply(tmp_path, spz_writer, version, degree):
    splats = small_color_splats(200, degree)
    found = read_splats(spz_writer(tmp_path / "a.spz", turned_y_up(splats), version))
    # A component is off by at most 1/(2 * 511 * sqrt(2)) = 7e-4, an entry of R S R^T by some six times that.
    assert_close_to_spz(found, splats, rotation=0.005)
    # 0.51/128 on each of 15 coefficients with basis values below 0.8, and 0.51/255/0.15 on the constant one.
    np.testing.assert_allclose(found.colors_toward((3, -2, 1)), splats.colors_toward((3, -2, 1)), atol=0.03)


def test_spz_version_2(tmp_path):
    splats = small_color_splats(100, 1)
    up = turned_y_up(splats)
    fixed = np.rint(up.means * 4096).astype("<i4")
    xyz = up.quats_wxyz[:, 1:] * np.where(up.quats_wxyz[:, :1] < 0, -1, 1)
    sections = [
        np.ascontiguousarray(fixed)[..., None].view(np.uint8)[..., :3],
        np.rint(up.opacities * 255),
        np.rint(up.sh[:, 0] * 0.15 * 255 + 127.5),
        np.rint((np.log(up.scales) + 10) * 16),
        np.rint((xyz + 1) * 127.5),
        np.rint(up.sh[:, 1:] * 128 + 128),
    ]
    header = struct.pack("<4sIIBBBB", b"NGSP", 2, 100, 1, 12, 0, 0)
    data = header + b"".join(section.astype(np.uint8).tobytes() for section in sections)
    found = read_splats(store(tmp_path, "a.spz", gzip.compress(data)))
    # x, y, z are off by 1/255; w = sqrt(1 - ...) multiplies that where it is small.
    assert_close_to_spz(found, splats, rotation=0.1)


@pytest.mark.parametrize("version", [3, 4])
def test_a_damaged_spz_is_refused(tmp_path, spz_writer, version):
    path = spz_writer(tmp_path / "a.spz", small_color_splats(200, 1), version)
    data = path.read_bytes()
    for cut in (5, 17, 33, len(data) // 2, len(data) - 20):
        with pytest.raises(InputError, match="SPZ"):
            read_splats(store(tmp_path, "cut.spz", data[:cut]))
    flipped = bytearray(data)
    # gzip carries a checksum; version 4 carries none, so there the mark of the first zstd stream is hit.
    flipped[len(data) // 2 if version == 3 else 32 + 6 * 16] ^= 0xFF
    with pytest.raises(InputError, match="SPZ"):
        read_splats(store(tmp_path, "flipped.spz", bytes(flipped)))


def test_zstd_frames_are_unpacked_up_to_the_announced_size():
    data = np.random.default_rng(0).integers(0, 4, 100_000, dtype=np.uint8).tobytes()
    packed = imagecodecs.zstd_encode(data)
    assert _unpacked(packed, len(data)) == data == _unpacked(packed + imagecodecs.zstd_encode(b""), len(data))
    assert _unpacked(packed + packed, 2 * len(data)) == data + data
    assert _unpacked(b"", 5) == b""
    bomb = imagecodecs.zstd_encode(bytes(1 << 26))
    for damaged, most, message in (
        (bomb, 1000, "more than its header announces"),
        (packed + packed, len(data), "more than its header announces"),
        (packed[:-5], len(data), "lacks its end"),
        (packed + b"junk", len(data), "."),
        (b"junk", 5, "."),
    ):
        with pytest.raises(ValueError, match=message):
            _unpacked(damaged, most)


def splat_bytes(splats):
    color = np.clip(np.rint(splats.colors_diffuse * 255), 0, 255).astype(np.uint8)
    alpha = np.rint(splats.opacities * 255).astype(np.uint8)
    quats = np.clip(np.rint(splats.quats_wxyz * 128 + 128), 0, 255).astype(np.uint8)
    records = (
        struct.pack("<6f", *splats.means[i], *splats.scales[i]) + bytes([*color[i], alpha[i], *quats[i]])
        for i in range(len(splats))
    )
    return b"".join(records)


def test_dotsplat(tmp_path):
    splats = make_splats(50, 0)
    found = read_splats(store(tmp_path, "a.splat", splat_bytes(splats)))
    np.testing.assert_array_equal(found.means, splats.means)
    np.testing.assert_array_equal(found.scales, splats.scales)
    # Half a step of the bytes: 1/255 for colours, 1/128 for quaternions (where 1.0 is also clipped by one).
    np.testing.assert_allclose(found.colors_diffuse, np.clip(splats.colors_diffuse, 0, 1), atol=0.51 / 255)
    np.testing.assert_allclose(found.opacities, splats.opacities, atol=0.51 / 255)
    np.testing.assert_allclose(found.quats_wxyz, splats.quats_wxyz, atol=1 / 64)
    assert read_splats(tmp_path / "a.splat").facts == NO_FACTS
    with pytest.warns(DataWarning, match="ignored 7 bytes"):
        assert_same(read_splats(store(tmp_path, "b.splat", splat_bytes(splats) + bytes(7))), found)


def test_quaternions_of_a_dotsplat_may_have_any_length(tmp_path):
    """Two public files hold 255 255 255 255: a turn about the diagonal. Zero ones are dropped and counted."""
    splats = make_splats(50, 0)
    data = bytearray(splat_bytes(splats))
    for row in range(50):
        data[32 * row + 28 : 32 * row + 32] = bytes([128] * 4 if row < 5 else [255] * 4)
    found = read_splats(store(tmp_path, "a.splat", bytes(data)))
    np.testing.assert_allclose(found.quats_wxyz[5:], 0.5)
    with pytest.warns(DataWarning, match="dropped splats: 5 with a zero quaternion"):
        assert len(clean(found)[0]) == 45
