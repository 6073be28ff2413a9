"""What a folder means: tiles, the output of a trainer, several things in one place."""

import os
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scan_samples import write_lcc
from splat_samples import make_splats, tile_at

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.formats import parts_of, read_splats, write_splats


def ball(count=400, seed=0, degree=1):
    """Splats on a sphere: the outlines of two of them agree, as those of one scene do."""
    splats = make_splats(count, degree, seed)
    means = splats.means / np.linalg.norm(splats.means, axis=1, keepdims=True)
    return replace(splats, means=means, sh=splats.sh / 8)


def stored(folder, named):
    """named: file name -> Splats; the suffix gives the kind."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, splats in named.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        kind = name.split(".", 1)[1]
        write_splats(folder / name, splats, kind if kind in ("spz", "compressed.ply", "sog") else "ply")
    return folder


@pytest.mark.parametrize("below", ["", "point_cloud"])
def test_the_output_of_the_reference_trainer(tmp_path, below):
    """input.ply is the point cloud that training began with."""
    name = "point_cloud/iteration_{}/point_cloud.ply"
    folder = stored(tmp_path / "out", {name.format(7000): ball(300, 1), name.format(30000): ball(450, 2)})
    (folder / "input.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n")
    with pytest.warns(DataWarning, match=r"took the newest, .*iteration_30000.point_cloud\.ply"):
        assert len(read_splats(folder / below)) == 450
    with pytest.warns(DataWarning):
        (folder / "point_cloud" / "iteration_7000" / "point_cloud.ply").rename(folder / "point_cloud" / "old.ply")
        (folder / "point_cloud" / "iteration_7000").rmdir()
        assert len(read_splats(stored(folder, {name.format(100): ball(20)}))) == 450
    assert len(read_splats(folder / "point_cloud" / "iteration_30000")) == 450


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("garden.ply", "garden.spz"),
        ("splat_7000.ply", "splat_30000.ply"),
        ("frame_0.sog", "frame_1.sog"),
        ("bust.compressed.ply", "vase.ply"),
    ],
)
def test_files_in_one_place_are_refused_with_the_newest(tmp_path, first, second):
    """Formats, checkpoints or frames of one capture, or other things: all would be drawn over one another."""
    folder = stored(
        tmp_path / "out", {"aside.ply": tile_at(9, ball()), first: ball(300, 1, 0), second: ball(301, 2, 0)}
    )
    os.utime(folder / first, (1, 1))
    one, other = sorted((first, second))
    with pytest.raises(InputError, match=rf"{one} and {other} lie in the same place.*the newest, .*{second}$"):
        read_splats(folder)
    assert len(read_splats(folder / second)) == 301


def test_tiles_that_overlap_by_a_tenth_stay_tiles(tmp_path):
    rng = np.random.default_rng(0)
    base = make_splats(500, 0)
    named = {}
    for x in range(3):
        for z in range(2):
            means = np.array([x, 0, z]) + rng.uniform(-0.05, 1.05, (500, 3))
            named[f"tile_{x}_{z}.ply"] = replace(base, means=means)
    folder = stored(tmp_path / "city", named)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read_splats(folder)) == 3000


def test_splats_without_a_place_or_an_extent(tmp_path):
    splats = make_splats(20, 0)
    lost = replace(splats, means=np.full((20, 3), np.nan, np.float32))
    point = replace(splats, means=np.zeros((20, 3), np.float32))
    folder = stored(tmp_path / "out", {"a.ply": lost, "b.ply": tile_at(9, point), "c.ply": tile_at(18, splats)})
    assert len(read_splats(folder)) == 60


def test_the_folder_of_an_lcc_scene(tmp_path):
    path = write_lcc(tmp_path / "scene", [ball(60, 1, 0), ball(20, 2, 0)])
    assert parts_of(tmp_path / "scene").tiles == (path,)
    assert len(read_splats(tmp_path / "scene", 1)) == 20
