"""Splats written in each format: right to its quantisation, row by row, the same bytes again, as others read them."""

import gzip
import struct
from dataclasses import replace

import gsply
import numpy as np
import pytest
from splat_samples import assert_same, make_splats, store
from turned_splats import turned_y_up

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.formats import WRITERS, kind_of, read_splats, write_splats
from splat2mesh.splats.splats import ABSURD_LENGTH

QUANTISED = ("spz", "compressed.ply")
FIELDS = ("means", "scales", "opacities", "sh")


def tame_splats(n, degree, seed=0):
    """Splats whose harmonics fit the +-1 of SPZ."""
    splats = make_splats(n, degree, seed)
    return replace(splats, sh=np.clip(splats.sh / 4, -0.99, 0.99))


def small_splats(n, degree):
    """Splats whose harmonics fit the +-4 of compressed PLYs."""
    splats = make_splats(n, degree)
    return replace(splats, sh=np.clip(splats.sh, -3.99, 3.99))


def written(tmp_path, splats, kind, name="a"):
    path = tmp_path / f"{name}.{kind}"
    write_splats(path, splats, kind)
    return path


def assert_shapes_agree(found, splats, atol):
    """Covariances agree to `atol` of their largest variance; principal axes themselves may differ in sign."""
    largest = (splats.scales.max(axis=1) ** 2)[:, None, None]
    shape = replace(found, scales=splats.scales).covariances()
    np.testing.assert_allclose(shape / largest, splats.covariances() / largest, atol=atol)


@pytest.mark.parametrize("degree", range(4))
def test_compressed_ply_is_right_to_half_a_step(tmp_path, degree):
    splats = small_splats(600, degree)  # two whole chunks and a part of a third
    found = read_splats(written(tmp_path, splats, "compressed.ply"))
    for start in range(0, 600, 256):
        rows = slice(start, start + 256)
        for value, back, bits in (
            (splats.means, found.means, (11, 10, 11)),
            (np.log(splats.scales), np.log(found.scales), (11, 10, 11)),
            (splats.colors_diffuse, found.colors_diffuse, (8, 8, 8)),
        ):
            step = np.ptp(value[rows], axis=0) / (2.0 ** np.array(bits) - 1)
            # Beside half a step: float32 of the bounds, of the reader's sum and of the logarithm.
            assert (np.abs(back[rows] - value[rows]) <= 0.5 * step + 2e-6).all()
    np.testing.assert_allclose(found.opacities, splats.opacities, atol=0.5001 / 255)
    # Half a step of sqrt(2)/1023 on three components is at most 2.4e-3 of a radian in total.
    assert_shapes_agree(found, splats, 0.005)
    np.testing.assert_allclose(found.sh[:, 1:], splats.sh[:, 1:], atol=0.5001 / 32)
    assert found.degree == degree


@pytest.mark.parametrize("degree", range(4))
def test_spz_is_right_to_half_a_step_and_comes_back_in_its_frame(tmp_path, degree):
    splats = tame_splats(300, degree)
    found = read_splats(written(tmp_path, splats, "spz"))
    assert np.abs(splats.means).max() < 4  # so that 2^-21 is the finest step that 24 bits with a sign can hold
    np.testing.assert_allclose(found.means, splats.means, atol=0.5001 * 2.0**-21)
    np.testing.assert_allclose(np.log(found.scales), np.log(splats.scales), atol=0.5001 / 16)
    np.testing.assert_allclose(found.opacities, splats.opacities, atol=0.5001 / 255)
    np.testing.assert_allclose(found.sh[:, 0], splats.sh[:, 0], atol=0.5001 / 255 / 0.15)
    np.testing.assert_allclose(found.sh[:, 1:], splats.sh[:, 1:], atol=0.5001 / 128)
    assert_shapes_agree(found, splats, 0.005)  # components right to 1/(2 * 511 * sqrt(2)) = 7e-4
    assert found.degree == degree


def gsply_fields(data):
    """What gsply read, activated: means, scales, wxyz quaternions, opacities and (N, K, 3) harmonics."""
    sh = data.sh0[:, None] if data.shN is None else np.concatenate([data.sh0[:, None], data.shN], axis=1)
    return data.means, np.exp(data.scales), data.quats, 1 / (1 + np.exp(-data.opacities)), sh


def covariances(scales, quats_wxyz):
    return replace(make_splats(len(scales), 0), scales=scales, quats_wxyz=quats_wxyz).covariances()


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_another_implementation_reads_the_same_from_a_compressed_ply(tmp_path, degree):
    path = written(tmp_path, small_splats(600, degree), "compressed.ply")
    ours, (means, scales, quats, opacities, sh) = read_splats(path), gsply_fields(gsply.plyread(path))
    # Both decode the same integers; what differs is the order of float32 operations.
    np.testing.assert_allclose(means, ours.means, atol=2e-6)
    np.testing.assert_allclose(scales, ours.scales, rtol=1e-5)
    np.testing.assert_allclose(covariances(scales, quats), ours.covariances(), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(opacities, ours.opacities, atol=1e-5)
    np.testing.assert_allclose(sh[:, 0], ours.sh[:, 0], atol=1e-5)
    # gsply reads a cell of 1/32 at another place than its centre.
    np.testing.assert_allclose(sh[:, 1:], ours.sh[:, 1:], atol=1.001 / 32)


@pytest.mark.slow
@pytest.mark.parametrize("degree", [0, 1, 3])
def test_another_implementation_reads_the_same_from_an_spz_but_y_up(tmp_path, degree):
    path = written(tmp_path, tame_splats(300, degree), "spz")
    ours, (means, scales, quats, opacities, sh) = read_splats(path), gsply_fields(gsply.read_spz(path))
    flip = np.array([1, -1, -1])
    np.testing.assert_allclose(means, ours.means * flip, atol=1e-6)
    np.testing.assert_allclose(scales, ours.scales, rtol=1e-5)
    turned = ours.covariances() * np.outer(flip, flip)
    np.testing.assert_allclose(covariances(scales, quats), turned, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(opacities, ours.opacities, atol=1e-5)
    np.testing.assert_allclose(sh, turned_y_up(ours).sh, atol=1e-5)


@pytest.mark.parametrize("kind", WRITERS)
def test_the_same_splats_give_the_same_bytes_and_only_one_file(tmp_path, kind):
    splats = tame_splats(300, 0 if kind == "sog" else 2)
    first = written(tmp_path, splats, kind).read_bytes()
    assert written(tmp_path, splats, kind, "b").read_bytes() == first
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"a.{kind}", f"b.{kind}"]
    if kind == "spz":  # a date in the gzip header would make every file differ
        assert first[4:8] == bytes(4)


@pytest.mark.parametrize("kind", QUANTISED)
def test_what_was_quantised_once_stays(tmp_path, kind):
    """A relit file keeps, in the format of its source, everything but the colours exactly as it was."""
    once = read_splats(written(tmp_path, tame_splats(600, 3), kind))
    again = read_splats(written(tmp_path, once, kind, "b"))
    for name in FIELDS:
        # Bounds of a chunk go through float32 once more, which is right to 6e-8 of its extent, below 8.
        np.testing.assert_allclose(getattr(again, name), getattr(once, name), atol=5e-7, err_msg=name)
    # Where two components are equally large, either may be the one left out, which costs a step.
    assert_shapes_agree(again, once, 0.005)


def test_positions_of_an_spz_come_back_exactly(tmp_path):
    fixed = np.random.default_rng(0).integers(-(2**20), 2**20, (50, 3)) / 4096.0
    splats = replace(tame_splats(50, 0), means=fixed)
    np.testing.assert_array_equal(read_splats(written(tmp_path, splats, "spz")).means, splats.means)


def broken(splats):
    """The same splats with rows that nobody can draw."""
    means, scales, quats, sh = (a.copy() for a in (splats.means, splats.scales, splats.quats_wxyz, splats.sh))
    means[3, 1], means[5] = np.nan, 10 * ABSURD_LENGTH
    scales[7, 0], scales[9], scales[11, 2] = np.inf, 0, -1
    quats[300] = 0
    sh[301, -1, 2] = np.nan
    return replace(splats, means=means, scales=scales, quats_wxyz=quats, sh=sh), [3, 5, 7, 9, 11, 300, 301]


@pytest.mark.parametrize("kind", QUANTISED)
def test_rows_that_cannot_be_written_become_transparent_and_leave_the_others_alone(tmp_path, kind):
    splats = tame_splats(600, 1)
    bad, rows = broken(splats)
    with pytest.warns(DataWarning, match="7 of 600 splats have invalid values"):
        found = read_splats(written(tmp_path, bad, kind))
    stand_ins = np.arange(600)
    stand_ins[rows] = [20, 20, 20, 20, 20, 310, 310]  # of the same chunk, so that its bounds are those of the others
    expected = read_splats(written(tmp_path, splats.take(stand_ins), kind, "b"))
    keep = np.setdiff1d(np.arange(600), rows)
    assert_same(found.take(keep), expected.take(keep))
    assert len(found) == 600 and not found.opacities[rows].any()
    assert all(np.isfinite(getattr(found, name)).all() for name in FIELDS)


def test_a_ply_keeps_rows_that_are_not_finite(tmp_path):
    bad, _ = broken(make_splats(600, 1))
    found = read_splats(written(tmp_path, bad, "ply"))
    for name in ("means", "quats_wxyz", "sh"):
        np.testing.assert_array_equal(getattr(found, name), getattr(bad, name))


def test_an_spz_of_a_wide_scene_has_coarser_steps_and_of_a_tiny_one_finer(tmp_path):
    splats = tame_splats(2000, 0)
    for size in (1e-3, 1e3, 1e6):
        sized = replace(splats, means=splats.means * np.float32(size))
        found = read_splats(written(tmp_path, sized, "spz")).means
        # A 24-bit integer with a sign: half of 1/2^23 of the next power of two above the reach; never below 2^-25.
        step = max(2.0 ** (np.ceil(np.log2(np.abs(sized.means).max())) - 23), 2.0**-24)
        np.testing.assert_allclose(found, sized.means, atol=0.5001 * step)


def test_one_far_splat_does_not_coarsen_an_spz(tmp_path):
    splats = tame_splats(2000, 0)
    splats.means[77] = 1e6, -5.0, -2e5
    with pytest.warns(DataWarning, match="positions of 1 of 2000 splats were clipped"):
        found = read_splats(written(tmp_path, splats, "spz")).means
    others = np.arange(2000) != 77
    np.testing.assert_allclose(found[others], splats.means[others], atol=0.5001 / 4096)
    np.testing.assert_allclose(found[77], [2048, -5, -2048], atol=0.001)


@pytest.mark.parametrize(
    ("kind", "index", "value", "message", "back"),
    [
        ("spz", 3, 1.5, r"harmonics beyond \+-1 of 1 of 40 splats", 127 / 128),
        ("spz", 3, -1.5, r"harmonics beyond \+-1 of 1 of 40 splats", -1),
        ("spz", 0, 5, "colours of 1 of 40 splats", 0.5 / 0.15),
        ("compressed.ply", 2, 5, r"harmonics beyond \+-4 of 1 of 40 splats", 4),
    ],
)
def test_colours_that_do_not_fit_are_clipped_and_counted(tmp_path, kind, index, value, message, back):
    splats = tame_splats(40, 1)
    splats.sh[8, index] = value
    with pytest.warns(DataWarning, match=message):
        found = read_splats(written(tmp_path, splats, kind))
    np.testing.assert_allclose(found.sh[8, index], back, rtol=1e-6)


def test_one_flat_splat_does_not_coarsen_the_scales_of_its_chunk(tmp_path):
    splats = make_splats(256, 0)
    splats.scales[9, 1] = 0
    found = read_splats(written(tmp_path, splats, "compressed.ply"))
    others = np.arange(256) != 9
    # Logarithms from -20 to below 2 in 1023 steps.
    np.testing.assert_allclose(np.log(found.scales[others]), np.log(splats.scales[others]), atol=0.5 * 22 / 1023)
    assert found.scales[9, 1] == pytest.approx(np.exp(-20), rel=1e-4)


def test_a_chunk_without_extent(tmp_path):
    splats = make_splats(1, 0).take(np.zeros(300, int))
    found = read_splats(written(tmp_path, splats, "compressed.ply"))
    np.testing.assert_array_equal(found.means, splats.means)
    np.testing.assert_allclose(found.scales, splats.scales, rtol=1e-6)
    np.testing.assert_allclose(found.colors_diffuse, splats.colors_diffuse, atol=1e-6)


def test_every_kind_is_recognised_by_its_content(tmp_path):
    for kind in WRITERS:
        assert kind_of(written(tmp_path, tame_splats(20, 0), kind).rename(tmp_path / f"{kind}.bin")) == kind
    record = struct.pack("<6f", *[1.0] * 6) + bytes([200] * 4) + bytes([255, 128, 128, 128])
    assert kind_of(store(tmp_path, "a.splat", record)) == "splat"
    assert kind_of(store(tmp_path, "meta.json", b"{}")) == kind_of(tmp_path) == "sog"
    assert kind_of(store(tmp_path, "a.sog", b"PK\x03\x04")) == "sog"
    with pytest.raises(InputError, match="is not a splat file"):
        kind_of(store(tmp_path, "a.txt", b"hello"))
    with pytest.raises(InputError, match="does not exist"):
        kind_of(tmp_path / "nothing")


@pytest.mark.parametrize("kind", WRITERS)
def test_a_failed_write_leaves_nothing(tmp_path, kind):
    (tmp_path / "a").mkdir()
    with pytest.raises(OSError):
        write_splats(tmp_path / "a", tame_splats(20, 0), kind)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_an_unknown_kind_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot write splats as 'splat': expected one of ply spz compressed"):
        write_splats(tmp_path / "a.splat", make_splats(20, 0), "splat")


def test_the_spz_header_is_version_3_without_flags(tmp_path):
    data = gzip.decompress(written(tmp_path, tame_splats(20, 2), "spz").read_bytes())
    magic, version, count, degree, bits, flags, reserved = struct.unpack_from("<4sIIBBBB", data)
    assert (magic, version, count, degree, flags, reserved) == (b"NGSP", 3, 20, 2, 0, 0)
    assert 12 <= bits <= 24 and len(data) == 16 + 20 * (9 + 1 + 3 + 3 + 4 + 3 * 8)
