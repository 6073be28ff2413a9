"""Triangle meshes in OBJ and OFF files. Source: Wavefront, "Object Files (.obj)"; Geomview, "OFF Files".

Every line of a mesh must be valid, and every corner must name an existing vertex. Vertices of an OBJ are
in the order in which faces first use them, material by material (see `_materials`).
"""

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from .mtl import Materials
from .surfaces import UncheckedMesh, centred, fans, joined


def read_obj(path: str | os.PathLike[str], painted: bool = True) -> UncheckedMesh:
    """Read an OBJ.

    painted: whether vertices without colours take those of materials. Raises InputError for a line that makes no sense
    and for a corner that names nothing. Warns with a DataWarning about materials and pictures that cannot be read.
    """
    path = Path(path)
    parsed = _Parsed(path)
    corners, counts = np.array(parsed.corners, np.int64).reshape(-1, 3), np.array(parsed.counts, np.int64)
    places = _rows(path, parsed.places, (3, 4, 6, 7), "v")
    known = len(places[0]), max(len(parsed.texels), 1), max(len(parsed.normals), 1)
    # A missing texture coordinate or normal is row -1, which no corner of a file can name.
    if len(corners) and ((corners < [0, -1, -1]).any() or (corners >= known).any()):
        raise InputError(f"{path}: a face names a vertex beyond the {known[0]} there are; export it again")
    materials = Materials(path, parsed.libraries if any(parsed.materials) else [])
    mesh = np.repeat(_by_material(materials, parsed), counts)
    formats = 2 * (corners[:, 2] >= 0) + 4 * (corners[:, 1] >= 0)
    faces = np.repeat(np.arange(len(counts)), counts)
    # The fourth number of a corner is the look of its material, where that is seen.
    seen = painted and places[1] is None
    looks, look = materials.looks(parsed.materials)
    of_corner = look[np.array(parsed.pieces, np.int64)[faces]] if seen else np.zeros(len(corners), np.int64)
    corners = np.concatenate([corners, of_corner[:, None]], axis=1)
    found, row = _assembled(path, corners, counts, faces, mesh, formats, places, parsed)
    if seen and len(found.points):
        uv = np.concatenate([_loose(parsed.texels)[:, :2], np.full((1, 2), np.nan)])
        found = found._replace(colors=materials.colors(looks, row[:, 3], uv[row[:, 1]]))
    return found


def _assembled(
    path: Path,
    corners: NDArray[np.int64],
    counts: NDArray[np.int64],
    face_of_corner: NDArray[np.int64],
    mesh: NDArray[np.int64],
    formats: NDArray[np.int64],
    places: tuple[NDArray[np.float64], NDArray[np.float64] | None],
    parsed: "_Parsed",
) -> tuple[UncheckedMesh, NDArray[np.int64]]:
    """Join the corners of each mesh that hold the same, mesh after mesh; and the corner (V, 4) of each vertex."""
    points, colors = places
    points, moved = centred(points)
    texels, normals = (_padded(_loose(rows)) for rows in (parsed.texels, parsed.normals))
    groups = np.zeros(len(counts), np.int64)
    groups[face_of_corner] = mesh
    # A mesh of one material is one for each kind of vertex in it: without normals first, as its pieces are.
    kinds = np.zeros(len(counts), np.int64)
    piece = np.array(parsed.pieces, np.int64)
    for kind in (2, 4):
        has = np.zeros(piece.max(initial=0) + 1, bool)
        has[piece[face_of_corner[(formats & kind) > 0]]] = True
        kinds += kind * has[piece]
    of_object = np.array(parsed.objects, np.int64)[piece]
    order = np.lexsort((np.arange(len(counts)), piece, of_object, kinds, groups))
    starts = np.cumsum(counts) - counts
    rows, faces, first = [], [], 0
    key = groups[order] * 8 + kinds[order]
    for part in np.split(order, np.flatnonzero(np.diff(key)) + 1) if len(order) else []:
        each = counts[part]
        within = np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each)
        own = corners[np.repeat(starts[part], each) + within]
        triples, triple = np.unique(own, axis=0, return_inverse=True)
        held = [points[triples[:, 0]], normals[triples[:, 2]], texels[triples[:, 1]]]
        held.append(colors[triples[:, 0]] if colors is not None else triples[:, 3:])
        row, corner = joined(triple.reshape(-1), *held)
        rows.append(triples[row])
        faces.append(fans(corner, each, path) + first)
        first += len(row)
    if not rows:
        return UncheckedMesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64)), corners
    row = np.concatenate(rows)
    named = normals[row[:, 2]] if parsed.normals else None
    colors = colors[row[:, 0]] if colors is not None else None
    return UncheckedMesh(points[row[:, 0]], np.concatenate(faces), named, colors, moved), row


class _Parsed:
    """Lines of an OBJ, by keyword.

    places, texels, normals: lists of lists of float. corners: three numbers for each, from 0: place, texel, normal, -1
    for none. counts: corners of each face. pieces: number of the piece that each face belongs to; pieces begin at
    groups, objects and materials. materials: name of the material of each piece, or None. objects: number of the object
    of each piece. libraries: names of files.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.places: list = []
        self.texels: list = []
        self.normals: list = []
        self.corners: list = []
        self.counts: list = []
        self.pieces: list = []
        self.materials: list = [None]
        self.libraries: list = []
        self._known: dict = {}
        self.objects: list = [0]
        self._objects: list = [""]
        self._group, self._object, self._filled = "", 0, False
        self._material: str | None = None
        number, text = 0, ""
        with open(path, encoding="utf-8", errors="replace") as file:
            for number, line in enumerate(file, 1):
                if line.endswith("\\\n"):
                    text += line[:-2] + " "
                    continue
                words = (text + line).split()
                text = ""
                if words:
                    try:
                        self._line(words)
                    except (ValueError, OverflowError):
                        shown = " ".join(words)[:60].encode("ascii", "backslashreplace").decode()
                        raise InputError(f"{path}: line {number} makes no sense: '{shown}'") from None

    def _line(self, words: list[str]) -> None:
        kind = words[0]
        if kind == "v":
            self.places.append([float(word) for word in words[1:8]])
        elif kind == "f":
            self._face(words[1:])
        elif kind == "vn":
            self.normals.append([float(word) for word in words[1:4]])
        elif kind == "vt":
            self.texels.append([float(word) for word in words[1:4]])
        elif kind == "g":
            name = " ".join(words[1:]) or "default"
            if name != self._group:
                self._group = name
                self._begin_object(name)
        elif kind == "o":
            name = " ".join(words[1:])
            if name in self._objects:  # it goes on, with what is still being filled
                self._object = self._objects.index(name)
            else:
                self._begin_object(name)
        elif kind == "usemtl":
            self._material = " ".join(words[1:])
            if self.materials[-1] is None or not self._filled:
                self.materials[-1] = self._material
            elif self.materials[-1] != self._material:
                self._begin(self._material)
        elif kind == "mtllib":
            self.libraries.append(" ".join(words[1:]))

    def _begin_object(self, name: str) -> None:
        self._object = len(self._objects)
        self._objects.append(name)
        self._begin(self._material)

    def _begin(self, material: str | None) -> None:
        self.materials.append(material)
        self.objects.append(self._object)
        self._filled = False

    def _face(self, words: list[str]) -> None:
        for word in words:
            corner = self._known.get(word)
            if corner is None:
                corner = self._corner(word)
            self.corners.extend(corner)
        self.counts.append(len(words))
        self.pieces.append(len(self.materials) - 1)
        self._filled = True

    def _corner(self, word: str) -> tuple[int, int, int]:
        parts = word.split("/")
        numbers = [int(part) if part else None for part in parts]
        if len(numbers) > 3 or not numbers[0] or 0 in numbers:
            raise ValueError(word)
        counts = len(self.places), len(self.texels), len(self.normals)
        found = []
        for number, count in zip([*numbers, None, None][:3], counts, strict=True):
            if number is None:
                found.append(-1)
            elif number > 0:
                found.append(min(number - 1, 2**40))
            elif count + number < 0:
                raise ValueError(word)
            else:
                found.append(count + number)
        corner = found[0], found[1], found[2]
        if "-" not in word:
            self._known[word] = corner
        return corner


def _by_material(materials: Materials, parsed: _Parsed) -> NDArray[np.int64]:
    """For each face, the place of its material among those of the libraries, then those that no library has, in the
    order of their use. In a file with larger polygons all count as one."""
    if max(parsed.counts, default=3) > 3 or all(name is None for name in parsed.materials):
        return np.zeros(len(parsed.counts), np.int64)
    order = {name: number for number, name in enumerate(materials.named)}
    for name in parsed.materials:
        if name is not None:
            order.setdefault(name, len(order))
    number = np.array([0 if name is None else order[name] for name in parsed.materials], np.int64)
    return number[np.array(parsed.pieces, np.int64)]


def _rows(
    path: Path, rows: list[list[float]], widths: tuple[int, ...], kind: str
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """(N, 3) points of lines of 3 numbers, 4 with a weight, 6 or 7 with a colour; (N, 3) colours or None."""
    found = {len(row) for row in rows}
    if found - set(widths):
        raise InputError(f"{path}: a '{kind}' line holds {min(found - set(widths))} numbers, expected 3, 4 or 6")
    points = np.array([row[:3] for row in rows], np.float64).reshape(-1, 3)
    if 4 in found:
        weight = np.array([row[3] if len(row) == 4 else 1.0 for row in rows])
        with np.errstate(all="ignore"):
            points = points / np.where(weight == 0.0, 1.0, weight)[:, None]
    if not found & {6, 7}:
        return points, None
    colors = np.array([row[-3:] if len(row) >= 6 else (1.0, 1.0, 1.0) for row in rows], np.float64)
    return points, colors / 255.0 if colors.max() > 1.0 else colors


def _loose(rows: list[list[float]]) -> NDArray[np.float64]:
    """(N, 3) of rows of 1 to 3 numbers, the missing ones 0."""
    return np.array([[*row, 0.0, 0.0, 0.0][:3] for row in rows], np.float64).reshape(-1, 3)


def _padded(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows with one of zeros after the last, which is row -1."""
    return np.concatenate([rows, np.zeros((1, 3))])


def read_off(path: str | os.PathLike[str]) -> UncheckedMesh:
    """Read an OFF file, also with colours (COFF) or normals (NOFF, CNOFF), row by row.

    Raises InputError for a file that is none, or cut short.
    """
    with open(path, encoding="latin-1") as file:
        lines = (line.partition("#")[0].split() for line in file)
        words = [line for line in lines if line]
    head = words[0][0].upper() if words else ""
    if head not in ("OFF", "COFF", "NOFF", "CNOFF"):
        raise InputError(f"{path} is not an OFF file: its first line must be OFF, COFF, NOFF or CNOFF")
    counts = words[0][1:] or words[1]
    rows = words[1 if words[0][1:] else 2 :]
    vertices, faces = (int(word) for word in counts[:2])
    width = 3 + 3 * ("N" in head) + (4 if "C" in head else 0)
    if not 0 <= vertices + faces <= len(rows) or min(vertices, faces) < 0:
        raise InputError(f"{path}: cut short: it announces {vertices} vertices and {faces} faces in {len(rows)} lines")
    table = np.array([row[:width] for row in rows[:vertices]], np.float64).reshape(vertices, width)
    corners: list[int] = []
    each = []
    for row in rows[vertices : vertices + faces]:
        count = int(row[0])
        if not 0 <= count <= len(row) - 1:
            raise InputError(f"{path}: a face of {count} corners names {len(row) - 1}: export it again")
        corners += map(int, row[1 : 1 + count])
        each.append(count)
    triangles = fans(np.array(corners, np.int64), np.array(each, np.int64), path)
    normals = table[:, 3:6] if "N" in head else None
    colors = table[:, -4:-1] if "C" in head else None
    if colors is not None and colors.max(initial=0.0) > 1.0:
        colors = colors / 255.0
    return UncheckedMesh(table[:, :3], triangles, normals, colors)
