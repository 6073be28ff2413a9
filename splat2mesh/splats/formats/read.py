"""The reader for a splat file, chosen by its content rather than by its name."""

import os
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...base.errors import DataWarning, InputError
from ...base.inputs import check_special, quiet_numbers, reading
from ..joining import joined
from ..splats import Splats
from . import compressed_ply, dotsplat, inria, sog, spz, streamed
from .parts import description_of, parts_of
from .ply import Ply

KINDS = (
    "an INRIA or compressed .ply, a .splat, a .spz, a .sog (also as a folder with meta.json), "
    "the lod-meta.json of a streamed SOG, or a folder of tiles"
)
_ZIP = b"PK\x03\x04"


def read_splats(path: str | os.PathLike[str], lod: int | str = "auto") -> Splats:
    """Read any supported splat: INRIA PLY (also 2DGS), PlayCanvas compressed PLY, .splat, .spz, .sog, or many tiles.

    Parameters
    ----------
    path : path
        A file; for SOG also the folder that holds meta.json, or that meta.json; the lod-meta.json of a streamed SOG, or
        its folder; a folder of splat files, which are joined in the order of their names.
    lod : int or "auto"
        Level of a streamed SOG, 0 being the finest, or "auto", the finest of at most `streamed.SPLAT_BUDGET` splats.

    Returns
    -------
    Splats
        In the frame of an INRIA PLY, not yet cleaned: rows may hold NaN, or be invisible. Rows stand in the order of
        the tiles; the environment of a streamed SOG comes last and is marked so.

    Raises
    ------
    InputError
        When a file is missing, empty, cut short, or of another kind: no tile is skipped.

    Warns
    -----
    DataWarning
        When "auto" passes over a finer level.
    """
    path = Path(path)
    check_special(path)
    with reading(path):
        # Values beyond float32 become infinite or NaN here, and `clean` drops and counts them.
        with quiet_numbers():
            found, splats = parts_of(path, lod), []
            if lod == "auto" and found.level:
                _say_coarser(path, found.level, found.level_counts)
            for tile, count in zip(found.tiles, found.counts, strict=True):
                splats.append(_read(tile, _kind(tile)))
                if count is not None and found.described_by is not None:
                    streamed.check_count(tile, len(splats[-1]), count, found.described_by)
            if found.environment is not None:
                far = _read(found.environment, _kind(found.environment))
                splats.append(replace(far, environment=np.ones(len(far), bool)))
            return joined(splats)


def _say_coarser(path: Path, level: int, counts: tuple[int, ...]) -> None:
    warnings.warn(
        f"{path}: took level {level} with {counts[level]:,} splats; level 0 holds {counts[0]:,}, "
        f"over the {streamed.SPLAT_BUDGET:,} that auto takes: `lod` 0 reads it",
        DataWarning,
        stacklevel=3,
    )


def kind_of(path: str | os.PathLike[str]) -> str:
    """Recognise the format of a splat by its content.

    Parameters
    ----------
    path : path

    Returns
    -------
    str
        "ply" (INRIA, 2DGS), "compressed.ply", "splat", "spz", "sog" or "tiles".

    Raises
    ------
    InputError
        For what is none of them.
    """
    path = Path(path)
    check_special(path)
    with reading(path):
        if description_of(path) is not None:  # whichever of its levels are there
            return "tiles"
        found = parts_of(path)
        return "tiles" if found.tiles != (path,) else _kind(path)


def _read(path: Path, kind: str) -> Splats:
    if kind == "sog":
        if path.is_dir():
            return sog.read_folder(path)
        with open(path, "rb") as file:
            bundled = file.read(len(_ZIP)) == _ZIP
        return sog.read_bundle(path) if bundled else sog.read_folder(path.parent, path.name)
    if kind in ("ply", "compressed.ply"):
        return (inria if kind == "ply" else compressed_ply).read(Ply.open(path))
    return {"spz": spz, "splat": dotsplat}[kind].read(path)


def _kind(path: Path) -> str:
    if not path.exists():
        raise InputError(f"{path} does not exist: expected {KINDS}")
    if path.is_dir():
        return "sog"
    check_special(path)
    with open(path, "rb") as file:
        head = file.read(64)
    if not head:
        raise InputError(f"{path} is empty: expected {KINDS}")
    if head.split(b"\n")[0].strip() == b"ply":
        return "compressed.ply" if "chunk" in Ply.open(path).elements else "ply"
    if head.startswith((b"\x1f\x8b", spz.MAGIC)):
        return "spz"
    if head.startswith(_ZIP) or head.lstrip().startswith(b"{"):
        return "sog"
    if path.suffix.lower() == ".splat":
        return "splat"
    raise InputError(f"{path} is not a splat file (it starts with {head[:12]!r}): expected {KINDS}")
