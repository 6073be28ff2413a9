"""The materials of OBJ files: `Kd` and `map_Kd` of MTL libraries, as colours of corners.

Both are sRGB, as the colours of vertices in OBJ files are. Source: Wavefront, "MTL material format" (1995).
"""

import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.errors import MOST_NAMED, DataWarning, InputError
from ..base.inputs import LARGEST_TEXT, file_size, inside, reading
from .color import linear_from_srgb, srgb_from_linear
from .gltftextures import MOST_TEXELS, MappedTexture, decoded

_ARGUMENTS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-texres": 1, "-bm": 1, "-imfchan": 1, "-boost": 1}
_ARGUMENTS |= {"-mm": 2, "-type": 1}
_VECTORS = "-o", "-s", "-t"
"""Options of a picture, and how many words follow; of a vector one to three numbers."""


class Material(NamedTuple):
    """color: sRGB, or None. picture: name of a file, or None. scale, offset: of its texture coordinates."""

    color: tuple[float, float, float] | None = None
    picture: str | None = None
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


class Materials:
    """The materials of an OBJ's libraries by their names, in the order of the files. path: of the OBJ."""

    def __init__(self, path: Path, libraries: Iterable[str]) -> None:
        self._path = path
        self._lost: dict[str, str] = {}
        self.named: dict[str, Material] = {}
        for library in libraries:
            for name, material in self._read(library).items():
                self.named.setdefault(name, material)

    def colors(self, names: Sequence[str | None], chosen: NDArray[np.int64], uv: NDArray) -> NDArray | None:
        """(N, 3) sRGB of corners, None where no material has any; warns about what cannot be read.

        names: of materials, None for none. chosen: (N,) of these. uv: (N, 2), v up from the last row; not a number
        where a corner has none. Unknown materials are white.
        """
        if self.named:
            self._lost |= {name: "in no library" for name in names if name is not None and name not in self.named}
        looks = [Material() if name is None else self.named.get(name, Material()) for name in names]
        found = np.ones((len(chosen), 3))
        for number, look in enumerate(looks):
            rows = np.flatnonzero(chosen == number)
            if len(rows):
                found[rows] = self._of(look, uv[rows])
        if self._lost:
            some = [f"{name} ({reason})" for name, reason in list(self._lost.items())[:MOST_NAMED]]
            more = f" and {len(self._lost) - len(some)} more" * (len(self._lost) > len(some))
            message = f"{self._path}: colours of {len(self._lost)} materials or pictures cannot be read"
            warnings.warn(f"{message}: {', '.join(some)}{more}", DataWarning, stacklevel=4)
        return None if set(looks) == {Material()} else srgb_from_linear(found)

    def _of(self, material: Material, uv: NDArray) -> NDArray:
        plain = linear_from_srgb(np.clip(np.array(material.color or (1.0, 1.0, 1.0)), 0.0, 1.0))
        pixels = None if material.picture is None else self._picture(material.picture)
        if pixels is None:
            return np.tile(plain, (len(uv), 1))
        place = uv * material.scale + material.offset
        texels = MappedTexture(pixels, place, (0, 0)).color(np.stack([place[:, 0], 1.0 - place[:, 1]], axis=1))
        without = np.isnan(uv).any(axis=1)
        # Programs that paint by a picture alone write black beside it.
        return np.where(without[:, None], plain, texels * (plain if plain.any() else 1.0))

    def _picture(self, name: str) -> NDArray | None:
        try:
            file = inside(self._path.parent, name, self._path)
            file_size(file, "picture")
            with reading(file):
                found = decoded(file.read_bytes(), MOST_TEXELS, self._path)
        except InputError as error:
            self._lost[name] = _reason(error)
            return None
        if found is None:
            self._lost[name] = "another kind of picture"
        return found

    def _read(self, library: str) -> dict[str, Material]:
        try:
            file = inside(self._path.parent, library, self._path)
            if file_size(file) > LARGEST_TEXT:
                raise InputError("too large")
            lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
        except (InputError, OSError) as error:
            self._lost[library] = _reason(error)
            return {}
        found: dict[str, Material] = {}
        name = None
        for line in lines:
            words = line.split()
            if words[:1] == ["newmtl"]:
                name = " ".join(words[1:])
                found.setdefault(name, Material())
            elif name is not None and words[:1] in (["Kd"], ["map_Kd"]):
                try:
                    found[name] = _changed(found[name], words)
                except (ValueError, IndexError):
                    self._lost[f"{name} in {library}"] = line.strip()[:40]
        return found


def _changed(material: Material, words: list[str]) -> Material:
    """A material with what a line adds. Raises ValueError or IndexError for one that makes no sense."""
    if words[0] == "Kd":
        numbers = [float(word) for word in words[1:4]]
        red, green, blue = numbers if len(numbers) == 3 else 3 * numbers[:1]
        if not np.isfinite([red, green, blue]).all():
            raise ValueError(words)
        return material._replace(color=(red, green, blue))
    rest, vectors = words[1:], {"-s": [1.0, 1.0], "-o": [0.0, 0.0], "-t": []}
    while rest[0] in _ARGUMENTS or rest[0] in _VECTORS:
        option = rest.pop(0)
        if option in _ARGUMENTS:
            rest = rest[_ARGUMENTS[option] :]
            continue
        numbers = []
        while len(numbers) < 3 and len(rest) > 1 and _is_number(rest[0]):
            numbers.append(float(rest.pop(0)))
        vectors[option] = [*numbers[:2], *vectors[option][len(numbers) :]]
    (a, b), (c, d) = vectors["-s"], vectors["-o"]
    return material._replace(picture=" ".join(rest).replace("\\", "/"), scale=(a, b), offset=(c, d))


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False


def _reason(error: Exception) -> str:
    """The end of a message, which says what is wrong with a file and not which."""
    return str(error).partition("\n")[0].rpartition(": ")[2][:80]
