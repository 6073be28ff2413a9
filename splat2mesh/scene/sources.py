"""The splats that a scene was made from, found again and placed as the scene has them."""

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..base.errors import InputError
from ..splats.formats import read_splats
from ..splats.placing import joined, placed
from ..splats.splats import Splats
from .scene import Scene, absolute

_SOG_META = "meta.json"


@dataclass(frozen=True, eq=False)
class SourcePart:
    """One splat file of a scene.

    splats: Splats, every row of the file in its order, not cleaned, in the frame of `Scene.scene_from_splat`'s source.
    path: where it was found. name: of the object in its layout, or of the file. chunks: range of the scene's chunks
    that were made from it.
    """

    splats: Splats
    path: Path
    name: str
    chunks: range


def source_splats(scene: Scene, path: str | os.PathLike[str] | None = None) -> tuple[Splats, list[Path]]:
    """The splats a scene was made from: (Splats, list of the Paths they were read from).

    They stand in the frame that `scene.scene_from_splat` starts from: of a single splat that of its file, of a layout
    the scene frame, object after object. Every row of each file, in its order, not cleaned: rows may hold NaN.
    path: the splat file, or for a layout its .json or the folder of its files; without it they are looked for where
    the scene says, then beside the scene folder, then in the current folder.
    Raises InputError when one is missing or has another SHA-256, or when the scene is a plain mesh.
    """
    parts = source_parts(scene, path)
    splats = parts[0].splats if len(parts) == 1 else joined([part.splats for part in parts])
    return splats, [part.path for part in parts]


def source_parts(scene: Scene, path: str | os.PathLike[str] | None = None) -> list[SourcePart]:
    """The same, file by file: a list of SourcePart, one for each object of a layout, in its order."""
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
        if found not in read:  # the same splat may stand in several places
            read[found] = read_splats(found)
        splats = placed(read[found], entry["scene_from_splat"]) if entries else read[found]
        parts.append(SourcePart(splats, found, entry["name"], range(*entry["chunks"])))
    return parts


def describe(path: str | os.PathLike[str]) -> dict[str, str]:
    """What a scene keeps of its source file, so that it can be found again: dict of file, sha256 and path."""
    found = absolute(path)
    return {"file": Path(found).name, "sha256": fingerprint(found), "path": found}


def fingerprint(path: str | os.PathLike[str]) -> str:
    """SHA-256, as a hex string, of a file, or of all files of a folder in the order of their names.

    The meta.json of an unbundled .sog stands for its folder.
    """
    path = Path(path)
    path = path.parent if path.name == _SOG_META else path
    digest = hashlib.sha256()
    for part in sorted(path.iterdir()) if path.is_dir() else [path]:
        if part.is_file():
            with open(part, "rb") as file:
                while block := file.read(1 << 20):
                    digest.update(block)
    return digest.hexdigest()


def _entries(scene):
    """What the scene keeps of its source, and of each object of its layout: dict, list (empty without a layout)."""
    source = scene.source
    if "sha256" not in source:
        raise InputError(f"{scene.path or 'the scene'} is a plain mesh, which no splat belongs to: use a scene folder")
    try:
        own = {**source, "file": str(source["file"]), "name": str(source["file"]), "chunks": (0, len(scene.chunks))}
        entries = [_entry(entry, len(scene.chunks)) for entry in source.get("objects", [])]
        if entries:
            own["path"] = str(source["path"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{scene.path}: its source is damaged ({error!r}); convert the splat again") from error
    return own, entries


def _entry(entry, chunks):
    first, last = (int(end) for end in entry["chunks"])
    if not 0 <= first <= last <= chunks:
        raise ValueError(f"chunks {first} to {last} of {chunks}")
    matrix = np.array(entry["scene_from_splat"], np.float64)
    texts = {name: str(entry[name]) for name in ("file", "name", "path", "sha256")}
    return {**texts, "chunks": (first, last), "scene_from_splat": matrix}


def _usual_places(entry, scene):
    """Where the file may be when nobody names it, best first."""
    name = _own_name(entry)
    places = [Path(entry["path"])] if "path" in entry else []
    if scene.path is not None:
        places.append(Path(scene.path).resolve().parent / name)
    return [*places, Path.cwd() / name]


def _in_folder(entry, folder, layout):
    """Where the file of an object may be below a folder that takes the place of the layout's, best first."""
    from_layout = os.path.relpath(entry["path"], Path(layout["path"]).parent)
    return [Path(os.path.normpath(folder / from_layout)), folder / _own_name(entry)]


def _own_name(entry):
    """A relative path that tells the file from others: every unbundled SOG is called meta.json."""
    if entry["file"] == _SOG_META and "path" in entry:
        return Path(Path(entry["path"]).parent.name, _SOG_META)
    return Path(entry["file"])


def _find(entry, candidates, given):
    """The first candidate that is the file of `entry`; InputError where none is."""
    existing = [path for path in candidates if path.exists()]
    for path in existing:
        if fingerprint(path) == entry["sha256"]:
            return path
    if existing:
        raise InputError(
            f"{existing[0]} is not the splat that this scene was made from (its SHA-256 differs): "
            f"{_advice(given)}, or convert it again"
        )
    raise InputError(f"{candidates[0]}, which this scene was made from, does not exist: {_advice(given)}")


def _advice(given):
    return "name the right one by `splat`" if given is None else "`splat` must name the unchanged one"
