"""Streamed SOG: levels and tiles put together, the environment marked, every contradiction refused in one line."""

import json
import shutil
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from sog_samples import palette_splats, sog_parts, store_folder
from splat_samples import assert_same

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.formats import kind_of, parts_of, read_splats, streamed
from splat2mesh.splats.joining import joined

COUNTS = {"0_0": 120, "0_1": 100, "1_0": 90, "2_0": 40}
"""Splats of each tile: three levels of 220, 90 and 40."""

BOUND = {"min": [0, 0, 0], "max": [1, 1, 1]}


def tile_splats(name):
    return palette_splats(COUNTS[name], {"0_0": 1, "0_1": 0}.get(name, 1))


def write_capture(folder, environment=True, version=1):
    """A streamed SOG as splat-transform writes it: its lod-meta.json, and the dict in it."""
    for name in COUNTS:
        (folder / name).mkdir(parents=True)
        store_folder(folder / name, sog_parts(tile_splats(name), 2))
    # Two leaves, each with two ranges of the tile of its level; level 2 is empty in the second.
    leaves = [
        {"0": {"file": 0, "offset": 0, "count": 120}, "1": {"file": 2, "offset": 0, "count": 50}},
        {"0": {"file": 3, "offset": 0, "count": 100}, "1": {"file": 2, "offset": 50, "count": 40}},
    ]
    leaves[0]["2"] = {"file": 1, "offset": 0, "count": 40}
    meta = {
        "lodLevels": 3,
        "filenames": ["0_0/meta.json", "2_0/meta.json", "1_0/meta.json", "0_1/meta.json"],
        "tree": {"bound": BOUND, "children": [{"bound": BOUND, "lods": lods} for lods in leaves]},
    }
    if version:
        meta |= {"version": version, "asset": {"generator": "test"}, "count": 350, "counts": [220, 90, 40]}
    if environment:
        (folder / "env").mkdir()
        store_folder(folder / "env", sog_parts(palette_splats(30, 0), 2))
        meta["environment"] = "env/meta.json"
    path = folder / "lod-meta.json"
    path.write_text(json.dumps(meta))
    return path, meta


@pytest.fixture
def capture(tmp_path):
    return write_capture(tmp_path / "capture")[0]


def tiles_of(path, *names):
    return joined([read_splats(path.parent / name) for name in names])


@pytest.mark.parametrize(("lod", "names"), [(0, ("0_0", "0_1")), (1, ("1_0",)), (2, ("2_0",)), ("1", ("1_0",))])
def test_a_level_is_its_tiles_in_order_and_then_the_environment(capture, lod, names):
    whole = read_splats(capture, lod)
    assert_same(replace(whole, environment=None), tiles_of(capture, *names, "env"))
    np.testing.assert_array_equal(np.flatnonzero(whole.environment), len(whole) - 30 + np.arange(30))
    assert whole.degree == 1


def test_the_folder_is_its_lod_meta_json_whatever_that_is_called(capture):
    expected = read_splats(capture)
    assert_same(read_splats(capture.parent), expected)
    capture.rename(capture.with_name("plaza.json"))
    assert_same(read_splats(capture.with_name("plaza.json")), expected)
    assert kind_of(capture.with_name("plaza.json")) == "tiles"


def test_its_kind_is_known_though_only_a_coarse_level_was_copied(capture):
    for name in ("0_0", "0_1", "1_0"):
        shutil.rmtree(capture.parent / name)
    assert kind_of(capture) == kind_of(capture.parent) == "tiles"
    assert parts_of(capture, 2).level == 2


def test_files_without_version_counts_and_environment_are_read(tmp_path):
    path, _ = write_capture(tmp_path, environment=False, version=None)
    whole = read_splats(path, 0)
    assert_same(whole, tiles_of(path, "0_0", "0_1"))
    assert whole.environment is None


def test_auto_takes_the_finest_level_within_the_budget_and_says_what_it_passed_over(capture, monkeypatch):
    assert len(read_splats(capture)) == 220 + 30
    monkeypatch.setattr(streamed, "SPLAT_BUDGET", 219)
    with pytest.warns(DataWarning, match=r"took level 1 with 90 splats; level 0 holds 220, over the 219 .* `lod` 0"):
        assert len(read_splats(capture)) == 90 + 30
    monkeypatch.setattr(streamed, "SPLAT_BUDGET", 7)
    with pytest.warns(DataWarning, match="took level 2"):
        assert parts_of(capture).level == 2 and len(read_splats(capture)) == 40 + 30
    assert len(read_splats(capture, 0)) == 220 + 30


def test_tiles_and_environment_may_be_bundles(capture):
    expected = read_splats(capture, 1)
    meta = json.loads(capture.read_text())
    for name in ("1_0", "env"):
        with zipfile.ZipFile(capture.parent / f"{name}.sog", "w") as bundle:
            for file in sorted((capture.parent / name).iterdir()):
                bundle.write(file, file.name)
    meta["filenames"][2], meta["environment"] = "1_0.sog", "env.sog"
    capture.write_text(json.dumps(meta))
    assert_same(read_splats(capture, 1), expected)
    meta["tree"]["children"][1]["lods"]["1"]["count"] = 41
    del meta["counts"]
    capture.write_text(json.dumps(meta))
    with pytest.raises(InputError, match=r"1_0\.sog holds 90 splats, lod-meta\.json says 91"):
        read_splats(capture, 1)


def test_the_environment_stays_marked_through_cleaning_and_sorting(capture):
    whole = read_splats(capture, 2)
    sorted_ = whole.in_spatial_order()
    assert sorted_.environment.sum() == 30
    expected = {mean.tobytes() for mean in whole.means[whole.environment]}
    assert {mean.tobytes() for mean in sorted_.means[sorted_.environment]} == expected
    assert joined([whole, tiles_of(capture, "1_0")]).environment.sum() == 30


def test_a_tile_that_is_not_needed_may_be_missing(capture):
    shutil.rmtree(capture.parent / "0_1")
    assert len(read_splats(capture, 1)) == 120
    with pytest.raises(InputError, match=r"0_1/meta\.json is missing, named by .*lod-meta\.json for level 0"):
        read_splats(capture, 0)
    shutil.rmtree(capture.parent / "0_0")
    with pytest.raises(InputError, match=r"0_0/meta\.json and 1 more are missing"):
        read_splats(capture, 0)


def leaf(meta, number):
    return meta["tree"]["children"][number]["lods"]


def nested(meta, depth):
    for _ in range(depth):
        meta["tree"] = {"bound": BOUND, "children": [meta["tree"]]}


DAMAGES = {
    "counts": (lambda meta: meta.update(counts=[220, 91, 40]), r"counts are \[220, 91, 40\], its tree holds \[220, 90"),
    "overlap": (lambda meta: leaf(meta, 1)["1"].update(offset=49), "overlap at row 49 of meta.json"),
    "gap": (lambda meta: leaf(meta, 1)["1"].update(offset=51), "leave a gap at row 50"),
    "tile of another count": (lambda meta: leaf(meta, 0)["0"].update(count=121), "counts are"),
    "no such file": (lambda meta: leaf(meta, 0)["0"].update(file=9), "names level 0 and file 9 of 3 and 4"),
    "no such level": (lambda meta: leaf(meta, 0).update({"7": leaf(meta, 0)["0"]}), "names level 7"),
    "negative": (lambda meta: leaf(meta, 0)["0"].update(offset=-1), "whole number, found -1"),
    "no number": (lambda meta: leaf(meta, 0)["0"].update(count="many"), "whole number, found 'many'"),
    "outside": (lambda meta: meta["filenames"].__setitem__(0, "../secret/meta.json"), "lies outside its folder"),
    "absolute": (lambda meta: meta["filenames"].__setitem__(0, "/etc/meta.json"), "lies outside its folder"),
    "address": (lambda meta: meta.update(environment="https://example.org/env.sog"), "lies outside its folder"),
    "no tree": (lambda meta: meta.pop("tree"), "does not describe a streamed SOG .*tree"),
    "no levels": (lambda meta: meta.update(lodLevels=0), "lodLevels must be positive"),
    "empty": (lambda meta: meta.update(tree={"children": []}, counts=[0, 0, 0]), "every level of its tree is empty"),
    "version": (lambda meta: meta.update(version=2), "version 2 of lod-meta.json is not supported"),
    "a tree of text": (lambda meta: meta.update(tree="oak"), "does not describe a streamed SOG"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_file_that_contradicts_itself_is_refused_in_one_line(capture, damage):
    change, message = DAMAGES[damage]
    meta = json.loads(capture.read_text())
    change(meta)
    capture.write_text(json.dumps(meta))
    with pytest.raises(InputError, match=message) as error:
        read_splats(capture, 0)
    assert "\n" not in str(error.value)


def test_a_deep_tree_is_walked_without_recursion(capture):
    meta = json.loads(capture.read_text())
    nested(meta, 400)  # deeper than any writer goes, as deep as json reads on every Python
    capture.write_text(json.dumps(meta))
    assert len(read_splats(capture, 0)) == 250


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe\x00", b"[" * 100_000, b"[1, 2]"])
def test_what_is_no_json_object_is_refused(capture, content):
    capture.write_bytes(content)
    with pytest.raises(InputError, match=r"lod-meta\.json|splat file") as error:
        read_splats(capture)
    assert "\n" not in str(error.value)


def test_a_short_tile_and_an_unreadable_one_are_named(capture):
    meta_path = capture.parent / "0_1" / "meta.json"
    tile = json.loads(meta_path.read_text())
    meta_path.write_text(json.dumps(tile | {"count": 99}))
    with pytest.raises(InputError, match=r"0_1/meta\.json holds 99 splats, lod-meta\.json says 100"):
        read_splats(capture, 0)
    meta_path.write_text(json.dumps(tile))
    image = capture.parent / "0_1" / "means_l.webp"
    image.write_bytes(image.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"0_1.*means_l\.webp is not a readable WebP"):
        read_splats(capture, 0)
    image.unlink()
    with pytest.raises(InputError, match=r"0_1.*means_l\.webp is missing"):
        read_splats(capture, 0)


@pytest.mark.parametrize("lod", [3, "7"])
def test_a_level_that_is_not_there_is_refused_with_those_that_are(capture, lod):
    with pytest.raises(InputError, match=rf"`lod` {lod}: .* levels 0 \(220 splats\), 1 \(90 splats\), 2 \(40 splats\)"):
        read_splats(capture, lod)


@pytest.mark.parametrize("lod", ["fine", "-1", "1.5", -1, 1.5, None, True])
def test_a_lod_that_is_no_number_is_refused(capture, lod):
    with pytest.raises(InputError, match="expected auto or the number of a level"):
        read_splats(capture, lod)


def test_a_lod_needs_levels(capture):
    with pytest.raises(InputError, match=r"`lod` 1: .*0_0 has no levels of detail"):
        read_splats(capture.parent / "0_0", 1)
