"""The files of a city as pieces that fit into memory: whole files, or ranges of rows of a large PLY.

Files in a bucket are copied to the worker that reads them, one at a time.
"""

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from ..base.errors import DataWarning, InputError
from ..base.inputs import inside, is_url
from ..splats.facts import HERE, Vector3
from ..splats.formats import inria, sog, streamed
from ..splats.formats.parts import SUFFIXES, check_lod, parts_of
from ..splats.formats.ply import Ply
from ..splats.formats.read import read_splats
from ..splats.formats.register import kind_of_file
from ..splats.joining import at_offset
from ..splats.splats import Splats
from .store import Store

PIECE_ROWS = 500_000
"""Rows of a PLY that are read at a time: about 250 MB with all harmonics."""


class CityPiece(NamedTuple):
    """TilePart of a city's source. path: of the file, or its URL. first, last: range of its rows; last is -1 for all.

    environment: whether it is the far surroundings that a streamed SOG keeps apart. offset: of the means of all pieces.
    """

    path: str
    first: int
    last: int
    environment: bool
    offset: Vector3 = HERE


def pieces_of(path: str, lod: Any = "auto") -> list[CityPiece]:
    """The pieces of a city, in the order of its files. path: as `parts_of`, or a URL of fsspec. lod: level of a
    streamed SOG; auto is the finest here. Raises InputError as `parts_of` does."""
    if is_url(path):
        return _in_bucket(path.rstrip("/"), lod)
    if not Path(path).exists():
        raise InputError(f"{path}: no such file")
    try:
        found = parts_of(path, lod)
        if lod == "auto" and found.level:
            found = parts_of(path, 0)
        if found.note:
            warnings.warn(found.note, DataWarning, stacklevel=2)
        pieces = [piece for tile in found.tiles for piece in _cut(tile)]
        if found.environment is not None:
            pieces.append(CityPiece(str(found.environment), 0, -1, True))
        offset = _offset_of(found.tiles)
    except OSError as error:
        raise InputError(f"cannot read {error.filename or path}: {error.strerror or error}") from error
    return [piece._replace(offset=offset) for piece in pieces]


def _offset_of(tiles: tuple[Path, ...]) -> Vector3:
    """The offset of the first file that has one, at which all pieces are read."""
    plys = (Ply.open(tile) for tile in tiles if tile.is_file() and kind_of_file(tile) == "ply")
    return next((offset for offset in map(inria.offset_of, plys) if offset != HERE), HERE)


def _cut(path: Path) -> list[CityPiece]:
    if path.is_file() and kind_of_file(path) == "ply":
        elements = Ply.open(path).elements
        rows = elements["vertex"].count if "vertex" in elements else 0
        if rows > PIECE_ROWS:
            starts = range(0, rows, PIECE_ROWS)
            return [CityPiece(str(path), start, min(start + PIECE_ROWS, rows), False) for start in starts]
    return [CityPiece(str(path), 0, -1, False)]


def _in_bucket(url: str, lod: Any) -> list[CityPiece]:
    names = Store(url).listed()
    if not names:
        raise InputError(f"{url}: no such file")
    if streamed.META in names:
        with TemporaryDirectory() as folder:
            meta = Path(folder).resolve() / streamed.META
            meta.write_bytes(Store(url).read(streamed.META))
            capture = streamed.open_streamed(meta)
            level = 0 if lod == "auto" else streamed.level_of(meta, capture.counts, check_lod(lod))
            pieces = [_under(url, meta.parent, path) for path in capture.tiles[level]]
            far = capture.environment
            return pieces + ([_under(url, meta.parent, far)._replace(environment=True)] if far is not None else [])
    if lod != "auto":
        raise InputError(f"`lod` {lod}: {url} has no levels of detail, which only a streamed SOG has")
    if "" in names or sog.META in names:
        return [CityPiece(url, 0, -1, False)]
    tops = {name.split("/")[0] for name in names if name.count("/") == (name.endswith("/" + sog.META))}
    tiles = sorted(top for top in tops if top.lower().endswith(SUFFIXES) or f"{top}/{sog.META}" in names)
    if not tiles:
        raise InputError(f"{url}: no splat file lies in it")
    return [CityPiece(f"{url}/{name}", 0, -1, False) for name in tiles]


def _under(url: str, folder: Path, path: Path) -> CityPiece:
    path = path.parent if path.name == sog.META else path  # its pictures lie beside it
    return CityPiece(f"{url}/{path.relative_to(folder).as_posix()}", 0, -1, False)


def size_of(piece: CityPiece) -> int:
    """Bytes of a piece's file."""
    return sum(Store(piece.path).listed().values()) if is_url(piece.path) else os.path.getsize(piece.path)


@contextmanager
def _here(path: str) -> Iterator[str]:
    """A local path for a path or URL; a copy is removed afterwards."""
    if not is_url(path):
        yield path
        return
    store, name = Store(path), path.rsplit("/", 1)[1]
    with TemporaryDirectory(prefix="splat2mesh.") as folder:
        for below in store.listed():
            target = inside(Path(folder) / name, below, path) if below else Path(folder) / name  # it may name anything
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(store.read(below))
        yield str(Path(folder) / name)


def read_piece(piece: CityPiece) -> Splats:
    """The splats of a piece, as the file has them. Raises InputError as `read_splats` does."""
    piece = CityPiece(*piece)
    x, y, z = piece.offset
    offset = float(x), float(y), float(z)
    with _here(piece.path) as path:
        if piece.last < 0:
            splats = read_splats(path)
            facts = replace(splats.facts, offset=offset)
            splats = replace(splats, means=at_offset(splats, offset), facts=facts)
            return replace(splats, environment=np.ones(len(splats), bool)) if piece.environment else splats
        with np.errstate(over="ignore", invalid="ignore"):
            return inria.read(Ply.open(path), slice(piece.first, piece.last), offset)
