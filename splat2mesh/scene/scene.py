"""The scene folder: what splat2mesh writes and relight lights.

scene.json          schema version, source, frames, bounds, settings, statistics, chunk list
chunks/0000.ply     float position, float normal, uchar sRGB colour, triangles
background.npy      rows of the source's splats that are far background, where there are any
preview.png         the splat and the mesh side by side
measured.npz        the sky that was captured, and what is a volume rather than a surface (see `measured`)
"""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.outputs import check_output, staged_folder
from ..base.version import VERSION
from .chunks import DEFAULT_MAX_VERTICES, split
from .color import linear_from_srgb
from .measured import FILE as MEASURED
from .measured import Measured
from .mesh import Mesh
from .meshfile import read_mesh, write_mesh_ply

SCHEMA_VERSION = 1
META = "scene.json"
BACKGROUND = "background.npy"
PICTURE = "preview.png"


@dataclass
class Scene:
    """A chunked triangle mesh in the scene frame: right-handed, y up, unit of the splat.

    chunks: list of Mesh. scene_from_splat: (4, 4) float64, from the splat file's frame to this one.
    preview_camera: dict of eye, target, up ((3,) in the scene frame) and fov_deg, or None.
    source: dict of `file`, its name, `sha256` and `path`, of a streamed SOG also `lod`, the level read; for a layout
        also `objects`, each a dict of these and `name`, `scene_from_splat` (4 x 4, rows first) and `chunks`, the range
        [first, last) of those made from it.
        Paths are absolute here; scene.json has them relative to its folder, so that both can be moved together.
    settings, statistics: dicts kept in scene.json. path: the folder or file it was loaded from, or None.
    background: list of Mesh, what the capture shows far away: drawn, never lit, and no shadow falls from it.
    background_splats: (M,) int64 rows of the source's splats that are far background; of a layout none are kept.
    capture: dict of what the splat tells of its capture, kept in scene.json: `from` (inside, outside or both), `eyes`
        ((3,) places in the scene frame where it was seen from within) and `focal_px`; empty where unknown.
    measured: what was measured on the splats beyond the surface, or None.
    picture: (H, W, 3) uint8, the splat and the mesh side by side, which `save` writes as preview.png; never read.

    A Scene does not change once its arrays have been looked at: `vertices`, `normals`, `faces`, `colors_srgb` and
    `colors_linear` are put together on first use, kept, and read-only.
    """

    chunks: list[Mesh]
    scene_from_splat: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    preview_camera: dict[str, Any] | None = None
    source: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    statistics: dict[str, Any] = field(default_factory=dict)
    path: Path | None = None
    background: list[Mesh] = field(default_factory=list)
    background_splats: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    capture: dict[str, Any] = field(default_factory=dict)
    measured: Measured | None = None
    picture: NDArray[np.uint8] | None = None

    @classmethod
    def from_mesh(cls, mesh: Mesh, max_chunk_vertices: int = DEFAULT_MAX_VERTICES, **fields: Any) -> "Scene":
        """A scene from one Mesh in the scene frame, cut into chunks."""
        return cls(split(mesh, max_chunk_vertices), **fields)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Scene":
        """Read a scene folder, or any mesh file as a scene of one chunk in its own vertex order.

        Raises InputError for anything else, for a broken folder and for a newer schema version.
        """
        path = Path(path)
        if not path.exists():
            raise InputError(f"{path}: no such scene folder or mesh file")
        if path.is_file():
            return cls([read_mesh(path)], path=path)
        entries, fields = _read_meta(path / META)
        chunks: list[Mesh] = []
        background: list[Mesh] = []
        for name, is_background, *expected in entries:
            mesh = read_mesh(path / "chunks" / name)
            found = [len(mesh.vertices), len(mesh.faces)]
            if found != expected:
                raise InputError(
                    f"{path / 'chunks' / name}: holds {found[0]} vertices and {found[1]} faces, "
                    f"{META} says {expected[0]} and {expected[1]}; convert the splat again"
                )
            (background if is_background else chunks).append(mesh)
        if (path / BACKGROUND).is_file():
            fields["background_splats"] = _read_rows(path / BACKGROUND)
        if (path / MEASURED).is_file():
            fields["measured"] = Measured.load(path / MEASURED, sum(len(chunk.vertices) for chunk in chunks))
        return cls(chunks, path=path, background=background, **fields)

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the scene folder; it appears complete or not at all.

        Raises InputError when `path` exists, unless it is a scene folder and may be overwritten.
        """
        check_output(path, overwrite, META)
        with staged_folder(path) as folder:
            (folder / "chunks").mkdir()
            entries = []
            for index, chunk in enumerate([*self.chunks, *self.background]):
                name = f"{index:04d}.ply"
                write_mesh_ply(folder / "chunks" / name, chunk)
                counts = {"vertices": len(chunk.vertices), "faces": len(chunk.faces)}
                entries.append({"file": name, **counts, "bounds": _bounds(chunk.vertices).tolist()})
                if index >= len(self.chunks):
                    entries[-1]["background"] = True
            if len(self.background_splats):
                np.save(folder / BACKGROUND, self.background_splats.astype(np.int64))
            if self.measured is not None:
                self.measured.save(folder / MEASURED)
            if self.picture is not None:
                import imageio.v3 as iio

                iio.imwrite(folder / PICTURE, self.picture)
            meta = {
                "schema_version": SCHEMA_VERSION,
                "version": VERSION,
                "source": _with_paths(self.source, lambda file: _relative(file, path)),
                "scene_from_splat": np.asarray(self.scene_from_splat).tolist(),
                "bounds": self.bounds.tolist(),
                "preview_camera": self.preview_camera,
                "capture": self.capture,
                "measured": None if self.measured is None else self.measured.described(),
                "settings": self.settings,
                "statistics": self.statistics,
                "chunks": entries,
            }
            (folder / META).write_text(json.dumps(meta, indent=1) + "\n", encoding="utf-8")
        self.path = Path(path)

    @property
    def is_place(self) -> bool:
        """Whether the capture looked from within: a room, a garden, a street."""
        return self.capture.get("from") in ("inside", "both")

    @property
    def vertex_count(self) -> int:
        """V, over all chunks."""
        return sum(len(chunk.vertices) for chunk in self.chunks)

    @cached_property
    def vertices(self) -> NDArray[np.float32]:
        """(V, 3), chunk after chunk."""
        return _read_only(np.concatenate([chunk.vertices for chunk in self.chunks]))

    @cached_property
    def normals(self) -> NDArray[np.float32]:
        """(V, 3), chunk after chunk."""
        return _read_only(np.concatenate([chunk.normals for chunk in self.chunks]))

    @cached_property
    def colors_srgb(self) -> NDArray[np.uint8]:
        """(V, 3) in 0..255, chunk after chunk."""
        return _read_only(np.concatenate([chunk.colors_srgb for chunk in self.chunks]))

    @cached_property
    def colors_linear(self) -> NDArray[np.float32]:
        """(V, 3) in [0, 1], linear: `colors_srgb` as light."""
        return _read_only(linear_from_srgb(self.colors_srgb.astype(np.float32) / np.float32(255.0)))

    @cached_property
    def faces(self) -> NDArray[np.int32]:
        """(F, 3) into `vertices`."""
        offsets = np.cumsum([0] + [len(chunk.vertices) for chunk in self.chunks[:-1]])
        shifted = [chunk.faces + offset for chunk, offset in zip(self.chunks, offsets, strict=True)]
        return _read_only(np.concatenate(shifted, dtype=np.int32))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3): lowest and highest corner."""
        return _bounds(self.vertices)

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal."""
        return float(np.linalg.norm(np.diff(self.bounds, axis=0)))

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: the fields alone, not what is put together of them."""
        return {each.name: getattr(self, each.name) for each in fields(self)}


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.setflags(write=False)
    return array


def _read_rows(path: Path) -> NDArray[np.int64]:
    try:
        rows = np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise InputError(f"{path}: damaged ({error}); convert the splat again") from error
    if rows.ndim != 1 or rows.dtype != np.int64:
        raise InputError(f"{path}: expected a list of int64 rows, found {rows.dtype} of shape {rows.shape}")
    return rows


def _bounds(vertices: NDArray[np.float32]) -> NDArray[np.float64]:
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64)


def _with_paths(source: dict[str, Any], change: Callable[[str], str]) -> dict[str, Any]:
    """A copy of a source whose paths, its own and those of its objects, went through `change`."""
    source = dict(source)
    if "path" in source:
        source["path"] = change(source["path"])
    if "objects" in source:
        source["objects"] = [_with_paths(entry, change) for entry in source["objects"]]
    return source


def _relative(file: str, folder: str | os.PathLike[str]) -> str:
    """A file's path from a folder, with slashes; links among the folders are followed, so that `..` leads back."""
    file = absolute(file)
    try:
        return Path(os.path.relpath(file, os.path.realpath(folder))).as_posix()
    except ValueError:  # on another drive
        return Path(file).as_posix()


def absolute(file: str | os.PathLike[str], folder: str | os.PathLike[str] = ".") -> str:
    """A path from a folder as text, absolute: links among its folders are followed, that of the file itself is not."""
    whole = Path(os.path.realpath(folder), file)
    return os.path.normpath(Path(os.path.realpath(whole.parent), whole.name))


def _read_meta(path: Path) -> tuple[list[Any], dict[str, Any]]:
    """Of scene.json: [file, whether background, vertices, faces] of each chunk, and the Scene's other fields."""
    if not path.is_file():
        raise InputError(f"{path.parent}: not a scene folder (it has no {META}); make one with splat2mesh")
    try:
        meta = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: not valid JSON ({error}); convert the splat again") from error
    version = meta.get("schema_version") if isinstance(meta, dict) else None
    if not isinstance(version, int):
        raise InputError(f"{path}: has no schema_version, so it is not a scene of this tool")
    if version > SCHEMA_VERSION:
        raise InputError(f"{path}: schema version {version}, this tool reads up to {SCHEMA_VERSION}; update the tool")
    required = ("chunks", "scene_from_splat", "preview_camera", "source", "settings", "statistics")
    missing = [name for name in required if name not in meta]
    if missing or not meta["chunks"]:
        raise InputError(f"{path}: lacks {', '.join(missing) or 'chunks'}; convert the splat again")
    try:
        entries = [
            [str(entry["file"]), bool(entry.get("background")), entry["vertices"], entry["faces"]]
            for entry in meta["chunks"]
        ]
        if all(is_background for _, is_background, *_ in entries):
            raise ValueError("only background chunks")
        fields = {"capture": dict(meta.get("capture", {})), **{name: meta[name] for name in required[2:]}}
        fields["source"] = _with_paths(meta["source"], lambda file: absolute(file, path.parent))
        fields["scene_from_splat"] = np.array(meta["scene_from_splat"], np.float64).reshape(4, 4)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged ({error!r}); convert the splat again") from error
    return entries, fields
