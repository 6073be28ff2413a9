"""A folder of splat files as one splat; a file whose rows lie beyond 2^31 bytes."""

import tracemalloc

import pytest
from sog_samples import palette_splats, sog_parts, store_folder
from splat_samples import assert_same, make_splats, tile_at

from splat2mesh.base.errors import InputError
from splat2mesh.splats.formats import kind_of, read_splats, write_splats
from splat2mesh.splats.joining import joined
from splat2mesh.splats.splats import NUMBERS


@pytest.fixture
def tiles(tmp_path):
    """A folder of three tiles, side by side, of different kinds and degrees, and other things beside them."""
    folder = tmp_path / "yard"
    (folder / "c_sog").mkdir(parents=True)
    write_splats(folder / "b.ply", tile_at(10, make_splats(40, 0, 1)))
    write_splats(folder / "A.compressed.ply", make_splats(30, 3, 2), "compressed.ply")
    store_folder(folder / "c_sog", sog_parts(tile_at(20, palette_splats(50, 2)), 2))
    (folder / "README.txt").write_text("three tiles")
    (folder / "pictures").mkdir()
    return folder


def test_the_tiles_are_joined_in_the_order_of_their_names(tiles):
    whole = read_splats(tiles)
    assert_same(whole, joined([read_splats(tiles / name) for name in ("A.compressed.ply", "b.ply", "c_sog")]))
    assert len(whole) == 120 and whole.degree == 3 and whole.environment is None
    assert kind_of(tiles) == "tiles"


@pytest.mark.parametrize("name", ["b.ply", "zz.spz", "zz.splat", "c_sog/quats.webp"])
def test_one_unreadable_tile_is_named_and_not_skipped(tiles, name):
    (tiles / name).write_bytes(b"nothing of use")
    with pytest.raises(InputError, match=name.split("/")[0]):
        read_splats(tiles)


def test_a_folder_without_splats_and_levels_without_their_meta_are_refused(tmp_path):
    with pytest.raises(InputError, match="no splat file lies in it"):
        read_splats(tmp_path)
    for number, name in enumerate(("0_0", "0_1", "1_0")):
        (tmp_path / name).mkdir()
        store_folder(tmp_path / name, sog_parts(tile_at(10 * number, palette_splats(20, 0)), 2))
    with pytest.raises(InputError, match=r"tiles of 2 levels of detail but no lod-meta\.json"):
        read_splats(tmp_path)
    (tmp_path / "1_0").rename(tmp_path / "0_2")
    assert len(read_splats(tmp_path)) == 60


@pytest.mark.parametrize("names", [("lod1_0", "lod3_0"), ("robot_lod1", "robot_LOD3"), ("robot.lod-1", "robot.lod-3")])
def test_levels_of_one_capture_side_by_side_are_not_put_together(tmp_path, names):
    for name in names:
        (tmp_path / name).mkdir()
        store_folder(tmp_path / name, sog_parts(palette_splats(20, 0), 2))
    with pytest.raises(InputError, match=rf"2 levels of detail .*: give one of them, such as .*{names[0]}$"):
        read_splats(tmp_path)
    assert len(read_splats(tmp_path / names[0])) == 20


def test_files_of_two_levels_are_not_put_together_and_names_that_only_look_like_it_are(tmp_path):
    for number, name in enumerate(("explodes_1.ply", "lodge.ply", "melod3.ply", "lod2.ply")):
        write_splats(tmp_path / name, tile_at(10 * number, make_splats(20, 0, 1)))
    assert len(read_splats(tmp_path)) == 80
    write_splats(tmp_path / "a_lod0.ply", make_splats(20, 0, 1))
    with pytest.raises(InputError, match=r"give one of them, such as .*a_lod0\.ply"):
        read_splats(tmp_path)


def test_joining_takes_little_more_than_the_whole():
    def parts():
        return [make_splats(20_000, degree, degree) for degree in (3, 3, 1, 3, 3, 0, 3, 3)]

    made = parts()
    whole = joined(made)
    size = sum(getattr(whole, name).nbytes for name in NUMBERS)
    assert made == []
    tracemalloc.start()
    try:
        waiting = parts()
        tracemalloc.reset_peak()
        joined(waiting)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # tracemalloc counts the zeros of the whole at once, which the system hands out page by page: twice at most.
    assert peak < 2.05 * size


def test_rows_beyond_two_gigabytes_are_found(tmp_path):
    """A sparse file: before the vertices stands an element of 2^31 bytes that nobody reads and no disk holds."""
    splats = make_splats(100, 1)
    write_splats(tmp_path / "small.ply", splats)
    content = (tmp_path / "small.ply").read_bytes()
    end = content.index(b"end_header\n") + len(b"end_header\n")
    header = content[:end].replace(
        b"element vertex", b"element gap %d\nproperty uchar none\nelement vertex" % (1 << 31)
    )
    with open(tmp_path / "large.ply", "wb") as file:
        file.write(header)
        file.seek(1 << 31, 1)
        file.write(content[end:])
    assert (tmp_path / "large.ply").stat().st_size > 1 << 31
    assert_same(read_splats(tmp_path / "large.ply"), read_splats(tmp_path / "small.ply"))
    with open(tmp_path / "large.ply", "r+b") as file:
        file.truncate((1 << 31) + len(header) + 99 * (len(content) - end) // 100)
    with pytest.raises(InputError, match="promises 100 rows of 'vertex', there is room for 99"):
        read_splats(tmp_path / "large.ply")


def test_the_size_of_the_blocks_changes_nothing(tmp_path, monkeypatch):
    write_splats(tmp_path / "a.ply", make_splats(100, 2))
    expected = read_splats(tmp_path / "a.ply")
    for block in (1, 7, 99, 100, 101):
        monkeypatch.setattr("splat2mesh.splats.formats.inria.ROWS_AT_ONCE", block)
        assert_same(read_splats(tmp_path / "a.ply"), expected)
