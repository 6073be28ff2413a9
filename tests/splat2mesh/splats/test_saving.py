"""`Splats.load` and `Splats.save`: what was written is read, and nothing is replaced that nobody gave up."""

from dataclasses import replace

import numpy as np
import pytest
from splat_samples import assert_same, make_splats

from splat2mesh import InputError, Splats
from splat2mesh.splats.formats import kind_of, kind_of_name, read_splats, write_splats


def test_a_ply_comes_back(tmp_path):
    splats = make_splats(30, 2)
    splats.save(tmp_path / "a.ply")
    found = Splats.load(str(tmp_path / "a.ply"))
    assert_same(found, read_splats(tmp_path / "a.ply"))
    for name in ("means", "quats_wxyz", "sh"):
        np.testing.assert_array_equal(getattr(found, name), getattr(splats, name), name)
    # They are stored as logarithms and logits in float32, and taken back.
    np.testing.assert_allclose(found.scales, splats.scales, rtol=1e-6)
    np.testing.assert_allclose(found.opacities, splats.opacities, rtol=1e-6)


NAMES = {
    "a.ply": "ply",
    "a.spz": "spz",
    "a.compressed.ply": "compressed.ply",
    "A.PLY": "ply",
    "a.ply.SPZ": "spz",
    "a.sog": "sog",
}


@pytest.mark.parametrize(("name", "kind"), NAMES.items())
def test_the_name_chooses_the_kind_and_the_bytes_are_those_of_write_splats(tmp_path, name, kind):
    splats = replace(make_splats(40, 0), sh=0.1 * make_splats(40, 0).sh)  # what every kind can hold
    splats.save(tmp_path / name)
    write_splats(tmp_path / "other", splats, kind)
    assert (tmp_path / name).read_bytes() == (tmp_path / "other").read_bytes()
    assert kind_of(tmp_path / name) == kind_of_name(name) == kind


def test_a_file_that_exists_is_replaced_only_by_overwrite(tmp_path):
    first, second = make_splats(20, 0), make_splats(21, 0)
    first.save(tmp_path / "a.ply")
    before = (tmp_path / "a.ply").read_bytes()
    with pytest.raises(InputError, match=r"a\.ply exists already"):
        second.save(tmp_path / "a.ply")
    assert (tmp_path / "a.ply").read_bytes() == before
    second.save(tmp_path / "a.ply", overwrite=True)
    assert len(Splats.load(tmp_path / "a.ply")) == 21
    assert [path.name for path in tmp_path.iterdir()] == ["a.ply"]


@pytest.mark.parametrize("name", ["a.splat", "a.sog.zip", "a", "ply"])
def test_a_name_of_no_kind_is_refused_before_anything_is_written(tmp_path, name):
    with pytest.raises(InputError, match=r"expected a name that ends in \.ply \.spz \.compressed\.ply \.sog"):
        make_splats(20, 0).save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_never_replaced(tmp_path):
    (tmp_path / "a.ply").mkdir()
    (tmp_path / "a.ply" / "kept").touch()
    with pytest.raises(InputError, match="is a folder"):
        make_splats(20, 0).save(tmp_path / "a.ply", overwrite=True)
    assert (tmp_path / "a.ply" / "kept").exists()


def test_loading_refuses_what_is_no_splat(tmp_path):
    (tmp_path / "a.ply").write_bytes(b"ply\n")
    with pytest.raises(InputError, match="cut short or damaged"):
        Splats.load(tmp_path / "a.ply")
    with pytest.raises(InputError, match="`lod` 3"):
        Splats.load(tmp_path / "a.ply", lod=3)
