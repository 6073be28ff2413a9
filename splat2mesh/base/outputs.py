"""Writing results: no partial file is left behind, and no existing file is lost.

An output grows in a hidden folder beside its destination, `.NAME.unfinished`, and is renamed when it is complete. The
run that writes holds a lock on that folder; if it is killed, the lock is released, and the next run that writes there
removes the folder, or restores the output that had been moved aside (see `leftovers`).
"""

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError
from .interrupts import shielded
from .leftovers import NEW, OLD, Busy, claim, release, sweep, workspace_of

_growing: list[Path] = []  # folders that this process fills at the moment, and that appear as a whole


def check_output(path: str | os.PathLike[str], overwrite: bool, marker: str | None = None) -> None:
    """Refuse, before any work is done, an output that exists or cannot be made; clean up after runs that were killed.

    marker: name of a file that every folder written by the caller holds. Where it is given, no other folder or file
    is replaced: `-o . --overwrite` must not delete other files.
    Raises InputError when `path` exists and `overwrite` is false, when it lacks the marker and is not an empty
    folder, when its name is too long, or when its parent folder cannot be written. Warns with a DataWarning of
    leftovers of a killed run and their fate.
    """
    path = Path(path)
    _check_names(path)
    sweep(path.absolute().parent)
    _check_free(path, overwrite, marker)
    parent = path.absolute().parent
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise InputError(
            f"cannot write to {parent}, where {path} would be: choose another `output`, or make it writable"
        )


@contextmanager
def staged_folder(
    path: str | os.PathLike[str], overwrite: bool = True, marker: str | None = None, keep: bool = False
) -> Iterator[Path]:
    """Yield a temporary folder beside `path`; it becomes `path` when the block succeeds, vanishes when it fails.

    keep: existing entries of the folder at `path` that the block does not write stay; all appear in one step.

    overwrite, marker: as for `check_output`, which is checked again before the rename: an output that appeared
    meanwhile stays. The old output is moved aside first, where the next run finds it after a crash. Raises InputError
    for an output that must not be replaced, and while another run writes it.
    """
    path = Path(path).absolute()
    path.parent.mkdir(parents=True, exist_ok=True)
    with _workspace(path) as workspace:
        _growing.append(workspace / NEW)
        try:
            yield workspace / NEW
        finally:
            _growing.remove(workspace / NEW)
        if keep and path.is_dir() and not path.is_symlink():
            _carry_over(path, workspace / NEW)
        with shielded():
            _put(workspace, path, overwrite, marker)


@contextmanager
def staged_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary name, of the same ending, beside `path`; it becomes `path` on success, vanishes on failure.

    In a folder that is staged itself the name is `path`: the folder appears as a whole, and a second staging would only
    be a second thing to clean up.
    """
    path = Path(path).absolute()
    path.parent.mkdir(parents=True, exist_ok=True)
    if any(folder in path.parents for folder in _growing):
        try:
            yield path
        except BaseException:
            path.unlink(missing_ok=True)
            raise
        return
    with _workspace(path) as workspace:
        staging = workspace / NEW / path.name
        yield staging
        staging.replace(path)


@contextmanager
def _workspace(path: Path) -> Iterator[Path]:
    """The claimed folder beside `path`, with an empty NEW in it; removed when the block ends, however it ends."""
    workspace, lock = workspace_of(path), None

    def vanish() -> None:
        nonlocal lock
        with shielded():
            if lock is not None:
                release(workspace, lock)
                lock = None

    try:
        try:
            with shielded():
                try:
                    lock = claim(workspace)
                except Busy:
                    raise InputError(
                        f"another run is writing {path}: wait for it, or choose another `output`"
                    ) from None
                (workspace / NEW).mkdir()
            yield workspace
        finally:
            vanish()
    finally:
        vanish()  # where a signal came between the end of the block and the shield; the same wish comes but once


def _put(workspace: Path, path: Path, overwrite: bool, marker: str | None) -> None:
    """Rename the complete output to its place."""
    staging, replaced = workspace / NEW, workspace / OLD
    _check_free(path, overwrite, marker)
    if os.path.lexists(path):
        path.rename(replaced)
    try:
        staging.rename(path)  # fails where a folder that holds something has appeared meanwhile
    except BaseException:
        if os.path.lexists(replaced) and not os.path.lexists(path):
            replaced.rename(path)
        raise


def _carry_over(old: Path, new: Path) -> None:
    """Add to a folder the entries that only another folder has: files as hard links, if possible."""
    for entry in os.scandir(old):
        target = new / entry.name
        if entry.is_dir(follow_symlinks=False):
            if not os.path.lexists(target):
                target.mkdir()
            if target.is_dir():
                _carry_over(Path(entry.path), target)
        elif not os.path.lexists(target):
            try:
                os.link(entry.path, target, follow_symlinks=False)
            except (OSError, NotImplementedError):  # a file system without hard links
                shutil.copy2(entry.path, target, follow_symlinks=False)


def _check_free(path: Path, overwrite: bool, marker: str | None) -> None:
    if not os.path.lexists(path):
        return
    if not overwrite:
        raise InputError(f"{path} exists already: choose another `output`, or replace it with `overwrite`")
    ours = marker is None or (path / marker).is_file() or (path.is_dir() and not any(path.iterdir()))
    if not ours:
        raise InputError(f"{path} holds no {marker}, so `overwrite` does not replace it: choose another `output`")


def _check_names(path: Path) -> None:
    if "\0" in str(path):
        raise InputError("`output` contains a NUL character")
    try:
        os.lstat(workspace_of(path.absolute()))
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise InputError(f"`output` {path.name[:40]}... is too long a name for a file") from None
