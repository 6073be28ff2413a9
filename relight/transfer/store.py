"""Results for a geometry, cached in the scene folder: files that are complete or absent.

    cache/transfer-raytraced-8-128-0.npz

Each file carries the key of its geometry and the settings as JSON: its name is for people and is never parsed. It is
checked (size and CRC of every array) while it is read. A file that does not fit, from another geometry, another version
or a torn write, counts as absent; files of older versions are removed.
"""

import contextlib
import hashlib
import json
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrayfiles import load_arrays
from splat2mesh.base.beside import Beside
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.inputs import GIB, LARGEST_TEXT
from splat2mesh.base.leftovers import sweep
from splat2mesh.base.outputs import staged_file

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene

VERSION = 7
"""Version of cached files. It increases when their format or the numbers for the same geometry and settings change."""

FOLDER = "cache"

LARGEST = 1 << 34
"""Bytes of the arrays of one file: the transfer of 5 million vertices in 10 bands has 2 GB."""


LEAST_BYTES, BYTES_PER_VERTEX, MOST_BYTES = GIB // 4, 1_100, 2 * GIB
"""Bytes of a folder's files, by the vertices of its scene, and their bounds; the newest of each kind stay whatever its
size. One light of a place takes 600 to 1,300 bytes a vertex."""

Made = TypeVar("Made")


class Cache:
    """Named arrays of one geometry in a folder. Without a folder it stores nothing and finds nothing.

    read_only: existing files are read, and nothing is written, not even the time of last use. vertices: of the scene,
    which bound the size of the folder.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str] | None = None,
        geometry: str = "",
        read_only: bool = False,
        vertices: int | None = None,
    ) -> None:
        self.folder: Path | None = None if folder is None else Path(folder)
        self._read_only = read_only
        wanted = MOST_BYTES if vertices is None else max(LEAST_BYTES, BYTES_PER_VERTEX * vertices)
        self._most_bytes = min(wanted, MOST_BYTES)
        if self.folder is not None and os.path.islink(self.folder):
            self.folder = None  # a scene from elsewhere must not have files written to a place that it names
        self._key = f"{VERSION} {geometry}"
        self._begun: dict[tuple[object, ...], Beside[dict[str, NDArray[Any]] | None]] = {}
        if self.folder is not None and not read_only:
            self._sweep()

    @classmethod
    def of_scene(cls, scene: "Scene", read_only: bool = False) -> "Cache":
        """In the folder that a Scene was loaded from; a Scene of a mesh file, or of none, keeps nothing."""
        if scene.path is None or not Path(scene.path).is_dir():
            return cls()
        return cls(Path(scene.path) / FOLDER, geometry_key(scene), read_only, len(scene.vertices))

    def begin(self, kind: str, *settings: object) -> None:
        """Begin to read what is kept under a kind and its settings, beside other work: the next `get` takes it."""
        if self.folder:
            path, text = self._path(self.folder, kind, settings), _as_json(settings)
            self._begun[(kind, *settings)] = Beside(lambda: self._read(path, text))

    def get(self, kind: str, *settings: object) -> dict[str, NDArray[Any]] | None:
        """Dict of the arrays kept under a kind and its settings, or None."""
        if (kind, *settings) in self._begun:
            return self._begun.pop((kind, *settings)).result()
        return self._read(self._path(self.folder, kind, settings), _as_json(settings)) if self.folder else None

    def restored(self, make: Callable[[dict[str, NDArray[Any]]], Made], kind: str, *settings: object) -> Made | None:
        """The result of `make` on the cached arrays, or None where it fails: then they count as absent.

        make(arrays) must check what it uses: a scene folder, with its cache, may come from anybody.
        """
        kept = self.get(kind, *settings)
        if kept is None:
            return None
        try:
            return make(kept)
        except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, MemoryError):
            return None

    def settings_of(self, kind: str) -> list[tuple[Any, ...]]:
        """[settings] of every file of a kind and this geometry, as `put` was given them; what is no number is text.

        They are the unchecked content of a file: the caller must check them.
        """
        found = [_label(path) for path in self._files() if path.name.startswith(f"{kind}-")]
        return [tuple(settings) for key, settings in filter(None, found) if key == self._key]

    def put(self, kind: str, *settings: object, **arrays: ArrayLike) -> None:
        """Keep arrays. A disk that is full or read-only costs the next run its time, not this one its result."""
        self._begun.pop((kind, *settings), None)
        if self.folder is None or not self.keeps:
            return
        with contextlib.suppress(OSError, InputError):  # the latter: another run keeps the same at the moment
            self.folder.mkdir(exist_ok=True)
            with staged_file(self._path(self.folder, kind, settings)) as staging, open(staging, "wb") as file:
                kept: dict[str, Any] = {"key": np.array(self._key), "settings": np.array(_as_json(settings)), **arrays}
                np.savez(file, **kept)  # not waited for: a torn one counts as not there
            self._fit()

    def drop(self, kind: str, *settings: object) -> None:
        """Remove what is kept under a kind and its settings, of this geometry."""
        self._begun.pop((kind, *settings), None)
        if self.folder is not None and self.keeps and tuple(settings) in self.settings_of(kind):
            with contextlib.suppress(OSError):
                self._path(self.folder, kind, settings).unlink()

    @property
    def keeps(self) -> bool:
        """Whether `put` keeps anything: what is made for it alone need not be made otherwise."""
        return bool(self.folder) and not self._read_only

    @property
    def size_bytes(self) -> int:
        """Size of all files in the folder."""
        return sum(path.stat().st_size for path in self._files())

    def clear(self) -> None:
        """Remove all that is kept in the folder, whatever geometry it is of."""
        for path in self._files():
            path.unlink(missing_ok=True)

    def _files(self) -> list[Path]:
        return sorted(self.folder.glob("*.npz")) if self.folder and os.path.isdir(self.folder) else []

    def _sweep(self) -> None:
        """Silently remove leftovers of killed runs and of older versions: they can be
        computed again. Files of newer versions, and those of other programs, stay."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            if self.folder is not None:
                sweep(self.folder)
        for path in self._files():
            version = _version(path)
            if version is not None and version < VERSION:
                with contextlib.suppress(OSError):
                    path.unlink()

    def _fit(self) -> None:
        """Remove what was not used for longest until the rest is small enough; the newest of each kind stay."""
        files = sorted(((path.stat().st_mtime, path.stat().st_size, path) for path in self._files()), reverse=True)
        newest = {path.name.split("-")[0]: path for _, _, path in reversed(files)}
        total = sum(path.stat().st_size for path in newest.values())
        for _, size, path in files:
            if path not in newest.values():
                total += size
                if total > self._most_bytes:
                    path.unlink(missing_ok=True)

    def _path(self, folder: Path, kind: str, settings: tuple[object, ...]) -> Path:
        return folder / ("-".join([kind, *map(str, settings)]) + ".npz")

    def _read(self, path: Path, settings: str) -> dict[str, NDArray[Any]] | None:
        try:
            found = load_arrays(path, LARGEST)
            if (str(found.pop("key")), str(found.pop("settings"))) != (self._key, settings):
                return None
            if not self._read_only:
                os.utime(path)
        except (OSError, ValueError, KeyError, MemoryError):  # whatever is wrong with it, it can be computed again
            return None
        return found


def _as_json(settings: tuple[object, ...]) -> str:
    """Settings as JSON."""
    return json.dumps(settings, default=str)


def _label(path: Path) -> tuple[str, list[Any]] | None:
    """(key, settings) that a file carries, or None for another program's, another version's or a torn one."""
    try:
        found = load_arrays(path, LARGEST_TEXT, ("key", "settings"))
        settings = json.loads(str(found["settings"]))
    except (OSError, InputError, ValueError, MemoryError, RecursionError):
        return None
    return (str(found["key"]), settings) if isinstance(settings, list) else None


def _version(path: Path) -> int | None:
    """The version of a file, or None for another program's or a torn one."""
    try:
        version, _, geometry = str(load_arrays(path, LARGEST_TEXT, ("key",))["key"]).partition(" ")
    except (OSError, InputError, ValueError, MemoryError):
        return None
    return int(version) if geometry and version.isascii() and version.isdigit() and len(version) < 10 else None


def geometry_key(scene: "Scene") -> str:
    """Text that differs for any two geometries: a hash of what light depends on, chunks included."""
    digest = hashlib.blake2b(digest_size=16)
    for chunk in scene.chunks:
        for array in (chunk.vertices, chunk.normals, chunk.faces):
            digest.update(str(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    if scene.capture.get("from") == "inside":  # what was seen from there of a room is free, all else is not
        digest.update(b"room" + np.asarray(scene.capture.get("eyes", ()), np.float64).tobytes())
        if scene.measured is not None and scene.measured.sky is not None:  # nor is what shows no sky a window
            digest.update(b"sky" + scene.measured.sky.bound.tobytes() + scene.measured.sky.clipped.tobytes())
    return digest.hexdigest()


def array_key(*arrays: NDArray[Any] | None) -> str:
    """Short text that differs for any two lists of arrays; None among them counts as a distinct array."""
    digest = hashlib.blake2b(digest_size=8)
    for array in arrays:
        digest.update(b"none" if array is None else str(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
