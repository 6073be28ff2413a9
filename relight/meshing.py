"""A splat in place of a scene: it is meshed first, and its scene folder is kept."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

from splat2mesh.base.errors import InputError
from splat2mesh.scene.folder import META

if TYPE_CHECKING:
    from splat2mesh.base.progress import Stages

_SPLAT_ENDINGS = (".splat", ".spz", ".sog", ".json")
"""Of files that are never meshes."""

_HEADER_BYTES = 1 << 16


def is_splat(path: str | os.PathLike[str]) -> bool:
    """Whether a path that exists is a splat or a layout of several, told by what it holds; not whether it is sound."""
    path = Path(path)
    if path.is_dir():
        return not (path / META).is_file()
    if path.suffix.lower() in _SPLAT_ENDINGS:
        return True
    with open(path, "rb") as file:
        header = file.read(_HEADER_BYTES)
    header = header[: header.find(b"end_header")] if header.startswith(b"ply") else b""
    return b"f_dc_0" in header or b"packed_position" in header


def scene_folder(splat: str | os.PathLike[str], stages: "Stages") -> tuple[Path, list[str]]:
    """The scene folder of a splat, in the current folder, and what to tell: made now, unless it is there already.

    Raises InputError where another thing has its name, and for a splat that cannot be used.
    """
    from splat2mesh.cli import default_output, told

    splat = Path(splat)
    folder = Path(default_output(splat))
    if os.path.lexists(folder):
        _check_made_of(folder, splat)
        return folder, [f"{folder}: the scene of {splat}, made before"]
    from splat2mesh.layout import convert_layout, is_layout
    from splat2mesh.pipeline import convert

    scene = (convert_layout if is_layout(splat) else convert)(splat, stages=stages)
    with stages.stage("write"):
        scene.save(folder)
    return folder, told(scene, folder)


def planned(splat: str | os.PathLike[str]) -> Path | None:
    """The scene folder that a splat has already, or None."""
    from splat2mesh.cli import default_output

    folder = Path(default_output(Path(splat)))
    if not os.path.lexists(folder):
        return None
    _check_made_of(folder, Path(splat))
    return folder


def _check_made_of(folder: Path, splat: Path) -> None:
    """Raise InputError unless a folder is the scene of this splat as it is now."""
    from splat2mesh.scene.scene import Scene
    from splat2mesh.scene.sources import fingerprint

    advice = f"mesh it under another name: splat2mesh {splat} -o NAME; then relight NAME"
    if not (folder / META).is_file():
        raise InputError(f"{folder} exists already and is no scene folder: {advice}")
    source = Scene.load(folder).source
    same = source.get("sha256") == fingerprint(splat, source.get("lod", "auto"))
    if not same:
        raise InputError(f"{folder} is the scene of another splat, or of an older one: {advice}")
