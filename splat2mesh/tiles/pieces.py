"""The files of a city as pieces that fit into memory: whole files, or ranges of rows of a large PLY."""

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..base.errors import InputError
from ..splats.formats import inria
from ..splats.formats.parts import parts_of
from ..splats.formats.ply import Ply
from ..splats.formats.read import kind_of, read_splats
from ..splats.splats import Splats

PIECE_ROWS = 500_000
"""Rows of a PLY that are read at a time: about 250 MB with all harmonics."""


class Piece(NamedTuple):
    """Part of a city's source. path: of the file. first, last: range of its rows; last is -1 for the whole file.

    environment: whether it is the far surroundings that a streamed SOG keeps apart.
    """

    path: str
    first: int
    last: int
    environment: bool


def pieces_of(path: str, lod: Any = "auto") -> list[Piece]:
    """The pieces of a city, in the order of its files. lod: level of a streamed SOG; auto is the finest here.

    Raises InputError as `parts_of` does.
    """
    if not Path(path).exists():
        raise InputError(f"{path}: no such file")
    try:
        found = parts_of(path, lod)
        if lod == "auto" and found.level:
            found = parts_of(path, 0)
        pieces = [piece for tile in found.tiles for piece in _cut(tile)]
        if found.environment is not None:
            pieces.append(Piece(str(found.environment), 0, -1, True))
    except OSError as error:
        raise InputError(f"cannot read {error.filename or path}: {error.strerror or error}") from error
    return pieces


def _cut(path: Path) -> list[Piece]:
    if path.is_file() and kind_of(path) == "ply":
        elements = Ply.open(path).elements
        rows = elements["vertex"].count if "vertex" in elements else 0
        if rows > PIECE_ROWS:
            starts = range(0, rows, PIECE_ROWS)
            return [Piece(str(path), start, min(start + PIECE_ROWS, rows), False) for start in starts]
    return [Piece(str(path), 0, -1, False)]


def read_piece(piece: Piece) -> Splats:
    """The splats of a piece, as the file has them. Raises InputError as `read_splats` does."""
    piece = Piece(*piece)
    if piece.last < 0:
        splats = read_splats(piece.path)
        return replace(splats, environment=np.ones(len(splats), bool)) if piece.environment else splats
    with np.errstate(over="ignore", invalid="ignore"):
        return inria.read(Ply.open(piece.path), slice(piece.first, piece.last))
