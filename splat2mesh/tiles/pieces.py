"""The files of a city as pieces that fit into memory: whole files, or ranges of rows of a large PLY.

Files in a bucket are copied to the worker that reads them, one at a time.
"""

import os
import warnings
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from ..base.errors import DataWarning, InputError
from ..base.inputs import inside, is_url
from ..splats.facts import HERE, Vector3
from ..splats.formats import inria, sog, streamed
from ..splats.formats.parts import Parts, parts_of
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
        found = _finest(path, lod)
        pieces = [piece for tile in found.tiles for piece in _cut(tile)]
        if found.environment is not None:
            pieces.append(CityPiece(str(found.environment), 0, -1, True))
        offset = _offset_of(found.tiles)
    except OSError as error:
        raise InputError(f"cannot read {error.filename or path}: {error.strerror or error}") from error
    return [piece._replace(offset=offset) for piece in pieces]


def _finest(path: str | Path, lod: Any) -> Parts:
    found = parts_of(path, lod)
    if lod == "auto" and found.level:
        found = parts_of(path, 0)
    if found.note:
        warnings.warn(found.note, DataWarning, stacklevel=2)
    return found


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
    """The pieces of a URL are those of a folder with the same names."""
    with TemporaryDirectory() as folder:
        top = _copy(url, Path(folder).resolve(), streamed.META)
        if not top.exists():
            raise InputError(f"{url}: no such file")
        try:
            found = _finest(top, lod)
        except InputError as error:
            raise InputError(str(error).replace(str(top), url)) from None
        far = found.environment
        pieces = []
        for path in (*found.tiles, *(() if far is None else (far,))):
            whole = path.parent if path.name == sog.META else path  # its pictures lie beside it
            pieces.append(CityPiece(url + str(whole).removeprefix(str(top)).replace(os.sep, "/"), 0, -1, path is far))
        return pieces


def _copy(url: str, folder: Path, wanted: str = "") -> Path:
    """Copy the file or folder of a URL into a folder; returns where it is. wanted: ending of the names of files that
    are copied; others are empty."""
    store, top = Store(url), folder / url.rsplit("/", 1)[1]
    for name in store.listed():
        target = inside(top, name, url) if name else top  # it may name anything
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(store.read(name) if name.endswith(wanted) else b"")
    return top


def size_of(piece: CityPiece) -> int:
    """Bytes of a piece's file."""
    return sum(Store(piece.path).listed().values()) if is_url(piece.path) else os.path.getsize(piece.path)


def read_piece(piece: CityPiece) -> Splats:
    """The splats of a piece, as the file has them. Raises InputError as `read_splats` does."""
    piece = CityPiece(*piece)
    x, y, z = piece.offset
    offset = float(x), float(y), float(z)
    if piece.last >= 0:
        with np.errstate(over="ignore", invalid="ignore"):
            return inria.read(Ply.open(piece.path), slice(piece.first, piece.last), offset)
    with TemporaryDirectory(prefix="splat2mesh.") as folder:
        splats = read_splats(_copy(piece.path, Path(folder)) if is_url(piece.path) else piece.path)
    splats = replace(splats, means=at_offset(splats, offset), facts=replace(splats.facts, offset=offset))
    return replace(splats, environment=np.ones(len(splats), bool)) if piece.environment else splats
