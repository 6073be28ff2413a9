"""PLY meshes: the same mesh in every format, type and order of properties, and lists that lie."""

import struct

import numpy as np
import pytest

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.plymesh import read_ply

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5], [-1, 0.25, 2]])
POLYGONS = [[0, 1, 2, 3], [0, 3, 4], [4, 3, 2, 1, 0]]
TRIANGLES = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [4, 3, 2], [4, 2, 1], [4, 1, 0]]
CODES = {"uchar": "B", "char": "b", "ushort": "H", "short": "h", "uint": "I", "int": "i", "float": "f", "double": "d"}


def ply(order, point="float", length="uchar", item="int", name="vertex_indices"):
    """The file, with a flag before and a weight after the list of each face."""
    kind = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}[order]
    lines = ["ply", f"format {kind} 1.0", "comment made here", f"element vertex {len(POINTS)}"]
    lines += [f"property {point} {axis}" for axis in "zxy"]
    lines += [f"element face {len(POLYGONS)}", "property uchar flag", f"property list {length} {item} {name}"]
    head = "\n".join([*lines, "property float weight", "end_header\n"]).encode()
    turned = POINTS[:, [2, 0, 1]].tolist()
    if not order:
        rows = [" ".join(map(str, row)) for row in turned]
        rows += [" ".join(map(str, [1, len(row), *row, 0.5])) for row in POLYGONS]
        return head + "\n".join(rows).encode() + b"\n"
    body = b"".join(struct.pack(f"{order}3{CODES[point]}", *row) for row in turned)
    for row in POLYGONS:
        code = f"{order}B{CODES[length]}{len(row)}{CODES[item]}f"
        body += struct.pack(code, 1, len(row), *row, 0.5)
    return head + body


def stored(tmp_path, content):
    (tmp_path / "a.ply").write_bytes(content)
    return tmp_path / "a.ply"


@pytest.mark.parametrize("order", ["<", ">", ""])
@pytest.mark.parametrize("point", ["float", "double"])
@pytest.mark.parametrize(
    ("length", "item"), [("uchar", "int"), ("int", "uint"), ("ushort", "short"), ("char", "uchar")]
)
def test_every_format_and_type_gives_the_same_mesh(tmp_path, order, point, length, item):
    found = read_ply(stored(tmp_path, ply(order, point, length, item)))
    np.testing.assert_array_equal(found.points, POINTS)
    assert found.faces.tolist() == TRIANGLES and found.normals is None and found.colors is None


def test_the_other_name_of_the_list_and_corners_in_floats(tmp_path):
    found = read_ply(stored(tmp_path, ply(">", item="float", name="vertex_index")))
    assert found.faces.tolist() == TRIANGLES


@pytest.mark.parametrize("order", ["<", ">", ""])
def test_a_file_without_its_end_is_refused_wherever_it_is_cut(tmp_path, order):
    whole = ply(order)
    start = whole.index(b"end_header\n") + 11
    # An ascii number may lose its last digits and still be one: the weight, 0.5, which is not read.
    for end in range(start, len(whole) - (4 if order == "" else 0)):
        with pytest.raises(InputError, match=r"cut short|promises"):
            read_ply(stored(tmp_path, whole[:end]))


def test_a_list_of_fewer_than_no_corners_is_refused(tmp_path):
    whole = bytearray(ply("<", length="char"))
    at = whole.index(b"end_header\n") + 11 + POINTS.size * 4 + 1
    assert whole[at] == 4
    whole[at] = 0xFC  # -4
    with pytest.raises(InputError, match="promises 3 rows of 'face', 0 can be read"):
        read_ply(stored(tmp_path, bytes(whole)))


def test_a_corner_that_is_no_whole_number_is_refused(tmp_path):
    content = ply("").replace(b"1 3 0 3 4", b"1 3 0 3.5 4")
    with pytest.raises(InputError, match=r"a face names a vertex by 3\.5"):
        read_ply(stored(tmp_path, content))


@pytest.mark.parametrize("colored", [False, True])
def test_a_texture_that_is_not_read_is_said_unless_vertices_have_colours(tmp_path, colored):
    head = "ply\nformat ascii 1.0\ncomment TextureFile a b.png\nelement vertex 3\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue") if colored)
    head += "element face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
    rows = [f"{x} {y} 0" + " 9 99 199" * colored for x, y in ((0, 0), (1, 0), (0, 1))]
    path = stored(tmp_path, (head + "\n".join([*rows, "3 0 1 2 6 0 0 1 0 0 1"]) + "\n").encode())
    if colored:
        assert np.round(255 * read_ply(path).colors).tolist() == 3 * [[9, 99, 199]]
    else:
        with pytest.warns(DataWarning, match=r"its texture a b\.png is not read"):
            assert read_ply(path).colors is None
