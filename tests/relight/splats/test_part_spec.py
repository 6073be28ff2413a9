"""What texts, files and arrays name as a part of a capture."""

from dataclasses import replace

import numpy as np
import pytest
from splat_samples import make_splats

from relight.splats.part_spec import PartSpec, SplatFile
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.formats import read_splats, write_inria_ply
from splat2mesh.splats.formats.ply import Ply
from splat2mesh.splats.joining import joined


@pytest.fixture
def file(tmp_path):
    """40 splats in a file, of which rows 3 and 7 share a place."""
    splats = make_splats(40, 1)
    means = splats.means.copy()
    means[7] = means[3]
    path = tmp_path / "all.ply"
    write_inria_ply(path, replace(splats, means=means))
    return SplatFile(read_splats(path), path)


def rows(given, file):
    return np.flatnonzero(PartSpec.parse(given).find(file)).tolist()


def with_column(file, path, name, values):
    """The file with one more column, which NumPy writes without the code of the package."""
    old = Ply.open(file.path).rows("vertex")
    new = np.zeros(len(old), [*[(each, "<f4") for each in old.dtype.names], (name, values.dtype.newbyteorder("<"))])
    for each in old.dtype.names:
        new[each] = old[each]
    new[name] = values
    kinds = {"f": "float", "u": "uchar", "i": "int"}
    lines = [f"property {kinds[new.dtype[each].kind]} {each}" for each in new.dtype.names]
    header = "\n".join(["ply", "format binary_little_endian 1.0", f"element vertex {len(new)}", *lines, "end_header\n"])
    path.write_bytes(header.encode() + new.tobytes())
    return SplatFile(read_splats(path), path)


@pytest.mark.parametrize(
    "text", ["box:at=.5,0,-.25,size=2,1.5,3", "box: at=.5,0,-.25 size=2,1.5,3", "box:.5,0,-.25,size=2,1.5,3"]
)
def test_a_box_holds_what_lies_between_its_sides(file, text):
    low, high = np.array([-0.5, -0.75, -1.75]), np.array([1.5, 0.75, 1.25])
    expected = [i for i, p in enumerate(file.splats.means) if all(low <= p) and all(p <= high)]
    assert 3 < len(expected) < 37 and rows(text, file) == expected


def test_a_sphere_holds_what_is_nearer_than_its_radius(file):
    expected = [i for i, p in enumerate(file.splats.means) if np.linalg.norm(p - [0.5, 0, 0]) < 1.2]
    assert 3 < len(expected) < 37 and rows("sphere:at=.5,0,0,radius=1.2", file) == expected


def test_volumes_lie_in_the_coordinates_of_a_file_that_are_too_large_for_float32(file):
    far = (500_000.0, 0.0, 4_000_000.0)
    moved = SplatFile(replace(file.splats, facts=replace(file.splats.facts, offset=far)))
    assert rows("box:at=500000.5,0,3999999.75,size=2,1.5,3", moved) == rows("box:at=.5,0,-.25,size=2,1.5,3", file)


@pytest.mark.parametrize("place", ["text", "npy", "array", "mask", "negative zero"])
def test_rows_are_those_of_the_file(file, tmp_path, place):
    wanted, given = [2, 3, 39], np.array([39, 2, 3, 3])
    if place == "text":
        given = tmp_path / "rows.txt"
        given.write_text("39 2,\n3\n")
    elif place == "npy":
        np.save(tmp_path / "rows.npy", given)
        given = str(tmp_path / "rows.npy")
    elif place != "array":
        given = np.isin(np.arange(40), wanted)
        given = given if place == "mask" else np.where(given, 1.0, -0.0)
    assert rows(given, file) == wanted


def test_shares_stay_as_they_are(file):
    shares = np.linspace(0, 1, 40, dtype=np.float32)
    np.testing.assert_array_equal(PartSpec.parse(shares).find(file), shares)


def test_a_ply_of_the_part_names_its_splats_and_what_shares_their_places(file, tmp_path):
    write_inria_ply(tmp_path / "part.ply", file.splats.take(np.array([20, 3, 11])))
    assert rows(tmp_path / "part.ply", file) == [3, 7, 11, 20]


def test_points_name_the_splats_that_they_lie_in(file, tmp_path):
    splats = file.splats
    axis = splats.rotation_matrices()[12][:, splats.scales[12].argmax()]
    point = splats.means[12] + 0.5 * splats.scales[12].max() * axis
    nearest = np.linalg.norm(splats.means - point, axis=1).argmin()
    header = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {c}\n" for c in "xyz")
    lines = "\n".join(" ".join(map(str, each)) for each in (point, [90.0, 0, 0], [np.nan, 0, 0]))
    (tmp_path / "points.ply").write_text(f"{header}end_header\n{lines}\n")
    with pytest.warns(DataWarning, match="1 of its 2 points lie in no splat"):
        assert rows(tmp_path / "points.ply", file) == [nearest]


def test_a_column_is_a_mask_or_shares(file, tmp_path):
    mask = np.isin(np.arange(40), [5, 6]).astype(np.uint8) * 255
    assert rows("column:label", with_column(file, tmp_path / "mask.ply", "label", mask)) == [5, 6]
    shares = np.linspace(0, 1, 40).astype(np.float32)
    soft = with_column(file, tmp_path / "soft.ply", "label", shares)
    np.testing.assert_array_equal(PartSpec.parse("column:label").find(soft), shares)


def test_an_object_of_a_layout_has_its_rows(file):
    both = SplatFile(joined([file.splats, file.splats]), None, lambda: {"one": slice(40), "two": slice(40, 80)})
    assert rows("object:two", both) == list(range(40, 80))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("cube:at=0,0,0,size=1,1,1", "expected box:at=X,Y,Z"),
        ("nowhere.ply", "found no such file"),
        ("x" * 5000, "found no such file"),
        ("box:at=0,0,0", "a box has at and size, found at"),
        ("box:at=0,0,0,size=1,1,1,turn=4", "a box has at and size"),
        ("box:at=0,0,size=1,1,1", "expected three numbers"),
        ("box:at=0,0,0,size=1,-1,1", "expected a number above 0"),
        ("sphere:0,0,0,radius=nan", "expected a number above 0"),
        ("column:label", "has no column label"),
        ("object:one", "is no layout"),
        (np.array([0, 40]), "row 40: the capture has the rows 0 to 39"),
        (np.array([-1]), "row -1"),
        (np.ones(39), "a truth or share for each of 40 splats"),
        (np.full(40, 1.5), "expected shares from 0 to 1, found 1.5"),
        (np.full(40, np.nan), "found nan"),
        (np.zeros((2, 2), int), "expected whole numbers"),
    ],
)
def test_what_names_no_part_is_refused_in_one_line(file, given, message):
    with pytest.raises(InputError) as caught:
        PartSpec.parse(given).find(file)
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_damaged_files_are_refused(file, tmp_path):
    (tmp_path / "rows.txt").write_text("1 2 three")
    (tmp_path / "rows.npy").write_bytes(b"\x93NUMPY broken")
    (tmp_path / "part.ply").write_text("ply\n")
    write_inria_ply(tmp_path / "away.ply", replace(file.splats, means=file.splats.means + 1000.0))
    for name, message in (
        ("rows.txt", "found three"),
        ("rows.npy", "rows.npy"),
        ("part.ply", "part.ply"),
        ("away.ply", "none of its 40 points lies in a splat"),
    ):
        with pytest.raises(InputError, match=message):
            PartSpec.parse(tmp_path / name).find(file)


def test_columns_are_of_a_single_ply(file):
    with pytest.raises(InputError, match="columns are of a single PLY"):
        PartSpec.parse("column:label").find(SplatFile(file.splats))
