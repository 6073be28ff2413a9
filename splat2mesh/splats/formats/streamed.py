"""Streamed SOG: a lod-meta.json beside tiles of SOG, as large captures are published.

{"lodLevels": 4, "filenames": ["0_0/meta.json", ...], "environment": "env/meta.json", "counts": [...], "tree": ...}

Each level of detail holds the whole capture, 0 the finest. The leaves of the tree say which rows of which tile a level
draws there: "lods": {"0": {"file": index into filenames, "offset": first row, "count": rows}}. The environment, sky and
far surroundings, is drawn with every level. Files before version 1 have no `version`, `count` and `counts`.
Source: playcanvas/splat-transform, src/lib/writers/write-lod.ts and src/lib/readers/read-lod.ts.
"""

import os
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...base.errors import InputError
from ...base.inputs import inside, read_json

META = "lod-meta.json"

MOST_LEVELS = 64
"""Each halves the splats or more."""

SPLAT_BUDGET = 6_000_000
"""Splats up to which `auto` takes a level: the largest captures that this project converts on a small machine."""


@dataclass(frozen=True)
class Streamed:
    """The checked content of a lod-meta.json. path: of the lod-meta.json. counts: the splats of each level. tiles: for
    each level, a tile's path to its count of splats, in the order of `filenames`. environment: of its SOG."""

    path: Path
    counts: tuple[int, ...]
    tiles: tuple[dict[Path, int], ...]
    environment: Path | None

    def check_tiles(self, level: int) -> None:
        """Check that every tile of a level is there. Raises InputError where one is missing."""
        tiles = self.tiles[level]
        lost = [path for path in [*tiles, *([self.environment] if self.environment else [])] if not path.is_file()]
        if lost:
            which = f"{lost[0]} is" if len(lost) == 1 else f"{lost[0]} and {len(lost) - 1} more are"
            raise InputError(f"{which} missing, named by {self.path} for level {level}: copy the whole folder")


def level_of(path: Path, counts: tuple[int, ...], lod: int | str) -> int:
    """Return the number of the level that `lod` names.

    path: for the message. counts: the splats of each level. lod: "auto" is the finest of at most `SPLAT_BUDGET` splats,
    or the coarsest where every level is over the budget. Raises InputError for a level without splats.
    """
    filled = [level for level, count in enumerate(counts) if count]
    if lod == "auto":
        return next((level for level in filled if counts[level] <= SPLAT_BUDGET), filled[-1])
    if not isinstance(lod, int) or lod not in filled:
        sizes = ", ".join(f"{level} ({counts[level]:,} splats)" for level in filled)
        raise InputError(f"`lod` {lod}: {path} has the levels {sizes}")
    return lod


def check_count(path: Path, found: int, expected: int, meta_path: Path) -> None:
    """Check the number of splats of a tile against its lod-meta.json. path: of the tile. Raises InputError where they
    differ."""
    if found != expected:
        raise InputError(
            f"{path} holds {found:,} splats, {meta_path.name} says {expected:,}: copy or export the folder again"
        )


def is_streamed(path: Path) -> bool:
    """Return whether a path is the lod-meta.json of a streamed SOG, by its content."""
    try:
        content = read_json(path)
    except InputError:
        return Path(path).name == META
    return isinstance(content, dict) and ("lodLevels" in content or Path(path).name == META)


def open_streamed(path: str | os.PathLike[str]) -> Streamed:
    """Read a lod-meta.json. Raises InputError where it is damaged or contradicts itself."""
    path = Path(path)
    try:
        meta = read_json(path)
        version = meta.get("version", 1)
        if version != 1:
            raise InputError(f"{path}: version {version} of {META} is not supported: expected 1")
        levels, names = int(meta["lodLevels"]), [inside(path.parent, name, path) for name in meta["filenames"]]
        if not 0 < levels <= MOST_LEVELS:
            raise InputError(f"{path}: lodLevels must be positive and at most {MOST_LEVELS}, found {levels}")
        tiles = _tiles(path, meta["tree"], levels, names)
        environment = inside(path.parent, meta["environment"], path) if meta.get("environment") else None
        counts = tuple(sum(tile.values()) for tile in tiles)
        promised = tuple(meta.get("counts", counts))
    except InputError:
        raise
    except (ValueError, OverflowError, KeyError, IndexError, TypeError, AttributeError) as error:
        raise InputError(f"{path} does not describe a streamed SOG ({type(error).__name__}: {error})") from error
    if promised != counts:
        raise InputError(f"{path}: its counts are {list(promised)}, its tree holds {list(counts)} splats by level")
    if not any(counts):
        raise InputError(f"{path} holds no splats: every level of its tree is empty")
    return Streamed(path, counts, tiles, environment)


def _tiles(path: Path, tree: Any, levels: int, names: list[Path]) -> tuple[dict[Path, int], ...]:
    """For each level, a dict of tile -> count; the leaves must cover every tile once, without gaps."""
    ranges, nodes = defaultdict(list), [tree]
    while nodes:
        node = nodes.pop()
        nodes.extend(node.get("children", ()))
        for key, reference in node.get("lods", {}).items():
            level, file = int(key), _whole(reference["file"])
            start, count = _whole(reference["offset"]), _whole(reference["count"])
            if not (0 <= level < levels and file < len(names)):
                raise ValueError(f"a leaf names level {key} and file {file} of {levels} and {len(names)}")
            if count:
                ranges[level, file].append((start, start + count))
    tiles: list[dict[Path, int]] = [{} for _ in range(levels)]
    for level, file in sorted(ranges):
        end = 0
        for start, stop in sorted(ranges[level, file]):
            if start != end:
                fault = "overlap" if start < end else "leave a gap"
                raise InputError(f"{path}: its leaves {fault} at row {min(start, end)} of {names[file].name}")
            end = stop
        tiles[level][names[file]] = end
    return tuple(tiles)


def _whole(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise ValueError(f"expected a whole number, found {value!r}")
    return value
