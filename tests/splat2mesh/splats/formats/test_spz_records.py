"""Records of SPZ's extensions: the frame they state, and the others; the antialiased bit; the fourth degree."""

import gzip
import itertools
import struct

import imagecodecs
import numpy as np
import pytest
from splat_samples import assert_same, make_splats, store

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.facts import FileFacts
from splat2mesh.splats.formats import read_splats, write_splats
from splat2mesh.splats.placing import reframed

HEADER = struct.Struct("<4sIIBBBB")
AXES, ORBIT = 0xADBE0003, 0xADBE0002
NAMES = "LDB RDB LUB RUB LDF RDF LUF RUF LFD RFD LFU RFU LBD RBD LBU RBU".split()
IN_PLY = {"R": (1, 0, 0), "L": (-1, 0, 0), "D": (0, 1, 0), "U": (0, -1, 0), "F": (0, 0, 1), "B": (0, 0, -1)}
"""Directions in the frame of a PLY: x right, y down, z front."""


def record(kind, content):
    return struct.pack("<II", kind, len(content)) + content


def axes_record(number):
    return record(AXES, struct.pack("<I", number))


def tame(n, degree):
    splats = make_splats(n, degree)
    object.__setattr__(splats, "sh", (splats.sh / 8).clip(-0.9, 0.9))
    return splats


def plain(tmp_path, splats):
    """(header, body) of a version 3 file."""
    write_splats(tmp_path / "plain.spz", splats, "spz")
    data = gzip.decompress((tmp_path / "plain.spz").read_bytes())
    return list(HEADER.unpack_from(data)), data[HEADER.size :]


def version_3(header, body, records=b"", flags=0):
    magic, _, count, degree, bits, _, _ = header
    flags |= 2 if records else 0
    return gzip.compress(HEADER.pack(magic, 3, count, degree, bits, flags, 0) + body + records, mtime=0)


def version_4(header, body, records=b"", flags=0):
    magic, _, count, degree, bits, _, _ = header
    widths = [width for width in (9, 1, 3, 3, 4, 3 * ((degree + 1) ** 2 - 1)) if width]
    ends = np.cumsum([0, *widths]) * count
    parts = [body[a:b] for a, b in itertools.pairwise(ends)]
    packed = [imagecodecs.zstd_encode(part) for part in parts]
    table = b"".join(struct.pack("<QQ", len(a), len(b)) for a, b in zip(packed, parts, strict=True))
    head = HEADER.pack(magic, 4, count, degree, bits, flags | (2 if records else 0), len(parts))
    head += struct.pack("<I", 32 + len(records)) + bytes(12)
    return head + records + table + b"".join(packed)


VERSIONS = pytest.mark.parametrize("pack", [version_3, version_4])


@VERSIONS
@pytest.mark.parametrize("number", range(17))
def test_a_stated_frame_is_converted(tmp_path, pack, number):
    """Whatever axes the same numbers are said to be in, each stored axis points where its letter says."""
    header, body = plain(tmp_path, tame(30, 2))
    usual = read_splats(store(tmp_path, "usual.spz", pack(header, body)))
    found = read_splats(store(tmp_path, "a.spz", pack(header, body, axes_record(number))))
    name = ("RUB", *NAMES)[number]
    stored = usual.means * np.float32([1, -1, -1])
    np.testing.assert_allclose(found.means, stored @ np.array([IN_PLY[letter] for letter in name]), atol=1e-6)
    # The rest of a splat follows its places: one mechanism turns both.
    turn = np.array([IN_PLY[letter] for letter in name]).T @ np.diag([1, -1, -1])
    expected = reframed(usual, turn)
    np.testing.assert_allclose(found.covariances(), expected.covariances(), atol=1e-6)
    np.testing.assert_allclose(found.sh, expected.sh, atol=1e-6)
    assert "SPZ_ADOBE_coordinate_system" in found.facts.frame


@VERSIONS
def test_the_same_splats_in_two_frames_are_equal(tmp_path, pack):
    """A writer turns what it stores: RDF, the frame of a PLY, reads as the usual file does, bit by bit."""
    splats = tame(40, 3)
    header, body = plain(tmp_path, splats)
    usual = read_splats(store(tmp_path, "usual.spz", pack(header, body)))
    turned, other = plain(tmp_path, reframed(usual, np.diag([1.0, -1.0, -1.0])))
    found = read_splats(store(tmp_path, "a.spz", pack(turned, other, axes_record(6))))
    for name in ("means", "scales", "opacities"):
        np.testing.assert_array_equal(getattr(found, name), getattr(usual, name))
    np.testing.assert_allclose(found.sh, usual.sh, atol=1.01 / 128)


@VERSIONS
def test_other_records_are_left_out_with_a_count(tmp_path, pack):
    header, body = plain(tmp_path, tame(30, 1))
    usual = read_splats(store(tmp_path, "usual.spz", pack(header, body)))
    records = record(ORBIT, struct.pack("<3f", -0.5, 0.5, 1)) + axes_record(4) + record(0x12340001, b"abc")
    with pytest.warns(DataWarning, match=r"left out 2 records of SPZ extensions.*0xadbe0002, 0x12340001"):
        found = read_splats(store(tmp_path, "a.spz", pack(header, body, records)))
    for name in ("means", "scales", "quats_wxyz", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(found, name), getattr(usual, name))
    for unknown in (axes_record(17), record(AXES, b"12")):
        with pytest.warns(DataWarning, match="left out 1 records"):
            assert_same(read_splats(store(tmp_path, "b.spz", pack(header, body, unknown))), usual)


@VERSIONS
def test_records_that_do_not_fit_are_refused(tmp_path, pack):
    header, body = plain(tmp_path, tame(30, 1))
    for records in (b"abc", axes_record(6)[:-1], struct.pack("<II", 5, 0xFFFFFFFF), axes_record(6) + b"\0"):
        with pytest.raises(InputError, match=r"record of its SPZ extensions goes beyond"):
            read_splats(store(tmp_path, "a.spz", pack(header, body, records)))
    with pytest.raises(InputError, match=r"holds more than its header announces|takes|damaged"):
        read_splats(store(tmp_path, "b.spz", version_3(header, body, bytes(2 << 20))))


def test_bytes_at_the_end_without_the_flag_stay_damage(tmp_path):
    header, body = plain(tmp_path, tame(30, 1))
    with pytest.raises(InputError, match="holds more than its header announces"):
        read_splats(store(tmp_path, "a.spz", version_3(header, body + axes_record(6))))


@VERSIONS
def test_the_antialiased_bit(tmp_path, pack):
    header, body = plain(tmp_path, tame(30, 0))
    assert read_splats(store(tmp_path, "a.spz", pack(header, body, flags=1))).facts == FileFacts(antialiased=True)
    assert read_splats(store(tmp_path, "b.spz", pack(header, body))).facts.antialiased is None


@VERSIONS
def test_the_fourth_degree_is_dropped_with_a_count(tmp_path, pack):
    header, body = plain(tmp_path, tame(30, 3))
    third = read_splats(store(tmp_path, "third.spz", pack(header, body)))
    rest = np.frombuffer(body[-45 * 30 :], np.uint8).reshape(30, 45)
    more = np.random.default_rng(0).integers(0, 256, (30, 27), dtype=np.uint8)
    wide = body[: -45 * 30] + np.hstack([rest, more]).tobytes()
    header[3] = 4
    with pytest.warns(DataWarning, match="dropped the harmonics above degree 3 of 30 splats, whose degree is 4"):
        assert_same(read_splats(store(tmp_path, "a.spz", pack(header, wide))), third)


def test_scales_that_do_not_fit_are_counted(tmp_path):
    splats = tame(30, 0)
    splats.scales[:3, 1] = np.exp(-13)
    with pytest.warns(DataWarning, match=r"scales below e\^-10 or above e\^5\.9 of 3 of 30 splats were clipped"):
        write_splats(tmp_path / "a.spz", splats, "spz")
    found = read_splats(tmp_path / "a.spz")
    np.testing.assert_allclose(np.log(found.scales[:3, 1]), -10)
    np.testing.assert_allclose(np.log(found.scales[3:]), np.log(splats.scales[3:]), atol=0.5001 / 16)
