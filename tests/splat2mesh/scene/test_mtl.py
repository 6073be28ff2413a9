"""Materials of OBJ files as colours of vertices: factors, pictures where their coordinates lie, what cannot be read."""

import imageio.v3 as iio
import numpy as np
import pytest

from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.color import linear_from_srgb, srgb_from_linear
from splat2mesh.scene.meshfile import read_mesh

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
TEXELS = "vt .25 .25\nvt .75 .25\nvt .75 .75\nvt .25 .75\n"
CORNERS = np.uint8([[[10, 20, 30], [250, 130, 0]], [[255, 0, 0], [0, 90, 200]]])
"""Upper row first: v = .75 there."""


@pytest.fixture
def colors(tmp_path):
    """Colours (V, 3) uint8 of an OBJ with a library, in the order of the file's vertices where faces use them so."""

    def colors(library, faces, head="mtllib a.mtl\n" + SQUARE + TEXELS):
        iio.imwrite(tmp_path / "a.png", CORNERS)
        if library is not None:
            (tmp_path / "a.mtl").write_text(library)
        (tmp_path / "a.obj").write_text(head + faces + "\n")
        mesh = read_mesh(tmp_path / "a.obj")
        return mesh.colors_srgb.tolist(), mesh

    return colors


def test_a_factor_is_the_srgb_colour_of_its_faces(colors):
    found, _ = colors("newmtl red\nKd 1 0 .2\nnewmtl b\nKd .5\n", "usemtl red\nf 1 2 3\nusemtl b\nf 1 3 4")
    assert found == 3 * [[255, 0, 51]] + 3 * [[128, 128, 128]]


@pytest.mark.parametrize("quads", [False, True])
def test_a_vertex_on_the_border_of_two_colours_is_two(quads, colors):
    faces = "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4" if not quads else "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4 2"
    found, mesh = colors("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\n", faces)
    of_faces = mesh.colors_srgb[mesh.faces]
    assert (of_faces == of_faces[:, :1]).all()
    assert of_faces[0, 0].tolist() == [255, 0, 0] and of_faces[-1, 0].tolist() == [0, 0, 255]
    assert len(found) == (7 if quads else 6)
    same, mesh = colors("newmtl a\nKd 1 0 0\nnewmtl b\nKd 1 0 0\n", faces)
    assert len(same) == 4 and {tuple(each) for each in same} == {(255, 0, 0)}


def test_a_picture_is_seen_where_its_coordinates_lie_with_v_upwards(colors):
    found, _ = colors("newmtl a\nmap_Kd a.png\n", "usemtl a\nf 1/1 2/2 3/3 4/4")
    assert found == [CORNERS[1, 0].tolist(), CORNERS[1, 1].tolist(), CORNERS[0, 1].tolist(), CORNERS[0, 0].tolist()]


def test_a_picture_times_its_factor_is_a_product_of_light(colors):
    found, _ = colors("newmtl a\nKd .5 .5 .5\nmap_Kd a.png\n", "usemtl a\nf 1/1 2/2 3/3 4/4")
    expected = srgb_from_linear(linear_from_srgb(CORNERS[1, 1] / 255.0) * linear_from_srgb(0.5))
    assert found[1] == np.round(255 * expected).tolist()


def test_a_black_factor_does_not_put_out_a_picture(colors):
    plain, _ = colors("newmtl a\nmap_Kd a.png\n", "usemtl a\nf 1/1 2/2 3/3")
    assert colors("newmtl a\nKd 0 0 0\nmap_Kd a.png\n", "usemtl a\nf 1/1 2/2 3/3")[0] == plain
    assert colors("newmtl a\nKd 0 0 0\n", "usemtl a\nf 1/1 2/2 3/3")[0] == 3 * [[0, 0, 0]]


@pytest.mark.parametrize("options", ["-clamp on -bm 1", "-s 1 1 1 -o 0 0", "-t .1 .1", "-mm 0 1 -o 1 2 3"])
def test_options_of_a_picture_are_no_part_of_its_name(options, colors):
    plain, _ = colors("newmtl a\nmap_Kd a.png\n", "usemtl a\nf 1/1 2/2 3/3")
    assert colors(f"newmtl a\nmap_Kd {options} a.png\n", "usemtl a\nf 1/1 2/2 3/3")[0] == plain


def test_a_picture_is_scaled_and_moved(colors):
    """Twice as often and half a picture on: .25 -> 1, .75 -> 2, all in the lower left texel."""
    found, _ = colors("newmtl a\nmap_Kd -s 2 2 -o .51 .51 a.png\n", "usemtl a\nf 1/1 2/2 3/3")
    assert found == 3 * [CORNERS[1, 0].tolist()]


def test_vertices_without_coordinates_and_without_material_keep_to_what_is_there(colors):
    found, _ = colors("newmtl a\nKd 0 1 0\nmap_Kd a.png\n", "usemtl a\nf 1 3 4")
    assert found == 3 * [[0, 255, 0]]
    assert colors("newmtl a\n", "usemtl a\nf 1/1 2/2 3/3")[0] == 3 * [[255, 255, 255]]
    assert colors("newmtl a\nKd 1 0 0\n", "f 1 2 3")[0] == 3 * [[255, 255, 255]]


def test_colours_of_vertices_go_before_those_of_materials(colors):
    head = "mtllib a.mtl\nv 0 0 0 .2 .4 .6\nv 1 0 0 .2 .4 .6\nv 1 1 0 .2 .4 .6\n"
    assert colors("newmtl a\nKd 1 0 0\n", "usemtl a\nf 1 2 3", head)[0] == 3 * [[51, 102, 153]]
    assert colors(None, "usemtl a\nf 1 2 3", head.replace("a.mtl", "none.mtl"))[0] == 3 * [[51, 102, 153]]


@pytest.mark.parametrize(
    "library,said,found",
    [
        (None, r"a\.mtl \(no such file", [255, 255, 255]),
        ("newmtl a\nKd 1 0 0\nmap_Kd none.png\n", r"none\.png \(no such file", [255, 0, 0]),
        ("newmtl a\nKd 1 0 0\nmap_Kd ../a.png\n", r"\.\./a\.png \(", [255, 0, 0]),
        ("newmtl a\nKd 1 0 0\nmap_Kd a.mtl\n", r"a\.mtl \(another kind of picture\)", [255, 0, 0]),
        ("newmtl a\nKd 1 0 0\nmap_Kd cut.png\n", r"cut\.png \(", [255, 0, 0]),
        ("newmtl a\nKd spectral a.rfl\n", r"a in a\.mtl \(Kd spectral a\.rfl\)", [255, 255, 255]),
        ("newmtl a\nKd 1 0 nan\n", r"a in a\.mtl \(Kd 1 0 nan\)", [255, 255, 255]),
        ("newmtl b\nKd 1 0 0\n", r"a \(in no library\)", [255, 255, 255]),
        ("newmtl a\nKd 1 0 0\nmap_Kd\n", r"a in a\.mtl \(map_Kd\)", [255, 0, 0]),
    ],
)
def test_what_cannot_be_read_is_said_once(library, said, found, colors, tmp_path):
    iio.imwrite(tmp_path / "whole.png", np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8))
    (tmp_path / "cut.png").write_bytes((tmp_path / "whole.png").read_bytes()[:3000])
    with pytest.warns(DataWarning, match=rf"a\.obj: colours of 1 materials.*{said}") as warned:
        assert colors(library, "usemtl a\nf 1/1 2/2 3/3")[0] == 3 * [found]
    assert len(warned) == 1
