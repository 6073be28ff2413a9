"""Splat files: the INRIA PLY in every variant, and one clear line for each broken or foreign file."""

import gzip
import struct
from dataclasses import replace

import gsply
import numpy as np
import pytest
from ply_samples import inria_columns, ply_bytes
from splat_samples import assert_same, make_splats, store

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.cleaning import clean
from splat2mesh.splats.formats import read_splats, write_inria_ply
from splat2mesh.splats.formats.inria import SURFEL_THICKNESS

# A logit or log scale of magnitude up to 16 is stored with an error of 16 * 2^-24 = 1e-6, which exp turns
# into a relative one.
STORED = 1.5e-6


@pytest.mark.parametrize("degree", range(4))
def test_inria_round_trip(tmp_path, degree):
    splats, path = make_splats(9000, degree), tmp_path / "a.ply"  # more rows than one block
    opacities = splats.opacities.copy()
    opacities[:6] = 0, 1, 1e-6, 1 - 2**-24, 1 / 255, 0.5
    splats = replace(splats, opacities=opacities)
    write_inria_ply(path, splats)
    back = read_splats(path)
    for name in ("means", "sh", "quats_wxyz"):
        np.testing.assert_array_equal(getattr(back, name), getattr(splats, name), name)
    np.testing.assert_allclose(back.scales, splats.scales, rtol=STORED)
    # Beside the relative error, 1 + exp(-logit) and the clamp at 1 - 2^-24 each round once at 6e-8.
    np.testing.assert_allclose(back.opacities, splats.opacities, rtol=STORED, atol=1.2e-7)
    assert (b"f_rest_0" in path.read_bytes()) == (degree > 0)
    assert [p.name for p in tmp_path.iterdir()] == ["a.ply"]


def test_the_file_is_what_the_reference_writes(tmp_path):
    splats, path = make_splats(5, 3), tmp_path / "a.ply"
    write_inria_ply(path, splats)
    names = [p.split()[-1] for p in path.read_bytes().split(b"end_header")[0].decode().splitlines()[3:]]
    expected = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2".split() + [f"f_rest_{i}" for i in range(45)]
    assert names == expected + "opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()
    other = gsply.plyread(path)
    np.testing.assert_array_equal(other.means, splats.means)
    np.testing.assert_array_equal(other.shN.reshape(5, 15, 3), splats.sh[:, 1:])
    np.testing.assert_allclose(np.exp(other.scales), splats.scales, rtol=STORED)


def test_a_failed_write_leaves_nothing(tmp_path):
    target = tmp_path / "a.ply"
    target.mkdir()
    with pytest.raises(OSError):
        write_inria_ply(target, make_splats(20, 0))
    assert [p.name for p in tmp_path.iterdir()] == ["a.ply"]


def variants():
    splats = make_splats(40, 2)
    columns = inria_columns(splats)
    names = list(columns)
    extra = {"label": np.arange(40) - 7, "class": np.arange(40)}
    mixed = {"label": "int", "class": "uchar", "x": "double", "rot_2": "double"}
    shuffled = [*names, *extra]
    np.random.default_rng(1).shuffle(shuffled)
    yield "plain", ply_bytes(columns)
    yield "big endian", ply_bytes(columns, ">")
    yield "crlf header", ply_bytes(columns, newline="\r\n")
    yield "ascii", ply_bytes(columns, "ascii")
    yield "ascii crlf", ply_bytes(columns, "ascii", newline="\r\n")
    yield "normals", ply_bytes(dict.fromkeys(("nx", "ny", "nz"), np.zeros(40)) | columns)
    for order in ("<", ">", "ascii"):
        every = columns | extra
        yield f"shuffled {order}", ply_bytes({name: every[name] for name in shuffled}, order, mixed)
    yield (
        "list element after",
        ply_bytes(columns, after="element face 0\nproperty list uchar int vertex_indices"),
    )
    yield "other types", ply_bytes(columns, kinds=dict.fromkeys(names, "double"))
    body = ply_bytes(columns, before="element camera 2\nproperty float fx\nproperty uchar id")
    head, rows = body.split(b"\nend_header\n")
    yield "element before", head + b"\nend_header\n" + b"\0" * 10 + rows
    body = ply_bytes(columns, "ascii", before="element camera 2\nproperty list uchar int id")
    head, rows = body.split(b"\nend_header\n")
    yield "ascii element before", head + b"\nend_header\n1 2\n3 4 5 6\n" + rows


@pytest.mark.parametrize(("name", "data"), [pytest.param(*v, id=v[0]) for v in variants()])
def test_every_variant_of_a_ply_reads_the_same(tmp_path, name, data):
    expected = read_splats(store(tmp_path, "plain.ply", ply_bytes(inria_columns(make_splats(40, 2)))))
    assert_same(read_splats(store(tmp_path, "variant.ply", data)), expected)


def test_f_rest_is_channel_major(tmp_path):
    columns = inria_columns(make_splats(3, 2))
    columns |= {f"f_rest_{i}": np.full(3, i) for i in range(24)}
    sh = read_splats(store(tmp_path, "a.ply", ply_bytes(columns))).sh
    np.testing.assert_array_equal(sh[0, 1:], np.arange(24).reshape(3, 8).T)


def test_quaternions_of_any_length(tmp_path):
    splats = make_splats(20, 0)
    columns = inria_columns(splats)
    columns |= {f"rot_{i}": 3 * columns[f"rot_{i}"] for i in range(4)}
    found = read_splats(store(tmp_path, "a.ply", ply_bytes(columns)))
    np.testing.assert_allclose(found.quats_wxyz, splats.quats_wxyz, atol=2e-7)


def test_a_2dgs_file_gets_a_thin_third_axis(tmp_path):
    splats = make_splats(20, 1)
    columns = inria_columns(splats)
    del columns["scale_2"]
    found = read_splats(store(tmp_path, "a.ply", ply_bytes(columns)))
    np.testing.assert_allclose(found.scales[:, :2], splats.scales[:, :2], rtol=STORED)
    thin = SURFEL_THICKNESS * found.scales[:, :2].min(axis=1)
    np.testing.assert_allclose(found.scales[:, 2], thin, rtol=1e-6)
    assert clean(found)[0] is found


def test_opaque_logits_of_every_writer_stay(tmp_path):
    columns = inria_columns(make_splats(14, 0))
    columns["opacity"] = np.array([np.inf, 3.4e38, 13.8, 10, -np.inf, *[0.0] * 9])
    found = read_splats(store(tmp_path, "a.ply", ply_bytes(columns)))
    np.testing.assert_allclose(found.opacities[:6], [1, 1, 1 - 1.02e-6, 1 - 4.54e-5, 0, 0.5], atol=1e-7)
    assert len(clean(found)[0]) == 13


def test_values_beyond_float32_are_left_to_clean(tmp_path):
    columns = inria_columns(make_splats(20, 0))
    columns["x"] = np.where(np.arange(20) == 3, 1e300, columns["x"].astype(float))
    columns["scale_1"] = np.where(np.arange(20) == 5, 500.0, columns["scale_1"])
    found = read_splats(store(tmp_path, "a.ply", ply_bytes(columns, kinds={"x": "double"})))
    with pytest.warns(DataWarning, match="2 with a NaN or infinite value"):
        assert clean(found)[1]["non_finite"] == 2


@pytest.mark.parametrize("order", ["<", "ascii"])
def test_a_ply_cut_anywhere_is_refused(tmp_path, order):
    data = ply_bytes(inria_columns(make_splats(4, 0)), order)
    header = data.index(b"end_header\n", data.index(b"property")) + len("end_header\n")
    cuts = [*range(1, header, 7), header - 1, header, *range(header + 1, len(data) - 12, 11)]
    for cut in cuts:
        with pytest.raises(InputError) as caught:
            read_splats(store(tmp_path, "cut.ply", data[:cut]))
        assert "\n" not in str(caught.value)


def test_bytes_after_the_last_row_are_reported_and_ignored(tmp_path):
    data = ply_bytes(inria_columns(make_splats(4, 0)))
    expected = read_splats(store(tmp_path, "a.ply", data))
    with pytest.warns(DataWarning, match="ignored 5 bytes"):
        assert_same(read_splats(store(tmp_path, "b.ply", data + b"12345")), expected)


MESH = b"""ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""
POINTS = MESH.split(b"element face")[0] + b"end_header\n0 0 0\n1 0 0\n0 1 0\n"
GOOD = ply_bytes(inria_columns(make_splats(12, 1)))
GOOD_ASCII = ply_bytes(inria_columns(make_splats(12, 1)), "ascii")
HUGE = b"9" * 30


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.ply", b"", "is empty"),
        ("a.ply", b"just some text\nin a file\n", "is not a splat file"),
        ("a.ply", MESH, r"is a mesh \(1 faces\)"),
        ("a.ply", POINTS, "plain point cloud.*lack f_dc_0"),
        ("a.ply", GOOD.replace(b" opacity", b" opadity"), "lack opacity"),
        ("a.ply", GOOD.replace(b"element vertex 12", b"element vertex 0"), "holds no splats"),
        ("a.ply", GOOD.replace(b"element vertex 12", b"element vertex -2"), "line 4 .* 'element vertex -2'"),
        ("a.ply", GOOD.replace(b"element vertex 12", b"element vertex " + HUGE), "is cut short"),
        ("a.ply", GOOD.replace(b"float x", b"flaot x"), "makes no sense: 'property flaot x'"),
        ("a.ply", GOOD.replace(b"float y", b"float x"), "makes no sense: 'property float x'"),
        ("a.ply", GOOD.replace(b"float x", b"list uchar int x"), "list properties"),
        ("a.ply", GOOD.replace(b"format binary_little_endian 1.0\n", b""), "no format line"),
        ("a.ply", GOOD.replace(b" f_rest_8", b" f_rest_9"), "expected 0, 9, 24, 45 or 72"),
        ("a.ply", b"ply\n" + b"x" * (2 << 20), "no end_header"),
        ("a.ply", b"ply\n" + b"comment\n" * (1 << 18), "no end_header"),
        ("a.ply", ply_bytes({"x": np.zeros(3)}).replace(b"vertex 3", b"vertex " + HUGE), "lack"),
        ("a.ply", GOOD_ASCII.replace(b"vertex 12", b"vertex " + HUGE), "cut short"),
        ("a.ply", GOOD_ASCII.replace(b"-", b"z"), "does not fit its header"),
        ("a.bin", b"\x00\x01\x02\x03" * 20, "is not a splat file"),
        ("a.glb", b"glTF" + bytes(60), "glTF 0 is not supported"),
        ("a.splat", bytes(31), "is cut short: a .splat record takes 32 bytes, found 31"),
        ("a.splat", b"hello world, this is no splat..\n" * 9, "hold no place and no size"),
        ("a.spz", gzip.compress(GOOD, mtime=0), "holds no SPZ data"),
        ("a.spz", gzip.compress(b"NGSP", mtime=0), "is damaged"),
        ("a.spz", gzip.compress(struct.pack("<4sIIBBBB", b"NGSP", 9, 5, 0, 12, 0, 0), mtime=0), "SPZ version 9"),
        ("a.spz", gzip.compress(struct.pack("<4sIIBBBB", b"NGSP", 3, 5, 7, 12, 0, 0), mtime=0), "SH degree 0 to 4"),
        ("a.spz", gzip.compress(struct.pack("<4sIIBBBB", b"NGSP", 3, 0, 0, 12, 0, 0), mtime=0), "holds no splats"),
        ("a.spz", gzip.compress(struct.pack("<4sIIBBBB", b"NGSP", 3, 1 << 31, 0, 12, 0, 0), mtime=0), "is damaged"),
        ("a.sog", b"PK\x03\x04 and then nonsense", "damaged zip"),
        ("meta.json", b"{ not json", "does not describe a SOG"),
        ("meta.json", b'{"name": 1}', "does not describe a SOG.*means"),
        ("meta.json", b'{"version": 7}', "SOG version 7"),
    ],
)  # fmt: skip
def test_a_broken_file_gets_one_clear_line(tmp_path, name, data, message):
    with pytest.raises(InputError, match=message) as caught:
        read_splats(store(tmp_path, name, data))
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_a_missing_file_and_a_folder_of_something_else(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.ply does not exist"):
        read_splats(tmp_path / "nothing.ply")
    with pytest.raises(InputError, match=r"folder without meta\.json"):
        read_splats(tmp_path)
