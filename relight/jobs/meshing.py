"""Mesh a splat that was given as a scene, and keep its scene folder."""

import os
from dataclasses import dataclass
from pathlib import Path

from splat2mesh.api import convert, default_folder
from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Stages
from splat2mesh.capture import Capture, capture_of
from splat2mesh.layout import is_layout
from splat2mesh.options import ConvertOptions, changed_fields
from splat2mesh.pipeline import meshed
from splat2mesh.scene.folder import META, absolute
from splat2mesh.scene.measured import FILE as MEASURED
from splat2mesh.scene.measured import Measured
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import fingerprint
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.formats.register import looks_like_splat
from splat2mesh.splats.splats import Splats
from splat2mesh.summary import summary_of

from .first_look import first_looks_alone, looks_aside

_SETTINGS = {"stand": "from"}
"""Fields of ConvertOptions with another name in scene.json."""

_UNRECORDED = ("cameras", "eyes")
"""Fields whose values scene.json does not keep."""


@dataclass(frozen=True, eq=False)
class SceneAtHand:
    """The scene of a splat, made or checked just now.

    splat: path of the splat. loaded: every row of its file, where it was read.
    """

    scene: Scene
    splat: Path
    loaded: Splats | None = None

    @property
    def folder(self) -> Path:
        """The folder of the scene."""
        assert self.scene.path is not None  # saved or loaded
        return self.scene.path

    def splats(self) -> tuple[Splats, list[Path]] | None:
        """The splats as of `source_splats`; None for a layout, whose files are others."""
        if "objects" in self.scene.source:
            return None
        path = Path(absolute(self.splat))
        loaded = read_splats(path, self.scene.source.get("lod", "auto")) if self.loaded is None else self.loaded
        return loaded, [path]


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


def scene_at_hand(
    splat: str | os.PathLike[str],
    options: ConvertOptions,
    stages: Stages,
    capture: Capture | None = None,
    folder: Path | None = None,
) -> tuple[SceneAtHand, list[str]]:
    """Return the scene of a splat, whose folder is in the current one, made if missing, and lines of a summary.

    capture: of the splat, where it was read before. folder: by another name. Raises InputError where another thing has
    its name, where the folder was made with other options, and for a splat that cannot be used.
    """
    splat = Path(splat)
    known = existing_scene(splat, options, folder)
    if known is not None:
        return known, [f"{known.folder}: the existing scene of {splat}"]
    folder = folder or Path(default_folder(splat))
    if is_layout(splat):
        scene = convert(splat, options, stages=stages)
    else:
        capture = capture_of(splat, options, stages) if capture is None else capture
        scene = meshed(splat, capture, options, stages)
    with stages.stage("write"), looks_aside(folder):
        scene.save(folder)
    if scene.measured is not None:  # rounded there
        scene.measured = Measured.load(folder / MEASURED, scene.vertex_count)
    scene.picture = scene.proxy = scene.textured = None  # whose files are never read
    return SceneAtHand(scene, splat, None if capture is None else capture.loaded), summary_of(scene, folder)


def existing_scene(
    splat: str | os.PathLike[str], options: ConvertOptions, folder: Path | None = None
) -> SceneAtHand | None:
    """Return the scene that a splat has already, or None. Arguments and errors as of `scene_at_hand`."""
    folder = folder or Path(default_folder(splat))
    if not os.path.lexists(folder) or (folder.is_dir() and first_looks_alone(folder)):
        return None
    advice = f"mesh it under another name: splat2mesh {splat} -o NAME; then relight NAME"
    if not is_scene(folder):
        raise InputError(f"{folder} exists and is not a scene folder: {advice}")
    scene = Scene.load(folder)
    if scene.source.get("sha256") != fingerprint(splat, scene.source.get("lod", "auto")):
        raise InputError(f"{folder} is the scene of another splat, or of an older one: {advice}")
    for name in changed_fields(options):
        if name in _UNRECORDED or scene.settings.get(_SETTINGS.get(name, name)) != getattr(options, name):
            raise InputError(
                f"`{name}`: it applies to meshing, and {folder} is already meshed with another or unknown value; "
                f"mesh again: splat2mesh {splat} --overwrite with that option"
            )
    return SceneAtHand(scene, Path(splat))


def refuse_meshing(scene: object, options: ConvertOptions) -> None:
    """Raise InputError for meshing options without a splat to mesh."""
    for name in changed_fields(options):
        raise InputError(
            f"`{name}`: it applies to meshing a splat, and {scene} is already a mesh; give it to splat2mesh"
        )
