"""The source splats of a scene, found again and placed in its frame."""

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..splats.formats import parts_of, read_splats
from ..splats.formats.parts import METAS
from ..splats.formats.sog import META
from ..splats.joining import joined
from ..splats.placing import placed
from ..splats.splats import Splats
from .folder import absolute
from .scene import Scene


@dataclass(frozen=True, eq=False)
class SourcePart:
    """One splat file of a scene.

    splats: every row of the file in its order, not cleaned, in the frame of the source of `Scene.scene_from_splat`.
    path: where it was found. name: of the object in its layout, or of the file. chunks: of the scene's chunks that were
    made from it.
    """

    splats: Splats
    path: Path
    name: str
    chunks: range


def source_splats(scene: Scene, path: str | os.PathLike[str] | None = None) -> tuple[Splats, list[Path]]:
    """Read the splats a scene was made from.

    path: the splat file, or for a layout its .json or the folder of its files; without it they are looked for where the
    scene says, then beside the scene folder, then in the current folder. Returns splats: in the frame that
    `scene.scene_from_splat` starts from: of a single splat that of its file, of a layout the scene frame, object after
    object. Every row of each file, in its order, not cleaned: rows may hold NaN; paths: they were read from. Raises
    InputError when one is missing or has another SHA-256, or when the scene is a plain mesh.
    """
    parts = source_parts(scene, path)
    splats = parts[0].splats if len(parts) == 1 else joined([part.splats for part in parts])
    return splats, [part.path for part in parts]


def source_parts(scene: Scene, path: str | os.PathLike[str] | None = None) -> list[SourcePart]:
    """Read the splats a scene was made from, file by file. path: as for `source_splats`. One for each object of a
    layout, in its order. Raises InputError as `source_splats` does."""
    own, entries = _entries(scene)
    if path is not None and not Path(path).exists():
        raise InputError(f"`splat` {path}: no such file or folder")
    folder = Path(path or ".")
    folder = folder if folder.is_dir() else folder.parent
    parts, read = [], {}
    for entry in entries or [own]:
        if path is None:
            candidates = _usual_places(entry, scene)
        elif entries:
            candidates = _in_folder(entry, folder, own)
        else:
            candidates = [Path(path)]
        found = _find(entry, candidates, path)
        key = found, entry["lod"]
        if key not in read:  # the same splat may stand in several places
            read[key] = read_splats(*key)
        splats = placed(read[key], entry["scene_from_splat"]) if entries else read[key]
        parts.append(SourcePart(splats, found, entry["name"], range(*entry["chunks"])))
    return parts


def describe(path: str | os.PathLike[str], lod: int | str = "auto") -> dict[str, Any]:
    """Return the record of a scene's source, by which it can be found again. lod: level of detail, as for
    `read_splats`. Returns file, sha256 and path; of a streamed SOG also lod, the number of the level."""
    found = absolute(path)
    level = parts_of(found, lod).level
    described = {"file": Path(found).name, "sha256": fingerprint(found, lod), "path": found}
    return described if level is None else described | {"lod": level}


def fingerprint(path: str | os.PathLike[str], lod: int | str = "auto") -> str:
    """Return the SHA-256 of everything that `read_splats` reads of a path, in its order. Hexadecimal. A tile that is an
    unbundled SOG counts with all files of its folder, in the order of their names."""
    digest = hashlib.sha256()
    for part in parts_of(path, lod).files:
        folder = part.parent if part.name == META else part
        for file in sorted(folder.iterdir()) if folder.is_dir() else [part]:
            if file.is_file():
                with open(file, "rb") as content:
                    while block := content.read(1 << 20):
                        digest.update(block)
    return digest.hexdigest()


def _entries(scene: Scene) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The scene's entries on its source and on each object of its layout: dict, list (empty without a layout)."""
    source = scene.source
    if "sha256" not in source:
        raise InputError(f"{scene.path or 'the scene'} is a mesh without a splat: use a scene folder")
    try:
        file, lod = str(source["file"]), source.get("lod", "auto")
        own = {**source, "file": file, "name": file, "lod": lod, "chunks": (0, len(scene.chunks))}
        entries = [_entry(entry, len(scene.chunks)) for entry in source.get("objects", [])]
        if entries:
            own["path"] = str(source["path"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{scene.path}: its source is damaged ({error!r}); convert the splat again") from error
    return own, entries


def _entry(entry: dict[str, Any], chunks: int) -> dict[str, Any]:
    first, last = (int(end) for end in entry["chunks"])
    if not 0 <= first <= last <= chunks:
        raise ValueError(f"chunks {first} to {last} of {chunks}")
    matrix = np.array(entry["scene_from_splat"], np.float64)
    texts = {name: str(entry[name]) for name in ("file", "name", "path", "sha256")}
    return {**texts, "lod": entry.get("lod", "auto"), "chunks": (first, last), "scene_from_splat": matrix}


def _usual_places(entry: dict[str, Any], scene: Scene) -> list[Path]:
    """Likely paths of an unnamed file, best first."""
    name = _own_name(entry)
    places = [Path(entry["path"])] if "path" in entry else []
    if scene.path is not None:
        places.append(Path(scene.path).resolve().parent / name)
    return [*places, Path.cwd() / name]


def _in_folder(entry: dict[str, Any], folder: Path, layout: dict[str, Any]) -> list[Path]:
    """Candidate paths of an object's file below a folder that replaces the layout's, best first."""
    from_layout = os.path.relpath(entry["path"], Path(layout["path"]).parent)
    return [Path(os.path.normpath(folder / from_layout)), folder / _own_name(entry)]


def _own_name(entry: dict[str, Any]) -> Path:
    """A relative path that identifies the file: with its folder where every SOG has the same name."""
    if entry["file"] in METAS and "path" in entry:
        return Path(Path(entry["path"]).parent.name, entry["file"])
    return Path(entry["file"])


def _find(entry: dict[str, Any], candidates: list[Path], given: str | os.PathLike[str] | None) -> Path:
    """The first candidate that is the file of `entry`; InputError where none is."""
    existing, unreadable = [path for path in candidates if path.exists()], None
    for path in existing:
        try:
            if fingerprint(path, entry["lod"]) == entry["sha256"]:
                return path
        except InputError as error:
            unreadable = unreadable or error
    if unreadable:
        raise InputError(f"{unreadable}; or {_advice(given)}") from unreadable
    if existing:
        raise InputError(
            f"{existing[0]} is not the splat that this scene was made from (its SHA-256 differs): "
            f"{_advice(given)}, or convert it again"
        )
    raise InputError(f"{candidates[0]}, which this scene was made from, does not exist: {_advice(given)}")


def _advice(given: str | os.PathLike[str] | None) -> str:
    return "name the right one by `splat`" if given is None else "`splat` must name the unchanged one"
