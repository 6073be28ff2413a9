"""XGRIDS' `.lcc`: a meta.lcc beside index.bin, data.bin and, with harmonics, shcoef.bin; environment.bin is the far.

The scene is cut into units on a grid, each with every level of detail, 0 the finest. A splat takes 32 bytes: float32
position, RGBA as bytes, scales as 16 bits between bounds of the whole scene, a rotation of 2 + 3 x 10 bits, a normal;
and 64 bytes of harmonics, 11 + 10 + 11 bits each. z points up; the resulting Splats are y down.
Source: github.com/xgrids/LCCWhitepaper; playcanvas/splat-transform, src/lib/readers/read-lcc.ts.
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InputError
from ...base.inputs import file_size, read_json
from ..facts import FileFacts
from ..joining import joined
from ..placing import placed, similarity
from ..splats import Splats
from .encoding import restore_largest, sh_from_color
from .streamed import MOST_LEVELS, level_of

SUFFIX = ".lcc"
INDEX, DATA, HARMONICS, FAR = "index.bin", "data.bin", "shcoef.bin", "environment.bin"

_SPLAT = np.dtype(
    [
        ("mean", "<f4", 3),
        ("rgba", "u1", 4),
        ("scale", "<u2", 3),
        ("quat_low", "<u2"),
        ("quat_high", "<u2"),
        ("normal", "<u2", 3),
    ]
)
_REST = np.dtype([("sh", "<u4", 15), ("spare", "<u4")])
_FAR_SPLAT = np.dtype([*_SPLAT.descr, *_REST.descr])
_TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From z up to y down."""


@dataclass(frozen=True)
class LccFile:
    """The checked content of a meta.lcc and its index.

    counts: the splats of each level. units: (U, levels, 2) int64, Splats of each unit and level, and the byte of the
    first in data.bin. bounds: dict of str to (2, 3), of scales and harmonics, those of the environment too. has_rest:
    whether there are harmonics.
    """

    path: Path
    counts: tuple[int, ...]
    units: NDArray[np.int64]
    bounds: dict[str, NDArray[np.float32]]
    has_rest: bool

    @property
    def files(self) -> tuple[Path, ...]:
        """Everything that is read, in its order."""
        names = (INDEX, DATA, *([HARMONICS] if self.has_rest else []))
        far = beside(self.path, FAR)
        return (self.path, *(beside(self.path, name) for name in names), *([far] if far.is_file() else []))


def beside(path: Path, name: str) -> Path:
    """Return the path of a file beside a meta.lcc, whose name some writers begin with a capital."""
    upper = path.parent / name.capitalize()
    return upper if not (path.parent / name).exists() and upper.exists() else path.parent / name


def open_lcc(path: str | os.PathLike[str]) -> LccFile:
    """Read a meta.lcc and its index. Raises InputError where a file is missing, damaged, or of another size than the
    index says."""
    path = Path(path)
    try:
        meta = read_json(path)
        levels, promised = int(meta["totalLevel"]), tuple(int(count) for count in meta["splats"])
        if not 0 < levels <= MOST_LEVELS:
            raise InputError(f"{path}: totalLevel must be positive and at most {MOST_LEVELS}, found {levels}")
        has_rest, bounds = _bounds(path, meta)
    except InputError:
        raise
    except (ValueError, OverflowError, KeyError, IndexError, TypeError, AttributeError) as error:
        raise InputError(f"{path} does not describe an LCC scene ({type(error).__name__}: {error})") from error
    units = _units(path, levels)
    counts = tuple(int(count) for count in units[:, :, 0].sum(axis=0))
    if promised != counts:
        raise InputError(f"{path}: its splats are {list(promised)} by level, {INDEX} holds {list(counts)}")
    if not any(counts):
        raise InputError(f"{path} holds no splats: every level is empty")
    _check_sizes(path, units, has_rest)
    return LccFile(path, counts, units, bounds, has_rest)


def _bounds(path: Path, meta: Any) -> tuple[bool, dict[str, NDArray[np.float32]]]:
    """Whether there are harmonics, and the bounds of scales and harmonics, those of the environment too."""
    named = {str(each["name"]): each for each in meta["attributes"]}
    kind = meta.get("fileType")
    has_rest = kind == "Quality" or (kind != "Portable" and "shcoef" in named)
    bounds = {}
    for name, usual in (("scale", "scale"), ("shcoef", "shcoef"), ("envscale", "scale"), ("envshcoef", "shcoef")):
        entry = named.get(name) or named.get(usual)
        if entry is None and (has_rest or "scale" in name):
            raise InputError(f"{path} does not describe an LCC scene: it lacks the bounds of {usual}")
        if entry is not None:
            bounds[name] = np.stack([np.broadcast_to(np.asarray(entry[end], np.float32), 3) for end in ("min", "max")])
    return has_rest, bounds


def _units(path: Path, levels: int) -> NDArray[np.int64]:
    file = beside(path, INDEX)
    record = np.dtype(
        [("x", "<i2"), ("y", "<i2"), ("lods", [("points", "<i4"), ("at", "<i8"), ("size", "<i4")], levels)]
    )
    size = file_size(file, f"part of {path.name}")
    if size == 0 or size % record.itemsize:
        raise InputError(
            f"{file} takes {size:,} bytes, expected a multiple of {record.itemsize}: copy the whole folder"
        )
    lods = np.fromfile(file, record)["lods"]
    return np.stack([lods["points"].astype(np.int64), lods["at"]], axis=-1)


def _check_sizes(path: Path, units: NDArray[np.int64], has_rest: bool) -> None:
    counts, starts = units[..., 0], units[..., 1]
    size = file_size(beside(path, DATA), f"part of {path.name}")
    # Compared as shares of the file, lest a sum of large numbers wraps around.
    if (counts < 0).any() or (starts < 0).any() or (starts > size - counts * _SPLAT.itemsize).any():
        raise InputError(f"{beside(path, DATA)} is cut short: {INDEX} names splats beyond its {size:,} bytes")
    if int(counts.sum()) * _SPLAT.itemsize > size:
        raise InputError(f"{beside(path, INDEX)} is damaged: its units share splats of {DATA}")
    rest = file_size(beside(path, HARMONICS), f"part of {path.name}") if has_rest else 2 * size
    if rest < 2 * size:
        raise InputError(f"{beside(path, HARMONICS)} is cut short: expected {2 * size:,} bytes, found {rest:,}")


def read(path: str | os.PathLike[str], lod: int | str = "auto") -> Splats:
    """Read one level of an LCC scene, and its environment. path: of the meta.lcc. lod: as for a streamed SOG. Returns
    Splats: unit after unit; the environment comes last and is marked so. Raises InputError as `open_lcc` does."""
    scene = open_lcc(path)
    level = level_of(scene.path, scene.counts, lod)
    counts, starts = scene.units[:, level].T
    rows = [np.arange(count) + start // _SPLAT.itemsize for count, start in zip(counts, starts, strict=True) if count]
    if (starts[counts > 0] % _SPLAT.itemsize).any():
        raise InputError(f"{beside(scene.path, INDEX)} is damaged: a unit begins within a splat")
    chosen = np.concatenate(rows)
    splats = np.memmap(beside(scene.path, DATA), np.uint8, "r")
    whole = len(splats) // _SPLAT.itemsize
    near = np.array(splats[: whole * _SPLAT.itemsize].view(_SPLAT)[chosen])
    rest = None
    if scene.has_rest:
        packed = np.memmap(beside(scene.path, HARMONICS), np.uint8, "r")[: whole * _REST.itemsize]
        rest = np.array(packed.view(_REST)["sh"][chosen])
    parts = [_decoded(near, rest, scene.bounds["scale"], scene.bounds.get("shcoef"))]
    far = _environment(scene)
    if far is not None:
        parts.append(far)
    facts = FileFacts(up=(0.0, 0.0, 1.0), up_from=f"{SUFFIX}, whose z axis points up")
    return placed(replace(joined(parts), facts=facts), similarity(rotation=_TURN))


def _environment(scene: LccFile) -> Splats | None:
    file = beside(scene.path, FAR)
    if not file.exists():
        return None
    record = _FAR_SPLAT if scene.has_rest else _SPLAT
    size = file_size(file, f"part of {scene.path.name}")
    if size % record.itemsize:
        raise InputError(f"{file} takes {size:,} bytes, expected a multiple of {record.itemsize}: copy it again")
    rows = np.fromfile(file, record)
    if not len(rows):
        return None
    rest = rows["sh"] if scene.has_rest else None
    far = _decoded(rows, rest, scene.bounds["envscale"], scene.bounds.get("envshcoef"))
    return replace(far, environment=np.ones(len(far), bool))


def _decoded(
    rows: NDArray[Any],  # (N,) of _SPLAT
    rest: NDArray[np.uint32] | None,  # (N, 15)
    scale_bounds: NDArray[np.float32],  # (2, 3)
    rest_bounds: NDArray[np.float32] | None,
) -> Splats:
    rgba = rows["rgba"] / np.float32(255)
    scales = _between(scale_bounds, rows["scale"] / np.float32(65535))
    packed = rows["quat_low"].astype(np.uint32) | rows["quat_high"].astype(np.uint32) << 16
    parts = np.stack([packed, packed >> 10, packed >> 20], axis=1) & 1023
    quats_xyzw = restore_largest((parts / np.float32(1023) * 2 - 1) / np.float32(np.sqrt(2)), packed >> 30)
    sh = np.zeros((len(rows), 1 if rest is None else 16, 3), np.float32)
    sh[:, 0] = sh_from_color(rgba[:, :3])
    if rest is not None and rest_bounds is not None:
        shares = ((rest & 2047) / np.float32(2047), (rest >> 11 & 1023) / np.float32(1023))
        sh[:, 1:] = _between(rest_bounds, np.stack([*shares, (rest >> 21) / np.float32(2047)], axis=-1))
    return Splats(rows["mean"], scales, quats_xyzw[:, [3, 0, 1, 2]], rgba[:, 3], sh)


def _between(bounds: NDArray[np.float32], shares: NDArray[Any]) -> NDArray[np.float32]:
    return ((1 - shares) * bounds[0] + shares * bounds[1]).astype(np.float32)
