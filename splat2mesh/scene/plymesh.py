"""Triangle meshes in PLY files: every row and list that the header declares must be present before anything is made.

Polygons become triangle fans. A vertex keeps its row.
"""

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import DataWarning, InputError
from ..base.kernels import kernel
from ..splats.formats.ply import Element, Ply
from .surfaces import UncheckedMesh, fans

LISTS = ("vertex_indices", "vertex_index")

MOST_ALIKE = 64
"""Items of lists that are read at once; longer ones are no faces of a mesh that counts."""


def read_ply(path: str | os.PathLike[str]) -> UncheckedMesh:
    """Read a PLY, row by row.

    Raises InputError for one that is damaged, cut short, or no mesh. Warns with a DataWarning of one without colours
    whose texture is not read.
    """
    ply = Ply.open(path)
    names = ply.elements["vertex"].properties if "vertex" in ply.elements else {}
    if not {"x", "y", "z"} <= names.keys() or "list" in names.values():
        raise InputError(f"{path}: expected a mesh whose vertices have x, y and z, and no lists")
    if "face" not in ply.elements or not any(name in ply.elements["face"].lists for name in LISTS):
        raise InputError(f"{path}: holds no triangles; expected a triangle mesh")
    corners, counts = _check(ply)
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


def _check(ply: Ply) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Corners of all faces in a row, and the corners of each. Raises InputError where an element is cut short."""
    faces = np.zeros(0, np.int64), np.zeros(0, np.int64)
    size = os.path.getsize(ply.path) - ply.body
    body = np.memmap(ply.path, np.uint8, "r", ply.body) if size > 0 else np.zeros(0, np.uint8)
    numbers = _numbers(body) if ply.format == "ascii" else None
    start = 0
    for name, element in ply.elements.items():
        if not element.has_lists:
            width = len(element.properties) if numbers is not None else element.row_bytes
            there = len(body) if numbers is None else len(numbers)
            end = start + element.count * width
            if end > there:
                _cut_short(ply.path, name, element, max(0, there - start) // width)
            start = end
            continue
        wanted = next((key for key in LISTS if key in element.lists), None) if name == "face" else None
        if numbers is None:
            corners, counts, start = _binary_lists(ply, name, element, body, start, wanted)
        else:
            corners, counts, start = _ascii_lists(ply.path, name, element, numbers, start, wanted)
        if wanted is not None:
            faces = corners, counts
    return faces


def _numbers(body: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The numbers of an ascii body, up to the first word that is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of text that ends early: then there are too few
        try:
            return np.fromstring(body.tobytes().decode("latin-1"), np.float64, sep=" ")
        except ValueError:
            return np.zeros(0)


def _ascii_lists(
    path: Path, name: str, element: Element, numbers: NDArray[np.float64], start: int, wanted: str | None
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    kinds = np.array([kind == "list" for kind in element.properties.values()])
    which = list(element.properties).index(wanted) if wanted else -1
    # Every list takes a number at least, so that no header can announce more rows than could be there.
    if element.count * len(kinds) > len(numbers) - start:
        _cut_short(path, name, element, max(0, len(numbers) - start) // len(kinds))
    places, counts = np.zeros(element.count, np.int64), np.zeros(element.count, np.int64)
    row, end = _walk_numbers(numbers, start, kinds, which, places, counts)
    if row < element.count:
        _cut_short(path, name, element, row)
    if wanted is None:
        return places[:0], counts[:0], end
    values = numbers[_spread(places, counts)]
    with np.errstate(invalid="ignore"):
        corners = values.astype(np.int64)
    if (corners != values).any():
        raise InputError(f"{path}: a face names a vertex by {values[corners != values][0]:g}: export the mesh again")
    return corners, counts, end


def _binary_lists(
    ply: Ply, name: str, element: Element, body: NDArray[np.uint8], start: int, wanted: str | None
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    columns = []
    for key, kind in element.properties.items():
        length, item = element.lists.get(key, (None, kind))
        signed = length is not None and length[0] == "i"
        if length is not None and length[0] == "f":
            raise InputError(f"{ply.path}: a list of '{name}' counts its items in {length}: expected whole numbers")
        columns.append((np.dtype(length).itemsize if length else 0, signed, np.dtype(item).itemsize))
    if wanted is not None and len(columns) == 1:
        found = _alike(ply, element, body, start, wanted)
        if found is not None:
            return found
    layout = np.array(columns, np.int64)
    which = list(element.properties).index(wanted) if wanted else -1
    least = int(np.where(layout[:, 0] > 0, layout[:, 0], layout[:, 2]).sum())
    if element.count * least > len(body) - start:
        _cut_short(ply.path, name, element, max(0, len(body) - start) // least)
    places, counts = np.zeros(element.count, np.int64), np.zeros(element.count, np.int64)
    row, end = _walk_bytes(body, start, layout, which, ply.byte_order == ">", places, counts)
    if row < element.count:
        _cut_short(ply.path, name, element, row)
    if wanted is None:
        return places[:0], counts[:0], end
    stored = np.dtype(ply.byte_order + element.lists[wanted][1])
    each = _spread(places, counts, stored.itemsize)
    packed = body[(each[:, None] + np.arange(stored.itemsize)).ravel()] if len(each) else np.zeros(0, np.uint8)
    values = packed.view(stored)
    with np.errstate(invalid="ignore"):
        corners = values.astype(np.int64)
    if stored.kind == "f" and (corners != values).any():
        raise InputError(f"{ply.path}: a face names a vertex by a number that is not whole: export the mesh again")
    return corners, counts, end


def _alike(
    ply: Ply, element: Element, body: NDArray[np.uint8], start: int, wanted: str
) -> tuple[NDArray[np.int64], NDArray[np.int64], int] | None:
    """The same of lists of whole numbers that are all as long as the first and make up their rows, such as triangles;
    None for others. A tenth of the time."""
    length, item = (np.dtype(ply.byte_order + kind) for kind in element.lists[wanted])
    if element.count == 0 or item.kind == "f" or start + length.itemsize > len(body):
        return None
    items = int(body[start : start + length.itemsize].view(length)[0])
    width = length.itemsize + items * item.itemsize
    if not 0 < items <= MOST_ALIKE or start + element.count * width > len(body):
        return None
    row = np.dtype([("length", length), ("items", item, (items,))])
    rows = np.frombuffer(body, row, element.count, start)
    if (rows["length"] != items).any():
        return None
    counts = np.full(element.count, items, np.int64)
    return rows["items"].astype(np.int64).ravel(), counts, start + element.count * width


def _spread(places: NDArray[np.int64], counts: NDArray[np.int64], step: int = 1) -> NDArray[np.int64]:
    """Index of each item of lists that begin at `places`: (sum of counts,) int64."""
    ends = np.cumsum(counts)
    within = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - counts, counts)
    return np.repeat(places, counts) + step * within


@kernel
def _walk_numbers(
    numbers: NDArray[np.float64],
    start: int,
    kinds: NDArray[np.bool_],
    which: int,
    places: NDArray[np.int64],
    counts: NDArray[np.int64],
) -> tuple[int, int]:
    """Rows that are all there, and where the last one ends."""
    for row in range(len(places)):
        for k in range(len(kinds)):
            if start >= len(numbers):
                return row, start
            if kinds[k]:
                items = numbers[start]
                if not (0.0 <= items <= len(numbers)) or items != np.floor(items):
                    return row, start
                if k == which:
                    places[row], counts[row] = start + 1, int(items)
                start += int(items)
            start += 1
        if start > len(numbers):
            return row, start
    return len(places), start


@kernel
def _walk_bytes(
    body: NDArray[np.uint8],
    start: int,
    layout: NDArray[np.int64],
    which: int,
    big: bool,
    places: NDArray[np.int64],
    counts: NDArray[np.int64],
) -> tuple[int, int]:
    """The same in bytes. layout: (properties, 3), bytes of a list's length (0: no list), its sign, bytes of an item."""
    for row in range(len(places)):
        for k in range(len(layout)):
            size, items = layout[k, 0], np.int64(1)
            if size:
                if start + size > len(body):
                    return row, start
                items = np.int64(0)
                for b in range(size):
                    at = b if big else size - 1 - b
                    items = items << 8 | np.int64(body[start + at])
                if layout[k, 1] and items >> (8 * size - 1):
                    return row, start  # a list of fewer than no items
                if k == which:
                    places[row], counts[row] = start + size, items
            start += size + items * layout[k, 2]
            if start > len(body):
                return row, start
    return len(places), start


def _cut_short(path: Path, name: str, element: Element, found: int) -> None:
    raise InputError(
        f"{path}: broken or cut short: its header promises {element.count} rows of '{name}', {found} can be read; "
        "export the mesh again"
    )
