"""Triangle meshes in OBJ files. Source: Wavefront, "Object Files (.obj)".

Every line of a mesh must be valid, and every corner must name an existing vertex. Corners that hold the same are one
vertex, in the order in which faces first use them.
"""

import os
from pathlib import Path
from typing import Any

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
    points, colors = _places(path, parsed.places)
    # Row -1 of texture coordinates and normals, which no corner of a file can name, stands for none.
    texels, normals = (_padded(rows, missing) for rows, missing in ((parsed.texels, np.nan), (parsed.normals, 0.0)))
    known = len(points), max(len(parsed.texels), 1), max(len(parsed.normals), 1)
    if len(corners) and ((corners < [0, -1, -1]).any() or (corners >= known).any()):
        raise InputError(f"{path}: a face names a vertex beyond the {len(points)} there are; export it again")
    place, texel, normal = corners.T
    points, moved = centred(points)
    colors = None if colors is None else colors[place]
    if colors is None and painted and len(corners):
        named = list(parsed.materials)
        materials = Materials(path, parsed.libraries if any(named) else [])
        colors = materials.colors(named, np.repeat(parsed.material_of, counts), texels[texel, :2])
    row, corner = joined(np.arange(len(corners)), points[place], normals[normal], colors)
    return UncheckedMesh(
        points[place[row]],
        fans(corner, counts, path),
        normals[normal[row]] if parsed.normals else None,
        None if colors is None else colors[row],
        moved,
    )


class _Parsed:
    """Lines of an OBJ, by keyword. places, texels, normals: lists of lists of float. corners: three numbers for each,
    from 0: place, texel, normal, -1 for none. counts: corners of each face. materials: names as they are used, None
    before the first, with their numbers. material_of: number of the material of each face. libraries: names of
    files."""

    def __init__(self, path: Path) -> None:
        self.places: list[list[float]] = []
        self.texels: list[list[float]] = []
        self.normals: list[list[float]] = []
        self.corners: list[int] = []
        self.counts: list[int] = []
        self.materials: dict[str | None, int] = {None: 0}
        self.material_of: list[int] = []
        self.libraries: list[str] = []
        self._known: dict[str, tuple[int, ...]] = {}
        self._material = 0
        readers: dict[str, Any] = {
            "v": lambda words: self.places.append([float(word) for word in words[:7]]),
            "vt": lambda words: self.texels.append([float(word) for word in words[:3]]),
            "vn": lambda words: self.normals.append([float(word) for word in words[:3]]),
            "f": self._face,
            "usemtl": self._use,
            "mtllib": lambda words: self.libraries.append(" ".join(words)),
        }
        text = ""
        with open(path, encoding="utf-8", errors="replace") as file:
            for number, line in enumerate(file, 1):
                if line.endswith("\\\n"):
                    text += line[:-2] + " "
                    continue
                words = (text + line).split()
                text = ""
                if words and words[0] in readers:
                    try:
                        readers[words[0]](words[1:])
                    except (ValueError, OverflowError):
                        shown = " ".join(words)[:60].encode("ascii", "backslashreplace").decode()
                        raise InputError(f"{path}: line {number} makes no sense: '{shown}'") from None

    def _use(self, words: list[str]) -> None:
        self._material = self.materials.setdefault(" ".join(words), len(self.materials))

    def _face(self, words: list[str]) -> None:
        for word in words:
            corner = self._known.get(word)
            if corner is None:
                corner = self._corner(word)
            self.corners.extend(corner)
        self.counts.append(len(words))
        self.material_of.append(self._material)

    def _corner(self, word: str) -> tuple[int, ...]:
        numbers = [int(part) if part else None for part in word.split("/")]
        if len(numbers) > 3 or not numbers[0] or 0 in numbers:
            raise ValueError(word)
        counts = len(self.places), len(self.texels), len(self.normals)
        found = []
        for number, count in zip([*numbers, None, None][:3], counts, strict=True):
            if number is not None and count + number < 0:
                raise ValueError(word)
            found.append(-1 if number is None else min(number - 1, 2**40) if number > 0 else count + number)
        corner = tuple(found)
        if "-" not in word:
            self._known[word] = corner
        return corner


def _places(path: Path, rows: list[list[float]]) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """(N, 3) points of lines of 3 numbers, 4 with a weight, 6 or 7 with a colour; (N, 3) colours or None."""
    found = {len(row) for row in rows}
    wrong = found - {3, 4, 6, 7}
    if wrong:
        raise InputError(f"{path}: a 'v' line holds {min(wrong)} numbers, expected 3, 4 or 6")
    points = np.array([row[:3] for row in rows], np.float64).reshape(-1, 3)
    if 4 in found:
        weight = np.array([row[3] if len(row) == 4 else 1.0 for row in rows])
        with np.errstate(all="ignore"):
            points = points / np.where(weight == 0.0, 1.0, weight)[:, None]
    if not found & {6, 7}:
        return points, None
    colors = np.array([row[-3:] if len(row) >= 6 else (1.0, 1.0, 1.0) for row in rows], np.float64)
    return points, colors / 255.0 if colors.max() > 1.0 else colors


def _padded(rows: list[list[float]], missing: float) -> NDArray[np.float64]:
    """(N + 1, 3) of rows of 1 to 3 numbers, absent ones 0, with a row of missing values after the last."""
    return np.array([*([*row, 0.0, 0.0][:3] for row in rows), [missing] * 3], np.float64)
