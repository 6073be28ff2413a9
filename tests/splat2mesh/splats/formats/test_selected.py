"""Rows of a PLY that are kept, byte for byte."""

import numpy as np
import pytest
from splat_samples import make_splats

from splat2mesh.base.errors import InputError
from splat2mesh.splats.formats.inria import write_inria_ply
from splat2mesh.splats.formats.ply import Ply
from splat2mesh.splats.formats.selected import write_selected

LAYOUT = [("x", "f4"), ("y", "f4"), ("z", "f8"), ("label", "u1")]
KINDS = {"f4": "float", "f8": "double", "u1": "uchar"}
KEEP = np.array([True, False, False, True, True])


def header(form, extra_before=0, extra_after=0):
    lines = ["ply", f"format {form} 1.0", "comment element vertex 5 of them"]
    lines += [f"element camera {extra_before}", "property int number"] if extra_before else []
    lines += ["element vertex 5"] + [f"property {KINDS[code]} {name}" for name, code in LAYOUT]
    lines += [f"element tail {extra_after}", "property list uchar int numbers"] if extra_after else []
    return ("\n".join(lines) + "\nend_header\n").encode()


def rows(order):
    rng = np.random.default_rng(2)
    found = np.zeros(5, [(name, order + code) for name, code in LAYOUT])
    for name, code in LAYOUT:
        found[name] = rng.integers(0, 200, 5) + (0.125 if code != "u1" else 0)
    return found


def with_fewer(text):
    first, mark, rest = text.rpartition(b"element vertex 5")
    return first + mark.replace(b"5", b"3") + rest


@pytest.mark.parametrize("form", ["binary_little_endian", "binary_big_endian"])
def test_binary_rows_stay_to_the_bit_with_all_around_them(tmp_path, form):
    order = "<" if "little" in form else ">"
    body, before, after = rows(order), np.arange(2, dtype=order + "i4").tobytes(), b"\x02" + bytes(8)
    (tmp_path / "a.ply").write_bytes(header(form, 2, 1) + before + body.tobytes() + after)
    write_selected(tmp_path / "b.ply", tmp_path / "a.ply", KEEP)
    wanted = with_fewer(header(form, 2, 1)) + before + body[KEEP].tobytes() + after
    assert (tmp_path / "b.ply").read_bytes() == wanted


def test_lines_of_text_stay_with_all_around_them(tmp_path):
    lines = [b"1 2 %d.50 4\n" % number for number in range(5)]
    around = header("ascii", 1, 1), b"7\n", b"2 1 1\n"
    (tmp_path / "a.ply").write_bytes(around[0] + around[1] + b"\n" + b"".join(lines) + around[2])
    write_selected(tmp_path / "b.ply", tmp_path / "a.ply", KEEP)
    kept = b"".join(line for line, keep in zip(lines, KEEP, strict=True) if keep)
    assert (tmp_path / "b.ply").read_bytes() == with_fewer(around[0]) + around[1] + b"\n" + kept + around[2]


def test_all_rows_are_the_file_and_none_are_its_header(tmp_path):
    write_inria_ply(tmp_path / "a.ply", make_splats(20_000, 1))
    whole = (tmp_path / "a.ply").read_bytes()
    write_selected(tmp_path / "b.ply", tmp_path / "a.ply", np.ones(20_000, bool))
    assert (tmp_path / "b.ply").read_bytes() == whole
    write_selected(tmp_path / "c.ply", tmp_path / "a.ply", np.zeros(20_000, bool))
    assert Ply.open(tmp_path / "c.ply").elements["vertex"].count == 0
    assert len((tmp_path / "c.ply").read_bytes()) == whole.index(b"end_header\n") + 11 - 4  # "20000" became "0"


def test_a_file_of_another_number_of_rows_is_refused(tmp_path):
    write_inria_ply(tmp_path / "a.ply", make_splats(10, 0))
    with pytest.raises(InputError, match="holds 10 splats, expected 9"):
        write_selected(tmp_path / "b.ply", tmp_path / "a.ply", np.ones(9, bool))
    assert not (tmp_path / "b.ply").exists()
