"""What a folder means: tiles, checkpoints, the same splats again, frames of a sequence, other things in one place."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scan_samples import write_lcc
from splat_samples import assert_same, make_splats, tile_at

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.formats import parts_of, read_splats, write_splats


def ball(count=400, seed=0, degree=1):
    """Splats on a sphere: the outlines of two of them agree, as those of one scene do."""
    splats = make_splats(count, degree, seed)
    means = splats.means / np.linalg.norm(splats.means, axis=1, keepdims=True)
    return replace(splats, means=means, sh=splats.sh / 8)


def relit(splats):
    return replace(splats, sh=splats.sh * 0.5)


def stored(folder, named):
    """named: file name -> Splats; the suffix gives the kind."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, splats in named.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        kind = name.split(".", 1)[1]
        write_splats(folder / name, splats, kind if kind in ("spz", "compressed.ply", "sog") else "ply")
    return folder


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("splat_7000.ply", "splat_30000.ply"),
        ("export_05000.ply", "export_10000.ply"),
        ("point_cloud_6999.ply", "point_cloud_29999.ply"),
        ("ckpt_17.ply", "ckpt_120.ply"),
        ("iteration_7000.compressed.ply", "iteration_30000.compressed.ply"),
        ("step-000500.spz", "step-002500.spz"),
        ("ckpt_6999_rank0.ply", "ckpt_29999_rank0.ply"),
        ("garden2_7000.ply", "garden2_30000.ply"),
    ],
)
def test_of_checkpoints_the_newest_is_taken(tmp_path, old, new):
    folder = stored(tmp_path / "out", {old: ball(300, 1), new: ball(450, 2)})
    with pytest.warns(DataWarning, match=rf"holds 2 checkpoints of one training: took the newest, {new}") as caught:
        found = read_splats(folder)
    assert len(found) == 450 and len(caught) == 1
    assert parts_of(folder).tiles == (folder / new,)


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
    ("kept", "others"),
    [
        ("garden.ply", ["relit_splat.ply"]),
        ("garden.ply", ["garden_relit.ply"]),
        ("garden.ply", ["garden.spz"]),
        ("garden.ply", ["garden.compressed.ply"]),
        ("garden.ply", ["clean_splat.ply", "garden.spz"]),
        ("garden.spz", ["garden.compressed.ply"]),
        ("bust.ply", ["bust (1).ply"]),
        ("a1.ply", ["a1.compressed.ply"]),
    ],
)
def test_the_same_splats_again_count_once(tmp_path, kept, others):
    splats = ball()
    folder = stored(tmp_path / "out", {kept: splats, **{name: relit(splats) for name in others}})
    with pytest.warns(DataWarning, match=rf"holds? the splats of {kept} once more: read that one alone") as caught:
        found = read_splats(folder)
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_same(found, read_splats(folder / kept))


@pytest.mark.parametrize("name", ["garden.spz", "clean_splat.ply"])
def test_a_pruned_copy_counts_once(tmp_path, name):
    folder = stored(tmp_path / "out", {"garden.ply": ball(500), name: ball(500).take(slice(0, 480))})
    with pytest.warns(DataWarning, match="once more"):
        assert len(read_splats(folder)) == 500


@pytest.mark.parametrize("names", [[f"frame_{n:04d}.ply" for n in range(4)], [f"{n}.spz" for n in (3, 4, 5)]])
def test_frames_of_a_sequence_are_refused_with_what_to_do(tmp_path, names):
    still = ball()
    named = {}
    for number, name in enumerate(names):
        moved = still.means.copy()
        moved[:40] += 0.05 * number  # a tenth of the scene moves
        named[name] = replace(still, means=moved)
    folder = stored(tmp_path / "film", named)
    with pytest.raises(InputError, match=rf"{len(names)} frames of a sequence, {names[0]} to {names[-1]}.*--sequence"):
        read_splats(folder)
    assert len(read_splats(folder / names[1])) == 400


def test_frames_of_other_counts_are_frames_too(tmp_path):
    folder = stored(tmp_path / "film", {f"time_{n}.ply": ball(300 + n, n) for n in range(3)})
    with pytest.raises(InputError, match="3 frames of a sequence"):
        read_splats(folder)


def test_other_things_in_one_place_are_refused(tmp_path):
    folder = stored(tmp_path / "two", {"bust.ply": ball(300, 1), "vase.ply": ball(301, 2)})
    with pytest.raises(InputError, match=r"bust\.ply lie in the same place|vase\.ply lie in the same place"):
        read_splats(folder)


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


def test_tiles_that_each_lie_there_twice_count_once(tmp_path):
    named = {}
    for x in range(3):
        tile = tile_at(5 * x, ball(300, x))
        named |= {f"tile_{x}.ply": tile, f"tile_{x}.spz": tile}
    with pytest.warns(DataWarning, match=r"once more: read that one alone \(and 2 more groups of files alike\)"):
        assert len(read_splats(stored(tmp_path / "city", named))) == 900


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


def test_a_folder_changes_between_two_readings(tmp_path):
    folder = stored(tmp_path / "out", {"a_100.ply": ball(300, 1), "a_200.ply": ball(400, 2)})
    with pytest.warns(DataWarning, match="checkpoints"):
        assert len(read_splats(folder)) == 400
    (folder / "a_200.ply").unlink()
    assert len(read_splats(folder)) == 300
