"""What trainers put into a PLY beside INRIA's layout: filters, colours, a fourth degree, doubles, odd NaN."""

from dataclasses import replace

import numpy as np
import pytest
from ply_samples import inria_columns, ply_bytes
from splat_samples import assert_same, make_splats, store

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.cleaning import clean
from splat2mesh.splats.facts import FileFacts
from splat2mesh.splats.formats import read_splats, write_splats

UTM = np.array([512345.0, 5412345.0, 431.0])


def test_the_filter_of_mip_splatting_is_folded_in(tmp_path):
    """scale^2 + f^2, and the opacity by the root of the ratio of the determinants."""
    splats = make_splats(50, 1)
    width = np.exp(np.random.default_rng(0).normal(-3, 1, 50)).astype(np.float32)
    width[:5] = 0
    found = read_splats(store(tmp_path, "a.ply", ply_bytes(inria_columns(splats) | {"filter_3D": width})))
    wide = splats.scales.astype(np.float64) ** 2 + width[:, None].astype(np.float64) ** 2
    np.testing.assert_allclose(found.scales, np.sqrt(wide), rtol=1e-5)
    share = np.sqrt(np.prod(splats.scales.astype(np.float64) ** 2, axis=1) / np.prod(wide, axis=1))
    np.testing.assert_allclose(found.opacities, splats.opacities * share, rtol=1e-5)
    np.testing.assert_array_equal(found.means, splats.means)


def test_a_filter_on_flat_and_invisible_splats_stays_within_range(tmp_path):
    columns = inria_columns(make_splats(20, 0))
    columns["scale_0"] = np.full(20, -np.inf)
    columns["filter_3D"] = np.linspace(0, 1, 20)
    found = read_splats(store(tmp_path, "a.ply", ply_bytes(columns)))
    assert np.isfinite(found.scales).all() and not found.opacities.any()


@pytest.mark.parametrize("names", [("red", "green", "blue"), ("r", "g", "b")])
@pytest.mark.parametrize("kind", ["uchar", "float", "double"])
def test_colours_in_place_of_coefficients(tmp_path, names, kind):
    splats, bytes_ = make_splats(30, 0), np.random.default_rng(0).integers(0, 256, (30, 3))
    columns = {name: values for name, values in inria_columns(splats).items() if not name.startswith("f_dc")}
    values = bytes_ if kind == "uchar" else bytes_ / 255
    columns |= dict(zip(names, values.T, strict=True))
    found = read_splats(store(tmp_path, "a.ply", ply_bytes(columns, kinds=dict.fromkeys(names, kind))))
    np.testing.assert_allclose(found.colors_diffuse, bytes_ / 255, atol=1e-6)
    np.testing.assert_array_equal(found.means, splats.means)


def test_coefficients_count_where_a_file_has_both(tmp_path):
    splats = make_splats(30, 1)
    columns = inria_columns(splats) | dict.fromkeys(("red", "green", "blue"), np.full(30, 9))
    data = ply_bytes(columns, kinds=dict.fromkeys(("red", "green", "blue"), "uchar"))
    np.testing.assert_array_equal(read_splats(store(tmp_path, "a.ply", data)).sh, splats.sh)


def test_a_point_cloud_with_colours_is_none(tmp_path):
    columns = dict.fromkeys(("x", "y", "z", "red", "green", "blue"), np.zeros(9))
    with pytest.raises(InputError, match=r"plain point cloud.*lack opacity, scale_0"):
        read_splats(store(tmp_path, "a.ply", ply_bytes(columns)))


@pytest.mark.parametrize("order", ["<", "ascii"])
def test_the_fourth_degree_is_dropped_with_a_count(tmp_path, order):
    splats = make_splats(30, 3)
    rest = np.random.default_rng(0).normal(size=(30, 3, 24)).astype(np.float32)
    rest[:, :, :15] = splats.sh[:, 1:].swapaxes(1, 2)
    columns = {name: values for name, values in inria_columns(splats).items() if not name.startswith("f_rest")}
    columns |= {f"f_rest_{i}": values for i, values in enumerate(rest.reshape(30, 72).T)}
    with pytest.warns(DataWarning, match="dropped the harmonics above degree 3 of 30 splats, whose degree is 4"):
        found = read_splats(store(tmp_path, "a.ply", ply_bytes(columns, order)))
    np.testing.assert_allclose(found.sh, splats.sh, rtol=1e-6)


def test_numbers_that_are_not_finite(tmp_path):
    """Each row with one is counted and dropped; the others are as in the plain file."""
    splats = make_splats(40, 1)
    text = ply_bytes(inria_columns(splats), "ascii").decode()
    head, rows = text.split("end_header\n")[0] + "end_header\n", text.split("end_header\n")[-1].splitlines()
    head = text[: text.rindex("end_header\n") + len("end_header\n")]
    odd = "nan -nan NaN inf -inf Infinity".split()
    for number, word in enumerate(odd):
        values = rows[number].split()
        values[number % len(values)] = word
        rows[number] = " ".join(values)
    found = read_splats(store(tmp_path, "a.ply", (head + "\n".join(rows) + "\n").encode()))
    plain = read_splats(store(tmp_path, "b.ply", text.encode()))
    with pytest.warns(DataWarning, match=f"dropped splats: {len(odd)} with a NaN or infinite value"):
        assert_same(clean(found)[0], plain.take(slice(len(odd), None)))


@pytest.mark.parametrize("word", ["-nan(ind)", "1.#QNAN", "one"])
def test_words_that_are_no_numbers_stay_an_error(tmp_path, word):
    text = ply_bytes(inria_columns(make_splats(12, 0)), "ascii").decode()
    start = text.rindex("end_header\n") + len("end_header\n")
    with pytest.raises(InputError, match="does not fit its header"):
        read_splats(store(tmp_path, "a.ply", (text[:start] + word + text[start:].lstrip("-0123456789.")).encode()))


def utm_bytes(splats, kind="double"):
    columns = inria_columns(splats)
    for axis, name in enumerate("xyz"):
        columns[name] = splats.means[:, axis].astype(np.float64) + UTM[axis]
    return ply_bytes(columns, kinds=dict.fromkeys("xyz", kind))


def test_coordinates_in_double_keep_their_detail(tmp_path):
    splats = make_splats(500, 1)
    found = read_splats(store(tmp_path, "a.ply", utm_bytes(splats)))
    whole = splats.means.astype(np.float64) + UTM
    assert np.array_equal(found.facts.offset, np.rint(found.facts.offset)) and np.any(found.facts.offset)
    np.testing.assert_allclose(found.means + np.array(found.facts.offset), whole, rtol=0, atol=2e-6)
    write_splats(tmp_path / "b.ply", found)
    again = read_splats(tmp_path / "b.ply")
    assert_same(replace(again, scales=found.scales, opacities=found.opacities), found)  # which pass a logarithm
    assert b"property double x" in (tmp_path / "b.ply").read_bytes()


def test_coordinates_near_the_origin_get_no_offset(tmp_path):
    splats = make_splats(100, 0)
    kinds = dict.fromkeys("xyz", "double")
    found = read_splats(store(tmp_path, "a.ply", ply_bytes(inria_columns(splats), kinds=kinds)))
    assert found.facts == FileFacts()
    np.testing.assert_array_equal(found.means, splats.means)


def test_doubles_without_a_number_are_read(tmp_path):
    columns = inria_columns(make_splats(20, 0)) | {"x": np.full(20, np.nan)}
    found = read_splats(store(tmp_path, "a.ply", ply_bytes(columns, kinds=dict.fromkeys("xyz", "double"))))
    assert not np.any(found.facts.offset) and np.isnan(found.means[:, 0]).all()


@pytest.mark.parametrize("kind", ["ply", "compressed.ply"])
def test_tags_of_the_header_come_back(tmp_path, kind):
    facts = FileFacts(True, (0.0, 0.0, 1.0), "'Vertical axis: 0 0 1'")
    splats = replace(make_splats(300, 0), facts=facts)
    write_splats(tmp_path / f"a.{kind}", splats, kind)
    assert b"comment SplatRenderMode: mip\n" in (tmp_path / f"a.{kind}").read_bytes()
    assert read_splats(tmp_path / f"a.{kind}").facts == facts
