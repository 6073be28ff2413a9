"""Which requests have a first look, shown before a splat is meshed, and the folders that hold nothing else."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from splat2mesh.base.errors import InputError
from splat2mesh.scene.folder import META

from ..light import CAPTURED
from ..request import RelightRequest
from .earlier_results import is_first_look

RELIT = "relit"
"""Folder of results in that of a scene."""


def has_first_look(request: RelightRequest) -> bool:
    """Whether the picture of a request can be shown in advance: under an environment alone."""
    lighting = request.lighting
    plain = not (lighting.changes_captured_light or request.inserted or request.animated or request.day)
    shown = request.formats is None or "png" in request.formats
    return plain and shown and request.albedo in (None, "estimated") and CAPTURED not in request.envs


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
    folder.rename(aside)
    try:
        yield
    finally:
        if folder.is_dir():
            (aside / RELIT).rename(folder / RELIT)
            aside.rmdir()
        else:
            aside.rename(folder)


def refuse(request: RelightRequest) -> None:
    """Raise InputError for a request whose quick result there is not."""
    if not has_first_look(request):
        raise InputError("`quick`: it shows a splat under an environment, without lamps, objects or moving things")
