"""What a folder of splat files means: tiles of one capture, or the same capture several times.

Tiles hardly overlap. Files in the same place are checkpoints of one training, of which the newest counts; the same
splats again, as another format or in another light, of which one counts; or frames of a sequence, which are not read.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InputError
from ..splats import Splats
from .ply import Ply, some_rows
from .register import BY_KIND, kind_of_file, reader_of

SAME_PLACE = 0.5
"""Share of the space of two files, together, that both fill, from which they show the same: two checkpoints have .9 and
more, tiles that overlap by a tenth of their sides .05."""

SAME_BOUNDS, SAME_SPLAT = 0.05, 0.002
"""Diagonals by which the bounds of the same splats may differ, and the places of one of them, after quantising."""

MOVED = 0.005
"""Share of the splats that must have moved from one frame to the next."""

SAMPLE, _RUN = 4096, 256
"""Splats of a file that are compared, and those that are read at a time."""

_MOST_KNOWN = 8
_known: dict[Any, tuple[tuple[Path, ...], str]] = {}

_INNER = 1, 99
"""Percentiles of the places along each axis that bound a file: what floats about does not count."""

_NUMBERS = re.compile(r"\d+")
_TRAINING = re.compile(r"(^|[^a-z])(iter(ation)?s?|steps?|ckpt|checkpoint|epoch)([^a-z]|$)", re.IGNORECASE)
_STEPS = 100
"""Trainers save after a multiple of this many steps, or count from 0 and name the last one."""
_RESULT = re.compile(r"(^|[^a-z])(relit|relight|clean|albedo|catcher|cleaned|compressed)([^a-z]|$)", re.IGNORECASE)
_ITERATION = re.compile(r"^iteration_(\d+)$")


class FramesError(InputError):
    """A folder that holds the frames of a sequence, in their order."""

    def __init__(self, message: str, frames: tuple[Path, ...]) -> None:
        super().__init__(message)
        self.frames = frames


@dataclass(frozen=True, eq=False)
class _Sketch:
    """A file, its number of splats, and the places of some of them: (M, 3) float64."""

    path: Path
    kind: str
    count: int
    places: NDArray[np.float64]
    bounds: NDArray[np.float64]

    @property
    def diagonal(self) -> float:
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @property
    def stem(self) -> str:
        name = self.path.parent.name if _ITERATION.match(self.path.parent.name) else self.path.name
        for suffix in sorted((s for each in BY_KIND.values() for s in each.suffixes), key=len, reverse=True):
            if name.lower().endswith(suffix):
                return name[: -len(suffix)]
        return name

    @property
    def words(self) -> tuple[str, ...]:
        """The stem between its numbers."""
        return tuple(_NUMBERS.split(self.stem.lower()))

    @property
    def numbers(self) -> tuple[int, ...]:
        return tuple(map(int, _NUMBERS.findall(self.stem)))


def trained_in(folder: Path) -> list[Path]:
    """Find the checkpoints in the output folder of INRIA's trainer, or in its folder point_cloud, oldest first.

    Returns a list of Path of point_cloud.ply files; empty for any other folder.
    """
    found = {}
    for above in (folder / "point_cloud", folder):
        for each in above.iterdir() if above.is_dir() else ():
            match, file = _ITERATION.match(each.name), each / "point_cloud.ply"
            if match and file.is_file():
                found[int(match[1])] = file
        if found:
            break
    return [found[number] for number in sorted(found)]


def meant(folder: Path, files: Sequence[Path], read: dict[Path, Splats] | None = None) -> tuple[tuple[Path, ...], str]:
    """Choose the files that a folder stands for.

    folder: for messages. files: the splat files in it, at least one. read: takes what had to be read as a whole to
    choose: path to Splats. Returns files: in their order; note: what was left out and why, or "". Raises InputError for
    frames of a sequence, for files in the same place that are neither tiles nor copies, and for a broken file.
    """
    if len(files) < 2:
        return tuple(files), ""
    states = [each.stat() for each in files]
    key = folder, tuple((path, state.st_size, state.st_mtime_ns) for path, state in zip(files, states, strict=True))
    if key not in _known:  # asked several times of the same folder in one run
        if len(_known) >= _MOST_KNOWN:
            _known.clear()
        _known[key] = _meant(folder, files, {} if read is None else read)
    return _known[key]


def _meant(folder: Path, files: Sequence[Path], read: dict[Path, Splats]) -> tuple[tuple[Path, ...], str]:
    kept, notes = [], []
    for group in _groups([_sketch(path, read) for path in files]):
        one, note = _one_of(folder, group)
        kept.append(one.path)
        notes += [note] * bool(note)
    note = notes[0] + (f" (and {len(notes) - 1} more groups of files alike)" if len(notes) > 1 else "") if notes else ""
    return tuple(path for path in files if path in kept), note


def _one_of(folder: Path, group: list[_Sketch]) -> tuple[_Sketch, str]:
    """The file that counts among those in one place, and what to say about the others."""
    distinct: list[_Sketch] = []
    for each in sorted(group, key=_preference):
        if not any(_same(each, other) for other in distinct):
            distinct.append(each)
    if len(distinct) == 1:
        others = sorted(each.path.name for each in group if each is not distinct[0])
        hold = f"{', '.join(others[:4])} {'holds' if len(others) == 1 else 'hold'}"
        note = f"{folder}: {hold} the splats of {distinct[0].path.name} once more: read that one alone"
        return distinct[0], note if len(group) > 1 else ""
    column = _counted(distinct)
    if column is not None:
        distinct.sort(key=lambda each: each.numbers[column])
        steps = all(each.numbers[column] % _STEPS in (0, _STEPS - 1) for each in distinct)
        if steps or _TRAINING.search(distinct[0].stem):
            newest = distinct[-1]
            name = newest.path.relative_to(folder)
            note = f"{folder} holds {len(distinct)} checkpoints of one training: took the newest, {name}"
            return newest, f"{note}; give the path of another to read that"
        ends = f"{distinct[0].path.name} to {distinct[-1].path.name}"
        raise FramesError(
            f"{folder} holds {len(distinct)} frames of a sequence, {ends}: sequences are not yet read (the option "
            f"--sequence will); give one file, such as {distinct[0].path}",
            tuple(each.path for each in distinct),
        )
    first, second = distinct[:2]
    raise InputError(
        f"{folder}: {first.path.name} and {second.path.name} lie in the same place, so they are no tiles of one "
        f"capture: give one file, such as {first.path}"
    )


def _counted(group: list[_Sketch]) -> int | None:
    """Which number in the names of files counts them, where nothing else differs; None where none does."""
    if len({each.words for each in group}) > 1:
        return None
    columns = [len(set(values)) for values in zip(*(each.numbers for each in group), strict=True)]
    return columns.index(len(group)) if sorted(columns, reverse=True)[:2] in ([len(group)], [len(group), 1]) else None


def _preference(sketch: _Sketch) -> tuple[Any, ...]:
    name = sketch.path.name
    return bool(_RESULT.search(sketch.stem)), BY_KIND[sketch.kind].exactness, -sketch.count, len(name), name


def _same(one: _Sketch, other: _Sketch) -> bool:
    """Whether two files in one place hold the same splats."""
    diagonal = max(one.diagonal, other.diagonal)
    if np.abs(one.bounds - other.bounds).max() > SAME_BOUNDS * diagonal:
        return False
    if one.count != other.count:
        pruned = _RESULT.search(one.stem) or _RESULT.search(other.stem)
        return bool(pruned) or one.stem.lower() == other.stem.lower()
    if one.words != other.words or one.numbers == other.numbers:
        return True
    apart = np.linalg.norm(one.places - other.places, axis=1)
    return bool(np.count_nonzero(~(apart <= SAME_SPLAT * diagonal)) <= MOVED * len(apart))


def _groups(sketches: list[_Sketch]) -> list[list[_Sketch]]:
    """The files in groups that lie in one place each."""
    bounds = np.stack([each.bounds for each in sketches])
    # Flat ones get a thickness, so that they have a volume.
    pad = 1e-3 * max(float(np.linalg.norm(bounds[:, 1] - bounds[:, 0], axis=1).max()), 1e-12)
    low, high = bounds[:, 0] - pad, bounds[:, 1] + pad
    volume = np.prod(high - low, axis=1)
    group = np.arange(len(sketches))
    for i in range(len(sketches)):
        shared = np.prod(np.maximum(np.minimum(high[i], high) - np.maximum(low[i], low), 0), axis=1)
        near = shared > SAME_PLACE * (volume[i] + volume - shared)
        for other in np.unique(group[near]):
            group[group == other] = group[i]
    return [[each for each, mark in zip(sketches, group, strict=True) if mark == of] for of in np.unique(group)]


def _sketch(path: Path, read: dict[Path, Splats]) -> _Sketch:
    kind = kind_of_file(path)
    count, places = _places(path, kind, read)
    places = places.astype(np.float64)
    finite = places[np.isfinite(places).all(axis=1)]
    bounds = np.percentile(finite, _INNER, axis=0) if len(finite) else np.zeros((2, 3))
    return _Sketch(path, kind, count, places, bounds)


def _places(path: Path, kind: str, read: dict[Path, Splats]) -> tuple[int, NDArray[Any]]:
    """How many splats a file holds, and the places of some, (M, 3): a PLY is not read as a whole."""
    if kind == "ply":
        ply = Ply.open(path)
        if "vertex" in ply.elements and {"x", "y", "z"} <= ply.elements["vertex"].properties.keys():
            rows = ply.rows("vertex")
            # Runs of rows, since a page of the disk holds many.
            starts = np.unique(np.linspace(0, max(len(rows) - _RUN, 0), SAMPLE // _RUN).astype(np.int64))
            runs = some_rows(rows, starts.tolist(), _RUN)
            return len(rows), np.concatenate([np.stack([run[name] for name in "xyz"], axis=1) for run in runs])
    splats = read[path] = reader_of(kind)(path)
    whole = splats.means.astype(np.float64) + splats.facts.offset
    return len(splats), whole[:: 1 + len(splats) // SAMPLE]
