"""The scene folder: a Scene on disk, complete or absent, with a checksum for every file.

scene.json          schema version, source, frames, bounds, settings, statistics, chunk list
chunks/0000.ply     float position, float normal, uchar sRGB colour, triangles
hull/0000.ply       the same, of leaves and grass that are not drawn, if any: light is found there
background.npy      rows of the source's splats that are far background, if any
preview.png         the splat and the mesh side by side
proxy.glb           collision mesh, on request (see `splat2mesh.proxy`)
mesh.glb            the textured scene, on request (see `splat2mesh.texture`)
measured.npz        the captured sky, and which parts are a volume rather than a surface (see `measured`)
frames/NAME.glb     the mesh at each frame of a sequence, and sequence.glb, which plays them (see `splat2mesh.sequence`)
"""

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
from numpy.typing import NDArray

from ..base.arrayfiles import load_array
from ..base.errors import InputError
from ..base.inputs import file_size, inside, read_json
from ..base.outputs import check_output, staged_folder
from ..base.strictjson import text_of
from ..base.version import VERSION
from .measured import FILE as MEASURED
from .measured import Measured
from .mesh import Mesh
from .meshfile import read_mesh, write_mesh_ply

SCHEMA_VERSION, WITHOUT_LEAVES = 3, 2
"""3 has a hull or cards of leaves; a scene without is written as 2, which earlier readers know."""

SUMMED = (
    "source",
    "scene_from_splat",
    "bounds",
    "preview_camera",
    "capture",
    "settings",
    "statistics",
    "chunks",
    "files",
)
"""Keys that the checksum of scene.json covers: all that a program reads from it."""

META = "scene.json"
HULL = "hull"
"""Folder, and key of scene.json, of the chunks that are not drawn."""

BACKGROUND = "background.npy"
BESIDE = BACKGROUND, MEASURED
PICTURE = "preview.png"
PROXY = "proxy.glb"
TEXTURED = "mesh.glb"


def read_folder(path: Path) -> tuple[list[Mesh], list[Mesh], dict[str, Any]]:
    """Read a scene folder. Returns chunks; background; fields: the other fields of the Scene. Raises InputError where
    anything is broken, or differs from its checksum, and for another schema version."""
    meta = _checked_meta(path / META)
    kinds: dict[str, list[Mesh]] = {"chunks": [], "background": [], "cards": [], HULL: []}
    try:
        if _sum(meta) != meta.get("sha256"):
            raise _changed(path / META)
        hull = meta.get(HULL, [])
        for entry, folder in [(entry, "chunks") for entry in meta["chunks"]] + [(entry, HULL) for entry in hull]:
            file = inside(path / folder, entry["file"], path / META)
            mesh = read_mesh(file, in_place=True)
            _check_file(file, entry["sha256"])
            kinds[next((name for name in ("background", "cards") if entry.get(name)), folder)].append(mesh)
        chunks, numbers = kinds["chunks"], tuple(int(entry["chunk"]) for entry in hull)
        for number, mesh in zip(numbers, kinds[HULL], strict=True):
            chunks.insert(number, mesh)
        fields = {name: meta[name] for name in ("preview_camera", "capture", "settings", "statistics")}
        fields |= {HULL: numbers, "cards": kinds["cards"]}
        fields["source"] = _with_paths(meta["source"], lambda file: absolute(file, path))
        fields["scene_from_splat"] = np.array(meta["scene_from_splat"], np.float64).reshape(4, 4)
        for name in BESIDE:
            if name in meta["files"]:
                _check_file(path / name, meta["files"][name])
        if BACKGROUND in meta["files"]:
            fields["background_splats"] = _read_rows(path / BACKGROUND)
        if MEASURED in meta["files"]:
            fields["measured"] = Measured.load(path / MEASURED, sum(len(chunk.vertices) for chunk in chunks))
    except InputError:
        raise
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path / META}: damaged ({error!r}); convert the splat again") from error
    return chunks, kinds["background"], fields


def write_folder(
    scene: Any,
    path: str | os.PathLike[str],
    overwrite: bool = False,
    add: Callable[[Path], object] = lambda folder: None,
) -> None:
    """Write a scene folder; it appears complete or not at all. overwrite: whether a scene folder that is there may be
    replaced. add: writes further files into it. Raises InputError when `path` exists, unless it is a scene folder and
    may be overwritten."""
    check_output(path, overwrite, META)
    with staged_folder(path, overwrite, META) as folder:
        entries, hull = _write_chunks(folder, scene)
        if len(scene.background_splats):
            np.save(folder / BACKGROUND, scene.background_splats.astype(np.int64))
        if scene.measured is not None:
            scene.measured.save(folder / MEASURED)
        picture = None if scene.picture is None else iio.imwrite("<bytes>", scene.picture, extension=".png")
        for name, content in ((PICTURE, picture), (PROXY, scene.proxy), (TEXTURED, scene.textured)):
            if content is not None:
                (folder / name).write_bytes(content)
        meta = {
            "schema_version": SCHEMA_VERSION if scene.hull or scene.cards else WITHOUT_LEAVES,
            "version": VERSION,
            "source": _with_paths(scene.source, lambda file: _relative(file, path)),
            "scene_from_splat": np.asarray(scene.scene_from_splat).tolist(),
            "bounds": bounds_of(scene.vertices).tolist(),
            "preview_camera": scene.preview_camera,
            "capture": scene.capture,
            "measured": None if scene.measured is None else scene.measured.described(),
            "settings": scene.settings,
            "statistics": scene.statistics,
            "chunks": entries,
            **({HULL: hull} if hull else {}),
            "files": {name: sha256_of(folder / name) for name in BESIDE if (folder / name).is_file()},
        }
        meta = json.loads(text_of(meta))  # as a reader finds it
        meta["sha256"] = _sum(meta)
        (folder / META).write_text(text_of(meta, indent=1) + "\n", encoding="utf-8")
        add(folder)


def _write_chunks(folder: Path, scene: Any) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Write the meshes of a scene; the entries of those that are drawn, and of the hull."""
    drawn = [chunk for number, chunk in enumerate(scene.chunks) if number not in scene.hull]
    entries = _written(folder / "chunks", [*drawn, *scene.background, *scene.cards])
    for index, entry in enumerate(entries[len(drawn) :]):
        entry["background" if index < len(scene.background) else "cards"] = True
    hull = _written(folder / HULL, [scene.chunks[number] for number in scene.hull]) if scene.hull else []
    for entry, number in zip(hull, scene.hull, strict=True):
        entry["chunk"] = number
    return entries, hull


def _written(folder: Path, meshes: list[Mesh]) -> list[dict[str, Any]]:
    """Write meshes into a new folder; their entries in scene.json."""
    folder.mkdir()
    entries: list[dict[str, Any]] = []
    for index, mesh in enumerate(meshes):
        name = f"{index:04d}.ply"
        write_mesh_ply(folder / name, mesh)
        entry = {"file": name, "vertices": len(mesh.vertices), "faces": len(mesh.faces)}
        entries.append(entry | {"bounds": bounds_of(mesh.vertices).tolist(), "sha256": sha256_of(folder / name)})
    return entries


def bounds_of(vertices: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the lowest and highest corner of points (V, 3) float32: (2, 3) float64."""
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64)


def _read_rows(path: Path) -> NDArray[np.int64]:
    try:
        rows = load_array(path)
    except ValueError as error:
        raise InputError(f"{path}: damaged ({error}); convert the splat again") from error
    if rows.ndim != 1 or rows.dtype != np.int64:
        raise InputError(f"{path}: expected a list of int64 rows, found {rows.dtype} of shape {rows.shape}")
    return rows


def _with_paths(source: dict[str, Any], change: Callable[[str], str]) -> dict[str, Any]:
    """A copy of a source whose paths, its own and those of its objects, went through `change`."""
    source = dict(source)
    if "path" in source:
        source["path"] = change(source["path"])
    if "objects" in source:
        source["objects"] = [_with_paths(entry, change) for entry in source["objects"]]
    return source


def _relative(file: str, folder: str | os.PathLike[str]) -> str:
    """A file's path from a folder, with slashes; links among the folders are followed, so `..` leads back."""
    file = absolute(file)
    try:
        return Path(os.path.relpath(file, os.path.realpath(folder))).as_posix()
    except ValueError:  # on another drive
        return Path(file).as_posix()


def absolute(file: str | os.PathLike[str], folder: str | os.PathLike[str] = ".") -> str:
    """Return a path from a folder as text, absolute. folder: where a relative path starts. Links among its folders are
    followed, that of the file itself is not."""
    whole = Path(os.path.realpath(folder), file)
    return os.path.normpath(Path(os.path.realpath(whole.parent), whole.name))


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a regular file. Hexadecimal. Raises InputError for what is no regular file."""
    file_size(path, "file of a scene")
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _sum(meta: dict[str, Any]) -> str:
    """SHA-256 of what scene.json says, whatever its spaces and the order of its keys. Paths of the source are left out:
    they may be repaired by hand, and their targets have separate checksums."""
    fields = {name: meta.get(name) for name in SUMMED} | {name: meta[name] for name in [HULL] if name in meta}
    source = dict(fields["source"] or {})
    source.pop("path", None)
    if "objects" in source:
        source["objects"] = [{key: each[key] for key in each if key != "path"} for each in source["objects"]]
    return hashlib.sha256(json.dumps(fields | {"source": source}, sort_keys=True).encode()).hexdigest()


def _check_file(file: Path, expected: str) -> None:
    if sha256_of(file) != expected:
        raise _changed(file)


def _changed(path: Path) -> InputError:
    advice = "copy the folder again, or convert the splat again"
    return InputError(f"{path}: damaged or changed since it was written (its SHA-256 differs): {advice}")


_REQUIRED = ("chunks", "scene_from_splat", "source", "files", "sha256")


def _checked_meta(path: Path) -> dict[str, Any]:
    """The content of a scene.json of this schema, with all entries that every scene has."""
    if not path.is_file():
        raise InputError(f"{path.parent}: not a scene folder (it has no {META}); make one with splat2mesh")
    meta = read_json(path)
    version = meta.get("schema_version") if isinstance(meta, dict) else None
    if not isinstance(version, int):
        raise InputError(f"{path}: has no schema_version, so it is not a scene of this tool")
    if version > SCHEMA_VERSION:
        raise InputError(f"{path}: schema version {version}, this tool reads up to {SCHEMA_VERSION}; update the tool")
    if version < WITHOUT_LEAVES:
        raise InputError(f"{path}: schema version {version} is no longer read; convert the splat again")
    missing = [name for name in _REQUIRED if name not in meta]
    if missing or not meta["chunks"]:
        raise InputError(f"{path}: lacks {', '.join(missing) or 'chunks'}; convert the splat again")
    return meta
