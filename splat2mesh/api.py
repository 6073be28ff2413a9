"""The library in one line: a splat, a layout or a city in, a scene out. One call does what one command does."""

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .base.choices import DEFAULT_FPS
from .base.errors import InputError
from .base.inputs import is_url
from .base.outputs import check_output
from .base.progress import Stages
from .layout import converted_layout, is_layout, planned_layout
from .options import ConvertOptions, TilingOptions
from .pipeline import converted, planned
from .scene.folder import META, write_folder
from .scene.scene import Scene
from .sequence import FrameMeshes
from .splats.formats.parts import METAS


@dataclass(frozen=True, eq=False)
class MeshedFiles:
    """The results of `mesh_files`. output : folder or URL. scene : Scene, None for a city in tiles. report : JSON-clean
    dict of counts, seconds and memory. notes : lines of a summary on the frames of a sequence."""

    output: str
    scene: Scene | None
    report: dict[str, Any]
    notes: tuple[str, ...] = ()


def convert(
    path: str | os.PathLike[str],
    options: ConvertOptions | None = None,
    *,
    stages: Stages | None = None,
    **changes: Any,
) -> Scene:
    """Make a scene from a trained splat, or from several that a layout places.

    Parameters
    ----------
    path : path
        Splat file of any readable format, folder of tiles, streamed SOG, or a layout `.json`.
    options : ConvertOptions, optional
        Settings; `changes` replaces fields of them.
    stages : Stages, optional
        Times the work.

    Returns
    -------
    Scene
        In the right-handed, y-up scene frame, not yet saved.

    Raises
    ------
    InputError
        For input that cannot be used.

    Examples
    --------
    >>> scene = convert("garden.ply", detail="draft", up="+y")  # doctest: +SKIP
    >>> scene.save("garden")  # doctest: +SKIP
    """
    asked = ConvertOptions.of(options, **changes)
    return (converted_layout if is_layout(path) else converted)(path, asked, stages or Stages())


def plan_mesh(
    path: str | os.PathLike[str],
    options: ConvertOptions | None = None,
    *,
    tiling: TilingOptions | None = None,
    stages: Stages | None = None,
    **changes: Any,
) -> dict[str, Any]:
    """Return what `mesh_files` would do, as a JSON-clean dict; nothing is written. Arguments and errors as there."""
    asked = ConvertOptions.of(options, **changes)
    if tiling is not None or is_url(path):
        from .tiles.city import outlook

        return outlook(path, asked, tiling, stages=stages)
    return (planned_layout if is_layout(path) else planned)(path, asked)


def mesh_files(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str] | None = None,
    options: ConvertOptions | None = None,
    *,
    tiling: TilingOptions | None = None,
    overwrite: bool = False,
    stages: Stages | None = None,
    **changes: Any,
) -> MeshedFiles:
    """Make a scene and write its folder, completely or not at all.

    Parameters
    ----------
    path : path or URL
        As for `convert`; of a city also a URL.
    output : path or URL, optional
        Scene folder. Default: `default_folder(path)`.
    options : ConvertOptions, optional
        Settings; `changes` replaces fields of them.
    tiling : TilingOptions, optional
        Work tile by tile, in bounded memory. A city takes only `lod`, `vertices`, `up` and `detail`.
    overwrite : bool
        Replace a scene folder that exists.
    stages : Stages, optional
        Times the work.

    Raises
    ------
    InputError
        For input that cannot be used, before anything is written.
    UnfinishedError
        Where tiles of a city failed and the others are done.
    """
    asked = ConvertOptions.of(options, **changes)
    target = str(output or default_folder(path))
    stages = stages or Stages()
    if tiling is not None or is_url(path):
        from .tiles.city import convert_city

        report = convert_city(path, target, asked, tiling or TilingOptions(), overwrite, stages)
        return MeshedFiles(target, None, report)
    check_output(target, overwrite, META)
    scene = convert(path, asked, stages=stages)
    with stages.stage("write"):
        scene.save(target, overwrite=overwrite)
    return MeshedFiles(target, scene, _report(scene, target, stages))


def mesh_sequence(
    folder: str | os.PathLike[str],
    output: str | os.PathLike[str] | None = None,
    options: ConvertOptions | None = None,
    *,
    fps: float = DEFAULT_FPS,
    overwrite: bool = False,
    stages: Stages | None = None,
) -> MeshedFiles:
    """Make the scene of the first of numbered splats, and a mesh of the same vertices and faces for each of them.

    Parameters
    ----------
    folder : path
        Numbered splat files of one format.
    output : path, optional
        Scene folder, which also holds `frames/NAME.glb` and `sequence.glb`. Default: `default_folder(folder)`.
    options : ConvertOptions, optional
        Settings.
    fps : float
        Frames a second of `sequence.glb`.
    overwrite : bool
        Replace a scene folder that exists.
    stages : Stages, optional
        Times the work.

    Raises
    ------
    InputError
        For a folder that is no sequence, before anything is written.

    Warns
    -----
    DataWarning
        Of frames that are missing or cannot be read.
    """
    if not (math.isfinite(fps) and fps > 0.0):
        raise InputError(f"`fps` {fps:g}: frames a second must be above 0")
    target, stages = str(output or default_folder(folder)), stages or Stages()
    check_output(target, overwrite, META)
    frames = FrameMeshes(folder, ConvertOptions.of(options), stages)
    write_folder(frames.scene, target, overwrite, lambda staged: frames.write(staged, fps))
    frames.scene.path = Path(target)
    report = _report(frames.scene, target, stages) | frames.report()
    return MeshedFiles(target, frames.scene, report, tuple(frames.lines(Path(target))))


def _report(scene: Scene, target: str, stages: Stages) -> dict[str, Any]:
    drawn = len(scene.chunks) - len(scene.hull) + len(scene.cards)
    return {"scene": target, "chunks": drawn, **scene.statistics, "seconds": stages.seconds}


def default_folder(path: str | os.PathLike[str]) -> str:
    """Return the default scene folder of a splat: the input's name, in the current folder. It never equals the input.
    Raises InputError for a file that does not exist."""
    source = Path(path)
    if not is_url(path) and not source.exists():
        raise InputError(f"{source}: no such file")
    source = source.resolve()
    if source.name in METAS:
        source = source.parent
    name = source.name.split(".")[0] or "scene"
    return f"{name}_scene" if Path(name).resolve() == source else name
