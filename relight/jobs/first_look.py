"""Which requests have a first look, shown before a splat is meshed, and the folders that hold nothing else."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

from splat2mesh.base.errors import InputError
from splat2mesh.scene.folder import META

from ..light import CAPTURED
from ..request import RelightRequest
from .earlier_results import is_first_look

RELIT = "relit"
"""Folder of results in that of a scene."""


def has_first_look(request: RelightRequest) -> bool:
    """Whether a picture is wanted that can be shown in advance."""
    return _plain(request) and (request.formats is None or "png" in request.formats)


def _plain(request: RelightRequest) -> bool:
    """Whether a request shows a capture under environments alone."""
    changes = request.lighting.changes_captured_light or request.inserted or request.animated or request.day
    return not changes and request.albedo in (None, "estimated") and CAPTURED not in request.envs


def first_looks_alone(folder: Path) -> bool:
    """Whether an existing folder has nothing but first looks: its scene was not meshed yet."""
    if (folder / META).exists() or {entry.name for entry in folder.iterdir()} != {RELIT}:
        return False
    return all(is_first_look(results) for results in (folder / RELIT).iterdir())


@contextmanager
def looks_aside(folder: Path) -> Iterator[None]:
    """Move first looks out of the folder of a scene while that is written, then into it."""
    if not (folder.is_dir() and first_looks_alone(folder)):
        yield
        return
    aside = folder.with_name(f".{folder.name}.looks")
    shutil.rmtree(aside, ignore_errors=True)  # of a run that was killed
    folder.rename(aside)
    try:
        yield
    finally:
        if folder.is_dir():
            (aside / RELIT).rename(folder / RELIT)
            aside.rmdir()
        else:
            aside.rename(folder)


HEEDED = {"scene", "env", "lighting", "angles_deg", "sun", "at", "north_deg", "albedo", "capture_env", "exposure_ev"}
HEEDED |= {"formats", "caching", "meshing", "output", "overwrite", "quick"}
"""Fields of a request that a first look obeys, or that change nothing in it."""


def refuse(request: RelightRequest) -> None:
    """Raise InputError for a request whose quick result there is not."""
    if not _plain(request):
        raise InputError("`quick`: it shows a splat under an environment, without lamps, objects or moving things")
    for each in fields(request):
        if each.name not in HEEDED and getattr(request, each.name) != each.default:
            raise InputError(f"`{each.name}`: a first look does not heed it; leave out `quick`")
    if "captured_light" in request.lighting.said:
        raise InputError("`captured_light`: a first look has no folder of a scene; leave out `quick`")
    if not {*(request.formats or ())} <= {"png", "splat"}:
        raise InputError("`formats`: a first look has png and splat alone; leave out `quick`")


def discard(results: Path, scene: Path) -> None:
    """Remove the first look in a folder of results, where its scene could not be meshed, and what is empty then."""
    if is_first_look(results):
        shutil.rmtree(results)
    for folder in (scene / RELIT, scene):
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
