"""Writing results so that nothing half-written is ever left behind."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError


def check_output(path: str | os.PathLike[str], overwrite: bool, marker: str | None = None) -> None:
    """Refuse, before any work is done, an output that exists or cannot be made.

    marker: name of a file that every folder written by the caller holds. Where it is given, no other folder or file
    is replaced: `-o . --overwrite` must not delete what somebody keeps there.
    Raises InputError when `path` exists and `overwrite` is false, when it lacks the marker and is not an empty
    folder, or when its parent folder cannot be written.
    """
    path = Path(path)
    if os.path.lexists(path):
        if not overwrite:
            raise InputError(f"{path} exists already: give another `output`, or replace it by `overwrite`")
        ours = marker is None or (path / marker).is_file() or (path.is_dir() and not any(path.iterdir()))
        if not ours:
            raise InputError(f"{path} holds no {marker}, so `overwrite` spares it: give another `output`")
    parent = path.absolute().parent
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise InputError(f"cannot write to {parent}: choose an `output` that can be written")


@contextmanager
def staged_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary folder beside `path`; it becomes `path` when the block succeeds, vanishes when it fails.

    What stood at `path` is moved aside first and deleted last, so that a crash at any moment loses neither.
    """
    path = Path(path).absolute()
    path.parent.mkdir(parents=True, exist_ok=True)
    workspace = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    staging, replaced = workspace / "new", workspace / "old"
    try:
        staging.mkdir()
        yield staging
        if os.path.lexists(path):
            path.rename(replaced)
        staging.rename(path)
    finally:
        if os.path.lexists(replaced) and not os.path.lexists(path):
            replaced.rename(path)
        shutil.rmtree(workspace, ignore_errors=True)


@contextmanager
def staged_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary name beside `path`; it becomes `path` on success and vanishes on failure."""
    path = Path(path).absolute()
    path.parent.mkdir(parents=True, exist_ok=True)
    staging = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield staging
        staging.replace(path)
    finally:
        staging.unlink(missing_ok=True)
