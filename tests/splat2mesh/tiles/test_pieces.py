"""The files of a city behind a URL are those of the folder."""

import json
from dataclasses import replace

import numpy as np
import pytest
from sog_samples import palette_splats, sog_parts, store_folder
from splat_samples import make_splats, tile_at

from splat2mesh.base.errors import InputError
from splat2mesh.splats.facts import FileFacts
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.tiles.pieces import pieces_of, read_piece, size_of

fsspec = pytest.importorskip("fsspec")


def sent(folder):
    """The URL of a copy of a folder."""
    url = f"memory://{folder.name}_{folder.parent.name}"
    fsspec.filesystem("memory").put(f"{folder}/", url.removeprefix("memory:/"), recursive=True)
    return url


def assert_same_pieces(folder, lod="auto"):
    here, there = pieces_of(str(folder), lod), pieces_of(sent(folder), lod)
    assert len(here) == len(there) > 0
    for ours, theirs in zip(here, there, strict=True):
        expected, found = read_piece(ours), read_piece(theirs)
        for name in ("means", "scales", "quats_wxyz", "opacities", "sh"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        assert found.environment is expected.environment is None or found.environment.all()
        assert size_of(theirs) > 0
    return there


@pytest.fixture
def tiles(tmp_path):
    (tmp_path / "tiles").mkdir()
    for number, name in enumerate(("b.ply", "a.ply")):
        write_inria_ply(tmp_path / "tiles" / name, tile_at(10 * number, make_splats(20 + number, 1)))
    (tmp_path / "tiles" / "notes.txt").write_text("no splats")
    (tmp_path / "tiles" / "c").mkdir()
    store_folder(tmp_path / "tiles" / "c", sog_parts(tile_at(20, palette_splats(30, 0)), 2))
    return tmp_path / "tiles"


def test_a_folder_of_tiles(tiles):
    found = assert_same_pieces(tiles)
    assert [piece.path.rsplit("/", 1)[1] for piece in found] == ["a.ply", "b.ply", "c"]


def test_a_single_file(tiles):
    url = f"{sent(tiles)}/a.ply"
    (piece,) = pieces_of(url)
    assert len(read_piece(piece)) == 21 and size_of(piece) == (tiles / "a.ply").stat().st_size


def test_a_streamed_capture(tmp_path):
    folder = tmp_path / "streamed"
    for name, count in {"0_0": 40, "0_1": 30, "1_0": 20, "env": 10}.items():
        (folder / name).mkdir(parents=True)
        store_folder(folder / name, sog_parts(palette_splats(count, 0), 2))
    bound = {"min": [0, 0, 0], "max": [1, 1, 1]}
    lods = [{"0": (0, 40), "1": (2, 20)}, {"0": (1, 30)}]
    lods = [{level: {"file": f, "offset": 0, "count": n} for level, (f, n) in each.items()} for each in lods]
    meta = {"lodLevels": 2, "filenames": [f"{name}/meta.json" for name in ("0_0", "0_1", "1_0")]}
    meta |= {"environment": "env/meta.json"}
    meta |= {"tree": {"bound": bound, "children": [{"bound": bound, "lods": each} for each in lods]}}
    (folder / "lod-meta.json").write_text(json.dumps(meta))
    assert len(assert_same_pieces(folder)) == 3
    assert len(assert_same_pieces(folder, 1)) == 2
    with pytest.raises(InputError, match="`lod` 5"):
        pieces_of(sent(folder), 5)


def test_missing_files_are_reported(tiles):
    url = sent(tiles)
    with pytest.raises(InputError, match="no such file"):
        pieces_of(f"{url}/none.ply")
    with pytest.raises(InputError, match="`lod` 1"):
        pieces_of(url, 1)
    empty = tiles.parent / "other"
    empty.mkdir()
    (empty / "notes.txt").write_text("no splats")
    with pytest.raises(InputError, match="no splat file"):
        pieces_of(sent(empty))


def test_pieces_of_a_georeferenced_city_share_one_offset(tmp_path, monkeypatch):
    """Doubles of UTM, in two files and in ranges of rows: full detail, and one frame."""
    monkeypatch.setattr("splat2mesh.tiles.pieces.PIECE_ROWS", 40)
    whole = []
    for number, offset in enumerate([(5e5, 5.4e6, 300.0), (5e5 + 20, 5.4e6, 301.0)]):
        splats = replace(make_splats(70, 0, number), facts=FileFacts(offset=offset))
        write_inria_ply(tmp_path / f"tile_{number}.ply", splats)
        whole.append(splats.means.astype(np.float64) + offset)
    pieces = pieces_of(str(tmp_path))
    assert len(pieces) == 4 and len({piece.offset for piece in pieces}) == 1 and any(pieces[0].offset)
    read = [read_piece(json.loads(json.dumps(piece))) for piece in pieces]
    assert {each.facts.offset for each in read} == {pieces[0].offset}
    found = np.concatenate([each.means for each in read]).astype(np.float64) + pieces[0].offset
    np.testing.assert_allclose(found, np.concatenate(whole), atol=5e-6)
