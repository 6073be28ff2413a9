"""Which files of a folder are frames, and which of them rest."""

from dataclasses import replace

import numpy as np
import pytest
from splat_samples import make_splats

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.frames import ALONE, AT_REST, MOVING, frame_splats, frames_in, state_of


def folder_of(tmp_path, *names):
    for name in names:
        (tmp_path / name).write_bytes(b"")
    return tmp_path


def test_frames_stand_in_the_order_of_their_numbers(tmp_path):
    folder = folder_of(tmp_path, "f_10.ply", "f_8.ply", "f_009.ply", "cameras.json", "notes.txt", ".f_3.ply")
    (folder / "f_11.ply").mkdir()
    assert [(each.number, each.path.name, each.kind) for each in frames_in(folder)] == [
        (8, "f_8.ply", "ply"),
        (9, "f_009.ply", "ply"),
        (10, "f_10.ply", "ply"),
    ]


@pytest.mark.parametrize("suffix", ["spz", "sog", "splat", "compressed.ply"])
def test_every_format_has_frames(tmp_path, suffix):
    assert [each.kind for each in frames_in(folder_of(tmp_path, f"a1.{suffix}", f"a2.{suffix}"))] == [suffix] * 2


@pytest.mark.parametrize(
    ("numbers", "missing"),
    [([1, 2, 4], "missing: 3;"), ([0, 10, 40], "20 to 30"), ([5, 6, 9, 12], "7 to 8, 10 to 11;")],
)
def test_missing_numbers_are_told_once(tmp_path, numbers, missing):
    with pytest.warns(DataWarning, match=missing) as caught:
        assert len(frames_in(folder_of(tmp_path, *(f"f{n}.ply" for n in numbers)))) == len(numbers)
    assert len(caught) == 1


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ([], "holds no numbered splat files"),
        (["a.ply", "b.ply"], "holds no numbered splat files"),
        (["f1.ply"], "holds one frame"),
        (["f1.ply", "f2.ply", "g1.ply"], "holds 2 sequences, f1.ply \\(2\\) and g1.ply \\(1\\)"),
        (["f1.ply", "f2.spz"], "several formats \\(1 ply, 1 spz\\)"),
        (["f1.ply", "f01.ply"], "holds frame 1 twice"),
    ],
)
def test_other_folders_are_refused(tmp_path, names, message):
    with pytest.raises(InputError, match=message):
        frames_in(folder_of(tmp_path, *names))


def test_files_without_a_number_are_left_out_with_a_warning(tmp_path):
    with pytest.warns(DataWarning, match="left out: all.ply"):
        assert len(frames_in(folder_of(tmp_path, "f1.ply", "f2.ply", "all.ply"))) == 2


def test_a_file_is_no_sequence(tmp_path):
    with pytest.raises(InputError, match="expected a folder"):
        frames_in(tmp_path / "f1.ply")


def test_a_frame_that_cannot_be_read_is_left_out_with_a_warning(tmp_path):
    frames = frames_in(folder_of(tmp_path, "f1.ply", "f2.ply"))
    with pytest.warns(DataWarning, match="frame 1 is left out: .*is empty"):
        assert frame_splats(frames[0]) is None


def test_splats_rest_within_their_own_extent():
    first = make_splats(50, 1)
    largest = first.scales.max(axis=1)

    def moved(row, by):
        means = first.means.copy()
        means[row, 0] += by * largest[row]
        return replace(first, means=means)

    assert state_of(first, first) == state_of(replace(first, sh=2 * first.sh), first) == AT_REST
    assert state_of(moved(slice(None), 0.9), first) == AT_REST and state_of(moved(7, 1.1), first) == MOVING


def test_splats_of_other_rows_stand_alone():
    first = make_splats(50, 1)
    lost = replace(first, means=np.where(np.arange(50)[:, None] == 3, np.nan, first.means))
    for other in (first.take(np.arange(49)), replace(first, sh=first.sh[:, :1]), lost):
        assert state_of(other, first) == ALONE


def test_what_nobody_sees_may_move():
    first = make_splats(50, 1)
    faint = replace(first, opacities=np.where(np.arange(50) == 7, 0.001, first.opacities))
    means = faint.means.copy()
    means[7] += 9.0
    assert state_of(replace(faint, means=means), faint) == AT_REST
