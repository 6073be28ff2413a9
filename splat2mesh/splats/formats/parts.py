"""The parts of a splat path: one file, a folder of tiles, or one level of a streamed SOG or an LCC scene."""

import os
import re
from dataclasses import dataclass
from pathlib import Path

from ...base.choices import check_lod
from ...base.errors import InputError
from . import lcc, sog, streamed
from .folders import trained_in

SUFFIXES = (".ply", ".splat", ".ksplat", ".spz", ".sog")
"""Suffixes that distinguish the tiles in a folder from its other files."""

METAS = sog.META, streamed.META, f"meta{lcc.SUFFIX}"
"""Names that many captures share, so their folders name them."""

_LEVEL = re.compile(r"^(\d+)_\d+$|(?<![a-z])lod[ _.-]?(\d+)", re.IGNORECASE)
"""The level in the name of a tile, as streamed SOGs and their tools have it: 0_3, lod1_0, robot.lod3.sog."""


@dataclass(frozen=True)
class Parts:
    """The splat files that make up one capture.

    tiles: in the order in which their rows stand. counts: the rows that each must have, None where nothing says it.
    environment: the splats that the capture keeps apart as its surroundings, whose rows come last. described_by: the
    lod-meta.json. level: of detail, 0 the finest; None where there are no levels. level_counts: the splats of every
    level, () where there are no levels. beside: other files that are read with them. note: what the folder holds and is
    left out, and why; "" where nothing is.
    """

    tiles: tuple[Path, ...]
    counts: tuple[int | None, ...]
    environment: Path | None = None
    described_by: Path | None = None
    level: int | None = None
    level_counts: tuple[int, ...] = ()
    beside: tuple[Path, ...] = ()
    note: str = ""

    @property
    def files(self) -> tuple[Path, ...]:
        """Everything that is read, in its order."""
        described, surroundings = (() if path is None else (path,) for path in (self.described_by, self.environment))
        return (*described, *self.tiles, *self.beside, *surroundings)


def parts_of(path: str | os.PathLike[str], lod: int | str = "auto") -> Parts:
    """Find the files that a splat path stands for.

    path: a splat file, a lod-meta.json, or a folder: of a streamed SOG, of an unbundled SOG, of an LCC scene, the
    output of INRIA's trainer, of which the last iteration counts, or of tiles, which are its splat files and unbundled
    SOGs in the order of their names. lod: level of a streamed SOG or an LCC scene. Raises InputError when there is
    nothing, when a tile that is named is missing, or when `lod` has no meaning here.
    """
    path = Path(path)
    lod = check_lod(lod)
    described = description_of(path)
    if described is not None:
        capture = streamed.open_streamed(described)
        level = streamed.level_of(described, capture.counts, lod)
        capture.check_tiles(level)
        counted = capture.tiles[level]
        return Parts(tuple(counted), tuple(counted.values()), capture.environment, described, level, capture.counts)
    scene = _lcc_in(path)
    if scene is not None:
        opened = lcc.open_lcc(scene)
        level = streamed.level_of(scene, opened.counts, lod)
        return Parts((scene,), (None,), None, None, level, opened.counts, opened.files[1:])
    if lod != "auto":
        raise InputError(f"`lod` {lod}: {path} has no levels of detail, which a streamed SOG or an LCC scene has")
    if not path.is_dir() or (path / sog.META).is_file():
        return Parts((path,), (None,))
    trained = trained_in(path)
    if trained:
        newest = trained[-1]
        note = f"{path} holds {len(trained)} checkpoints of one training: took the newest, {newest.relative_to(path)}"
        return Parts((newest,), (None,), note=note if len(trained) > 1 else "")
    tiles = _tiles_in(path)
    return Parts(tiles, (None,) * len(tiles))


def _lcc_in(path: Path) -> Path | None:
    """The meta.lcc of an LCC scene, given itself or its folder; None for anything else."""
    if path.is_dir():
        found = sorted(each for each in path.iterdir() if each.suffix.lower() == lcc.SUFFIX)
        return found[0] if len(found) == 1 else None
    return path if path.suffix.lower() == lcc.SUFFIX and path.is_file() else None


def description_of(path: Path) -> Path | None:
    """The lod-meta.json of a streamed SOG, given itself or its folder; None for anything else."""
    if path.is_dir() and (path / streamed.META).is_file():
        path = path / streamed.META
    return path if path.suffix.lower() == ".json" and path.is_file() and streamed.is_streamed(path) else None


def _tiles_in(folder: Path) -> tuple[Path, ...]:
    found = sorted(folder.iterdir(), key=lambda entry: entry.name)
    tiles = [entry for entry in found if entry.suffix.lower() in SUFFIXES and entry.is_file()]
    bundles = [entry for entry in found if entry.is_dir() and (entry / sog.META).is_file()]
    if not tiles and not bundles:
        raise InputError(
            f"{folder} is a folder without {sog.META} or {streamed.META}, and no splat file lies in it: "
            "expected a splat file, an unbundled SOG folder, a streamed SOG or a folder of tiles"
        )
    levels: dict[int, list[Path]] = {}
    for entry in sorted(tiles + bundles, key=lambda entry: entry.name):
        match = _LEVEL.search(entry.name)
        if match:
            levels.setdefault(int(match[1] or match[2]), []).append(entry)
    if len(levels) > 1:
        finest = levels[min(levels)]
        instead = f"give one of them, such as {finest[0]}" if len(finest) == 1 else "copy the whole folder"
        raise InputError(
            f"{folder} holds the tiles of {len(levels)} levels of detail but no {streamed.META}, "
            f"which distinguishes them: {instead}"
        )
    return tuple(sorted(tiles + bundles, key=lambda entry: entry.name))
