"""OBJ by hand: weights, colours, counting from the end, lines that go on, materials."""

import pytest

from splat2mesh.base.errors import InputError
from splat2mesh.scene.objmesh import read_obj

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def stored(tmp_path, text, name="a.obj"):
    (tmp_path / name).write_text(text)
    return tmp_path / name


def test_a_weight_divides_and_a_colour_goes_along(tmp_path):
    found = read_obj(stored(tmp_path, "v 2 4 6 2\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"))
    assert found.points.tolist() == [[1, 2, 3], [1, 0, 0], [0, 1, 0]] and found.colors is None
    found = read_obj(stored(tmp_path, "v 0 0 0 1 0.5 0\nv 1 0 0\nv 0 1 0 0 0 1\nf 1 2 3\n"))
    assert found.colors.tolist() == [[1, 0.5, 0], [1, 1, 1], [0, 0, 1]]
    found = read_obj(stored(tmp_path, "v 0 0 0 255 51 0\nv 1 0 0 0 0 0\nv 0 1 0 0 0 255\nf 1 2 3\n"))
    assert found.colors.tolist() == [[1, 0.2, 0], [0, 0, 0], [0, 0, 1]]


def test_numbers_below_zero_count_from_the_end_of_what_was_read_so_far(tmp_path):
    found = read_obj(stored(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 9\nf -4 -3 -1\n"))
    assert found.points[found.faces].tolist() == [
        [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
        [[0, 0, 0], [1, 0, 0], [0, 0, 9]],
    ]


def test_a_line_goes_on_after_a_backslash(tmp_path):
    found = read_obj(stored(tmp_path, SQUARE + "f 1 2 \\\n 3 4\n"))
    assert found.faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_a_vertex_with_two_normals_is_two(tmp_path):
    normals = "vn 0 0 1\nvn 0 1 0\n"
    found = read_obj(stored(tmp_path, SQUARE + normals + "f 1//1 2//1 3//1\nf 1//2 3//1 4//1\n"))
    assert found.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 0], [0, 1, 0]]
    assert found.normals.tolist() == [[0, 0, 1]] * 3 + [[0, 1, 0], [0, 0, 1]]
    assert found.faces.tolist() == [[0, 1, 2], [3, 2, 4]]


@pytest.mark.parametrize("line", ["v 1 2", "v 1 2 3 4 5", "f 1 2 0", "f 1 2 x", "f 1/2/3/4 2 3", "f 1 2 -5", "v a b c"])
def test_lines_that_make_no_sense_are_refused(tmp_path, line):
    with pytest.raises(InputError, match=r"a\.obj: (line 5 makes no sense|a 'v' line holds)"):
        read_obj(stored(tmp_path, SQUARE + line + "\nf 1 2 3\n"))


@pytest.mark.parametrize("face", ["f 1 2 5", "f 1/1 2/1 3/1", "f 1//1 2//1 3//2"])
def test_corners_that_name_nothing_are_refused(tmp_path, face):
    text = SQUARE + ("vn 0 0 1\n" if "//" in face else "") + face
    if face == "f 1/1 2/1 3/1":
        text = text.replace("/1", "/2")
    with pytest.raises(InputError, match="names a vertex beyond the 4"):
        read_obj(stored(tmp_path, text))
