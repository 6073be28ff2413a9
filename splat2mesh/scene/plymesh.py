"""Triangle meshes in PLY files: every row and list that the header declares must be present before anything is made.

Polygons become triangle fans. A vertex keeps its row.
"""

import os
import warnings
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..base.errors import DataWarning, InputError
from ..splats.formats.ply import Element, Ply
from .surfaces import UncheckedMesh, fans

LISTS = ("vertex_indices", "vertex_index")


def read_ply(path: str | os.PathLike[str]) -> UncheckedMesh:
    """Read a PLY, row by row. Raises InputError for one that is damaged, cut short, or no mesh. Warns with a
    DataWarning of one without colours whose texture is not read."""
    ply = Ply.open(path)
    names = ply.elements["vertex"].properties if "vertex" in ply.elements else {}
    if not {"x", "y", "z"} <= names.keys() or "list" in names.values():
        raise InputError(f"{path}: expected a mesh whose vertices have x, y and z, and no lists")
    if "face" not in ply.elements or not any(name in ply.elements["face"].lists for name in LISTS):
        raise InputError(f"{path}: holds no triangles; expected a triangle mesh")
    corners, counts = _faces(ply)
    rows: Any = ply.rows("vertex")

    def columns(*wanted: str) -> NDArray | None:
        return np.stack([rows[name] for name in wanted], axis=1) if names.keys() >= set(wanted) else None

    points, colors = columns("x", "y", "z"), columns("red", "green", "blue")
    normals = columns("nx", "ny", "nz")
    if colors is not None:  # bytes by custom, 0 to 1 where they are not whole numbers
        colors = colors.astype(np.float64) / (1.0 if colors.dtype.kind == "f" else 255.0)
    else:
        _warn_of_texture(ply)
    return UncheckedMesh(np.asarray(points, np.float64), fans(corners, counts, path), normals, colors)


def _warn_of_texture(ply: Ply) -> None:
    """Name the picture of a header that has one, as MeshLab writes it: faces hold where they lie in it."""
    with open(ply.path, "rb") as file:
        lines = file.read(ply.body).decode("latin-1").splitlines()
    named = [line.split(maxsplit=2)[2] for line in lines if line.startswith("comment TextureFile ")]
    if named:
        message = f"{ply.path}: its texture {named[0][:80]} is not read, so it is white; save it as .obj or .glb"
        warnings.warn(message, DataWarning, stacklevel=4)


class _Body:
    """What follows the header of a PLY, in units: bytes or, of an ascii file, numbers."""

    def __init__(self, ply: Ply) -> None:
        size = os.path.getsize(ply.path) - ply.body
        stored = np.memmap(ply.path, np.uint8, "r", ply.body) if size > 0 else np.zeros(0, np.uint8)
        self._ascii, self._order = ply.format == "ascii", ply.byte_order
        self.units: NDArray = _numbers(stored) if self._ascii else stored

    def width(self, code: str) -> int:
        """Units of a number of a type code."""
        return 1 if self._ascii else np.dtype(code).itemsize

    def values(self, units: NDArray, code: str) -> NDArray:
        """The numbers in some units, in a row."""
        return units.ravel() if self._ascii else np.ascontiguousarray(units).view(self._order + code).ravel()

    def items(self, at: int, code: str) -> int:
        """Items of the list that begins at a unit, -1 for what is no length."""
        if not self._ascii:
            stored = self.units[at : at + self.width(code)].tobytes()
            return int.from_bytes(stored, "big" if self._order == ">" else "little", signed=code.startswith("i"))
        found = self.units[at] if at < len(self.units) else -1.0
        return int(found) if 0.0 <= found <= len(self.units) and found == np.floor(found) else -1

    def row(self, columns: list[tuple[str, str]], at: int) -> tuple[list[tuple[int, int]], int] | None:
        """Where the items of each property of a row begin, and how many it has; and the end of the row.

        columns: type codes of the length of each list, "" for a plain number, and of its items. None where the row is
        not all there.
        """
        found = []
        for length, item in columns:
            items = self.items(at, length) if length else 1
            if items < 0:
                return None
            at += self.width(length) if length else 0
            found.append((at, items))
            at += items * self.width(item)
        return (found, at) if at <= len(self.units) else None


def _faces(ply: Ply) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Corners of all faces in a row, and the corners of each. Raises InputError where an element is cut short."""
    corners, counts, body, start = np.zeros(0), np.zeros(0, np.int64), _Body(ply), 0
    for name, element in ply.elements.items():
        columns = [element.lists.get(key, ("", kind)) for key, kind in element.properties.items()]
        if any(length.startswith("f") for length, _ in columns):
            raise InputError(f"{ply.path}: a list of '{name}' counts its items in fractions: expected whole numbers")
        # A list takes the room of its length at least, so no header can announce more rows than could be there.
        least = sum(body.width(length or item) for length, item in columns)
        if element.count * least > len(body.units) - start:
            _cut_short(ply.path, name, element, max(0, len(body.units) - start) // least)
        if not element.has_lists:
            start += element.count * least
            continue
        wanted = next((key for key in LISTS if key in element.lists), None) if name == "face" else None
        which = list(element.properties).index(wanted) if wanted else 0
        values, each, start = _lists(ply, body, columns, name, which, start)
        if wanted is not None:
            corners, counts = values, each
    with np.errstate(invalid="ignore"):
        whole = corners.astype(np.int64)
    if (whole != corners).any():
        raise InputError(
            f"{ply.path}: a face names a vertex by {corners[whole != corners][0]:g}: export the mesh again"
        )
    return whole, counts


def _lists(
    ply: Ply, body: _Body, columns: list[tuple[str, str]], name: str, which: int, start: int
) -> tuple[NDArray, NDArray[np.int64], int]:
    """The items of one list of each row, one after the other, how many each row has, and where the element ends."""
    count, code = ply.elements[name].count, columns[which][1]
    size = body.width(code)
    alike = _alike(body, columns, count, start)
    if alike is not None:
        (place, items), width = alike[0][which], alike[1] - start
        table, first = body.units[start : start + width * count].reshape(count, width), place - start
        values = body.values(table[:, first : first + items * size], code)
        return values, np.full(count, items, np.int64), start + width * count
    found = np.zeros((count, 2), np.int64)
    for number in range(count):
        row = body.row(columns, start)
        if row is None:
            _cut_short(ply.path, name, ply.elements[name], number)
        found[number], start = row[0][which], row[1]
    places, counts = found.T
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    index = (np.repeat(places, counts) + size * within)[:, None] + np.arange(size)
    return body.values(body.units[index.ravel()], code), counts, start


def _alike(
    body: _Body, columns: list[tuple[str, str]], count: int, start: int
) -> tuple[list[tuple[int, int]], int] | None:
    """The first row, as `_Body.row` finds it, where all lists are as long as its own; None otherwise."""
    first = body.row(columns, start) if count else None
    if first is None or start + count * (first[1] - start) > len(body.units):
        return None
    table = body.units[start : start + count * (first[1] - start)].reshape(count, -1)
    for (place, items), (length, _) in zip(first[0], columns, strict=True):
        end = place - start
        if length and (body.values(table[:, end - body.width(length) : end], length) != items).any():
            return None
    return first


def _numbers(body: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The numbers of an ascii body, up to the first word that is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of text that ends early: then there are too few
        try:
            return np.fromstring(body.tobytes().decode("latin-1"), np.float64, sep=" ")
        except ValueError:
            return np.zeros(0)


def _cut_short(path: Path, name: str, element: Element, found: int) -> NoReturn:
    raise InputError(
        f"{path}: broken or cut short: its header promises {element.count} rows of '{name}', {found} can be read; "
        "export the mesh again"
    )
