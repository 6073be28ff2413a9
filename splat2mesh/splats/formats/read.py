"""The reader for a splat file, chosen by its content rather than by its name."""

import os
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...base.errors import DataWarning
from ...base.inputs import check_special, quiet_numbers, reading
from ..joining import joined
from ..splats import Splats
from . import lcc, streamed
from .folders import check_tiles
from .parts import description_of, parts_of
from .register import kind_of_file, reader_of


def read_splats(path: str | os.PathLike[str], lod: int | str = "auto") -> Splats:
    """Read any supported splat, of the formats in `register.FORMATS`, or many tiles.

    path: a file; for SOG also the folder that holds meta.json, or that meta.json; the lod-meta.json of a streamed SOG,
    or its folder; a folder of splat files, which are joined in the order of their names (see `parts.parts_of`). lod:
    level of a streamed SOG or an LCC scene, 0 being the finest, or "auto", the finest of at most
    `streamed.SPLAT_BUDGET` splats. Returns Splats in the frame of an INRIA PLY, not yet cleaned: rows may hold NaN, or
    be invisible. Rows stand in the order of the tiles; the environment of a streamed SOG comes last and is marked so.
    Raises InputError when a file is missing, empty, cut short, or of another kind, and when two lie in the same place:
    no tile is skipped. Warns with a DataWarning when "auto" passes over a finer level, where one checkpoint is taken of
    several, and about what is left out.
    """
    path = Path(path)
    check_special(path)
    with reading(path):
        # Values beyond float32 become infinite or NaN here, and `clean` drops and counts them.
        with quiet_numbers():
            found, splats = parts_of(path, lod), []
            if lod == "auto" and found.level:
                _say_coarser(path, found.level, found.level_counts)
            if found.note:
                warnings.warn(found.note, DataWarning, stacklevel=2)
            for tile, count in zip(found.tiles, found.counts, strict=True):
                splats.append(_read(tile, found.level))
                if count is not None and found.described_by is not None:
                    streamed.check_count(tile, len(splats[-1]), count, found.described_by)
            if len(splats) > 1 and found.described_by is None:
                check_tiles(path, dict(zip(found.tiles, splats, strict=True)))
            if found.environment is not None:
                far = reader_of(kind_of_file(found.environment))(found.environment)
                splats.append(replace(far, environment=np.ones(len(far), bool)))
            return joined(splats)


def _read(tile: Path, level: int | None) -> Splats:
    kind = kind_of_file(tile)
    if kind == "lcc" and level is not None:
        return lcc.read(tile, level)
    return reader_of(kind)(tile)


def _say_coarser(path: Path, level: int, counts: tuple[int, ...]) -> None:
    warnings.warn(
        f"{path}: took level {level} with {counts[level]:,} splats; level 0 holds {counts[0]:,}, "
        f"over the {streamed.SPLAT_BUDGET:,} that auto takes: `lod` 0 reads it",
        DataWarning,
        stacklevel=3,
    )


def kind_of(path: str | os.PathLike[str]) -> str:
    """Recognise the format of a splat by its content. Returns a kind of `register.FORMATS`, or "tiles". Raises
    InputError for what is none of them."""
    path = Path(path)
    check_special(path)
    with reading(path):
        if description_of(path) is not None:  # whichever of its levels are there
            return "tiles"
        found = parts_of(path)
        return "tiles" if found.tiles != (path,) else kind_of_file(path)
