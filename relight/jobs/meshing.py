"""Mesh a splat that was given as a scene, and keep its scene folder."""

import os
from pathlib import Path

from splat2mesh.api import convert, default_folder
from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Stages
from splat2mesh.capture import Capture
from splat2mesh.options import ConvertOptions, changed_fields
from splat2mesh.pipeline import meshed
from splat2mesh.scene.folder import META
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import fingerprint
from splat2mesh.splats.formats.register import looks_like_splat
from splat2mesh.summary import summary_of

from .first_look import first_looks_alone, looks_aside

_SETTINGS = {"stand": "from"}
"""Fields of ConvertOptions with another name in scene.json."""

_UNRECORDED = ("cameras", "eyes")
"""Fields whose values scene.json does not keep."""


def is_scene(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a scene folder."""
    return (Path(path) / META).is_file()


def of_splats(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a splat, or a scene folder made of one. Raises InputError for a missing path."""
    if not os.path.lexists(path):
        raise InputError(f"{path}: no such file")
    return is_scene(path) or is_splat(path)


def is_splat(path: str | os.PathLike[str]) -> bool:
    """Whether an existing path is a splat or a layout of several, by its content; does not validate it."""
    path = Path(path)
    if path.is_dir():
        return not (path / META).is_file()
    return path.suffix.lower() == ".json" or looks_like_splat(path)


def scene_folder(
    splat: str | os.PathLike[str], options: ConvertOptions, stages: Stages, capture: Capture | None = None
) -> tuple[Path, list[str]]:
    """Return the scene folder of a splat, in the current folder, made if missing, and lines of a summary.

    capture: of the splat, where it was read before. Raises InputError where another thing has its name, where the
    folder was made with other options, and for a splat that cannot be used.
    """
    splat = Path(splat)
    folder = existing_folder(splat, options)
    if folder is not None:
        return folder, [f"{folder}: the existing scene of {splat}"]
    folder = Path(default_folder(splat))
    scene = convert(splat, options, stages=stages) if capture is None else meshed(splat, capture, options, stages)
    with stages.stage("write"), looks_aside(folder):
        scene.save(folder)
    return folder, summary_of(scene, folder)


def existing_folder(splat: str | os.PathLike[str], options: ConvertOptions) -> Path | None:
    """Return the scene folder that a splat has already, or None. Errors as of `scene_folder`."""
    folder = Path(default_folder(splat))
    if not os.path.lexists(folder) or (folder.is_dir() and first_looks_alone(folder)):
        return None
    settings = _check_made_of(folder, Path(splat))
    for name in changed_fields(options):
        if name in _UNRECORDED or settings.get(_SETTINGS.get(name, name)) != getattr(options, name):
            raise InputError(
                f"`{name}`: it applies to meshing, and {folder} is already meshed with another or unknown value; "
                f"mesh again: splat2mesh {splat} --overwrite with that option"
            )
    return folder


def refuse_meshing(scene: object, options: ConvertOptions) -> None:
    """Raise InputError for meshing options without a splat to mesh."""
    for name in changed_fields(options):
        raise InputError(
            f"`{name}`: it applies to meshing a splat, and {scene} is already a mesh; give it to splat2mesh"
        )


def _check_made_of(folder: Path, splat: Path) -> dict[str, object]:
    """Return the settings of a folder. Raises InputError unless it is the scene of this splat as it is now."""
    advice = f"mesh it under another name: splat2mesh {splat} -o NAME; then relight NAME"
    if not (folder / META).is_file():
        raise InputError(f"{folder} exists and is not a scene folder: {advice}")
    scene = Scene.load(folder)
    same = scene.source.get("sha256") == fingerprint(splat, scene.source.get("lod", "auto"))
    if not same:
        raise InputError(f"{folder} is the scene of another splat, or of an older one: {advice}")
    return scene.settings
