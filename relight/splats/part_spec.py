"""A part of a capture, as a text, a file or an array names it: which splats and which points of space are in it.

    box:at=0,1,0,size=2,1,2         edges along the axes of the splat
    sphere:at=0,1,0,radius=.5
    statue.ply                      the part, cut out of the splat; or any points on it
    rows.npy, rows.txt              rows of the splat file, from 0
    column:label                    a column of the splat file, a PLY
    object:guitar                   an object of a layout
    part1                           a part that was made in the session of the scene (`kept_parts`)

Positions are in the frame of the splat, those of a layout in the frame of its scene.
"""

import os
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrayfiles import load_array
from splat2mesh.base.arrays import Mask, Points
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.inputs import reading
from splat2mesh.base.specs import clip, parse_spec, plain, vector
from splat2mesh.splats.cleaning import sound
from splat2mesh.splats.formats import kind_of, read_splats
from splat2mesh.splats.formats.ply import Ply
from splat2mesh.splats.splats import Splats

from ..lamps.shapes import checked_size

AnyPart: TypeAlias = "str | os.PathLike[str] | NDArray[Any]"
"""A text, a file, or an array: whole numbers are rows; N truths or N shares from 0 to 1 are one for each splat."""

Shares: TypeAlias = NDArray[np.float32]
"""For each splat or vertex how much of it is in a part, 0 to 1."""

_VOLUMES = {"box": ("at", "size"), "sphere": ("at", "radius")}
_KIND = re.compile(r"([a-z]+):(.*)", re.DOTALL)
_COMMA = re.compile(r"\s*,\s*(?=\w+\s*=)")
_ROWS = (".npy", ".txt")
EXPECTED = "box:at=X,Y,Z,size=A,B,C, sphere:at=X,Y,Z,radius=R, a .ply of the part, a .npy or .txt of rows, column:NAME"
EXPECTED += ", the name of a part made in the session or, in a layout, object:NAME"


@dataclass(frozen=True, eq=False)
class SplatFile:
    """What parts are looked for in. splats: every row. path: of their file; None where there are several. objects:
    returns the rows of each object of a layout by its name; none without a layout."""

    splats: Splats
    path: Path | None = None
    objects: Callable[[], dict[str, slice]] = dict


@dataclass(frozen=True, eq=False)
class PartSpec:
    """A part as requested. words: to name it. inside: of a volume: takes points (M, 3), returns (M,) bool; else None.
    find: takes a SplatFile, returns the Shares of its splats; raises InputError where they cannot be found."""

    words: str
    inside: Callable[[Points], Mask] | None
    find: Callable[[SplatFile], Shares]

    @classmethod
    def parse(cls, given: AnyPart) -> "PartSpec":
        """The part that a text, a file or an array names. Raises InputError, in one line, for anything else."""
        if isinstance(given, np.ndarray):
            return cls(f"an array of {len(given) if given.ndim else 1}", None, lambda file: _of_array(given, file))
        text = os.fspath(given).strip()
        kind, rest = match.groups() if (match := _KIND.fullmatch(text)) else ("", text)
        try:
            if kind in _VOLUMES:
                inside = _volume(kind, rest)
                return cls(text, inside, lambda file: inside(_places(file)).astype(np.float32))
            if kind in _NAMED and rest:
                return cls(text, None, lambda file: _NAMED[kind](rest, file))
        except InputError as error:
            raise InputError(plain(error)) from None
        path = Path(text)
        if not os.path.isfile(path):
            raise InputError(f"expected {EXPECTED}, found no such file")
        if path.suffix.lower() in _ROWS:
            return cls(text, None, lambda file: _of_array(_rows_in(path), file))
        return cls(text, None, lambda file: _near(path, file))


def _places(file: SplatFile) -> NDArray[np.float64]:
    """Centres (N, 3) in the coordinates of the file."""
    return np.asarray(file.splats.means + np.asarray(file.splats.facts.offset, np.float64))


def _volume(kind: str, text: str) -> Callable[[Points], Mask]:
    head, given = parse_spec(_COMMA.sub(" ", text))
    if head:
        given = {"at": head, **given}
    if set(given) != set(_VOLUMES[kind]):
        raise InputError(f"a {kind} has {' and '.join(_VOLUMES[kind])}, found {', '.join(given) or 'neither'}")
    center = np.array(vector("at", given["at"]))
    if kind == "sphere":
        radius = checked_size("radius", given["radius"])
        return lambda points: np.asarray(((points - center) ** 2).sum(axis=1) <= radius * radius)
    half = np.array([checked_size("size", each) for each in vector("size", given["size"])]) / 2
    return lambda points: np.asarray((np.abs(points - center) <= half).all(axis=1))


def _rows_in(path: Path) -> NDArray[Any]:
    """The numbers in a .npy or a text."""
    with reading(path):
        if path.suffix.lower() == ".npy":
            return np.asarray(load_array(path))
        words = path.read_text(encoding="utf-8").replace(",", " ").split()
        odd = next((word for word in words if not re.fullmatch(r"-?\d{1,18}", word)), None)
        if odd is not None:
            raise InputError(f"{path}: expected whole numbers, the rows of the part, found {clip(odd)}")
        return np.array(words, np.int64)


def _of_array(values: NDArray[Any], file: SplatFile) -> Shares:
    """Shares by rows, or by one value for each splat."""
    count = len(file.splats)
    if values.ndim == 1 and np.issubdtype(values.dtype, np.integer):
        outside = values[(values < 0) | (values >= count)]
        if len(outside):
            raise InputError(f"row {outside[0]}: the capture has the rows 0 to {count - 1:,}")
        shares = np.zeros(count, np.float32)
        shares[values] = 1.0
        return shares
    if values.dtype.kind not in "bf" or values.shape != (count,):
        raise InputError(
            f"expected whole numbers, the rows of the part, or a truth or share for each of {count:,} splats, "
            f"found {values.dtype} of shape {values.shape}"
        )
    return _checked(values.astype(np.float32))


def _checked(shares: Shares) -> Shares:
    outside = shares[~((shares >= 0.0) & (shares <= 1.0))]
    if len(outside):
        raise InputError(f"expected shares from 0 to 1, found {outside[0]:g}")
    return shares


def _of_column(name: str, file: SplatFile) -> Shares:
    """Shares by a column: numbers with a point are shares, of whole numbers all but 0 are in the part."""
    if file.path is None or kind_of(file.path) not in ("ply", "compressed.ply"):
        raise InputError(f"columns are of a single PLY, and the capture is {file.path or 'several files'}")
    ply = Ply.open(file.path)
    if name not in ply.elements["vertex"].properties:
        raise InputError(f"{file.path} has no column {clip(name)}")
    values = np.array(ply.rows("vertex")[name])
    return _checked(values.astype(np.float32) if values.dtype.kind == "f" else (values != 0).astype(np.float32))


def _of_object(name: str, file: SplatFile) -> Shares:
    objects = file.objects()
    if name not in objects:
        known = f"has {', '.join(objects)}" if objects else "is no layout of several splats"
        raise InputError(f"no such object: the capture {clip(known)}")
    shares = np.zeros(len(file.splats), np.float32)
    shares[objects[name]] = 1.0
    return shares


_NAMED = {"column": _of_column, "object": _of_object}


def _near(path: Path, file: SplatFile) -> Shares:
    """Shares by points: each stands for the splat whose centre is nearest, where it lies within one standard deviation
    of that along its longest axis. Splats at one centre belong together."""
    points, places, usable = _points_of(path), _places(file), np.flatnonzero(sound(file.splats))
    shares = np.zeros(len(places), np.float32)
    if not len(usable):
        return shares
    tree = scipy.spatial.cKDTree(places[usable])
    apart, nearest = tree.query(points)
    found = apart <= file.splats.scales[usable].max(axis=1)[nearest]
    if not found.any():
        raise InputError(f"none of its {len(points):,} points lies in a splat of the capture: is it in the same frame?")
    if not found.all():
        lost = int((~found).sum())
        message = f"{path}: {lost:,} of its {len(points):,} points lie in no splat of the capture, and are left out"
        warnings.warn(message, DataWarning, stacklevel=2)
    chosen = scipy.spatial.cKDTree(places[usable[np.unique(nearest[found])]])
    shares[usable[chosen.query(places[usable])[0] == 0.0]] = 1.0
    return shares


def _points_of(path: Path) -> NDArray[np.float64]:
    """The finite positions (M, 3) of a splat, or of a PLY of plain points."""
    with open(path, "rb") as content:
        ply = Ply.open(path) if content.readline(16).strip() == b"ply" else None
    names = ply.elements["vertex"].properties if ply is not None and "vertex" in ply.elements else {}
    if ply is not None and {"x", "y", "z"} <= names.keys():
        rows = ply.rows("vertex")
        points = np.stack([rows[name].astype(np.float64) for name in "xyz"], axis=1)
    else:
        splats = read_splats(path)
        points = _places(SplatFile(splats))
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise InputError(f"{path} holds no points")
    return points
