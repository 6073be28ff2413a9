"""The hidden folders in which outputs grow: claimed by one run at a time, cleaned up after runs that were killed.

.NAME.unfinished/new     what is being written
.NAME.unfinished/old     the previous output, while the new one takes its place

A run holds an exclusive lock (flock) on the folder; the system releases it when the run ends, in whatever way.
"""

import os
import shutil
import warnings
from contextlib import suppress
from pathlib import Path

from .errors import DataWarning, InputError

NEW, OLD = "new", "old"
SUFFIX = ".unfinished"


class Busy(Exception):
    """Another run holds the folder."""


def workspace_of(path: Path) -> Path:
    """Return the temporary path of an output: beside it, so a rename is one step. path: of the output."""
    return path.with_name(f".{path.name}{SUFFIX}")


def claim(workspace: Path) -> int:
    """Make the folder and lock it, empty.

    Returns the lock, for `release`. Raises Busy where another run holds it. Raises InputError where something else has
    its name. Warns with a DataWarning about leftovers of a killed run, which are restored or removed first.
    """
    while True:
        try:
            workspace.mkdir()
            made = True
        except FileExistsError:
            made = False
        try:
            if not made and not _ours(workspace):
                raise InputError(f"{workspace} is in the way, and no run made it: move it, or choose another `output`")
            lock = _locked(workspace)
        except FileNotFoundError:
            continue  # it was released by another run since
        if _is_still(workspace, lock):
            break
        _close(lock)
    try:
        if any(workspace.iterdir()):
            _clean(workspace)
    except BaseException:
        _close(lock)
        raise
    return lock


def release(workspace: Path, lock: int) -> None:
    """Remove the folder, its content and its lock; a previous output that nothing has replaced is restored first. lock:
    as `claim` returned it."""
    try:
        with suppress(OSError):
            _restore(workspace)
            _empty(workspace)
            workspace.rmdir()
    finally:
        _close(lock)


def sweep(folder: Path) -> None:
    """Restore or remove what killed runs left in a folder, except folders that other runs hold. Warns with a
    DataWarning: one for each."""
    try:
        with os.scandir(folder) as entries:
            found = [entry.name for entry in entries if entry.name[0] == "." and entry.name.endswith(SUFFIX)]
    except (OSError, ValueError):  # the latter: a name that no folder can have
        return
    for name in sorted(found):
        workspace = folder / name
        try:
            if not _ours(workspace):
                continue
            lock = _locked(workspace)
        except (Busy, OSError):
            continue
        try:
            if _is_still(workspace, lock):
                _clean(workspace)
                workspace.rmdir()
        except OSError:
            pass  # the claim says what is wrong with it
        finally:
            _close(lock)


def _ours(workspace: Path) -> bool:
    """Whether it is a folder with nothing but this module's entries. Raises OSError if it is gone."""
    if workspace.is_symlink():
        return False
    try:
        return set(os.listdir(workspace)) <= {NEW, OLD}
    except NotADirectoryError:
        return False


def _clean(workspace: Path) -> None:
    """Empty a locked folder that a killed run left, with a warning."""
    restored = _restore(workspace)
    _empty(workspace)
    message = f"removed {workspace}, left by a run that was killed"
    warnings.warn(message + (f", and put {restored} back" if restored else ""), DataWarning, stacklevel=4)


def _restore(workspace: Path) -> Path | None:
    """Put a previous output back where nothing stands in its place: its path, or None."""
    target = workspace.with_name(workspace.name[1 : -len(SUFFIX)])
    if os.path.lexists(target) or not os.path.lexists(workspace / OLD):
        return None
    (workspace / OLD).rename(target)
    return target


def _empty(workspace: Path) -> None:
    """Remove what is in the folder."""
    for entry in (workspace / OLD, workspace / NEW):
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        else:
            entry.unlink(missing_ok=True)


def _locked(workspace: Path) -> int:
    """An open descriptor of the folder with a lock on it, -1 on systems without such locks. Raises Busy."""
    try:
        import fcntl
    except ImportError:
        return -1
    descriptor = os.open(workspace, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise Busy from None
    except OSError:
        pass  # a file system without locks
    return descriptor


def _is_still(workspace: Path, lock: int) -> bool:
    """Whether the locked folder is still the one at this path: another run may have removed it meanwhile."""
    if lock < 0:
        return True
    try:
        there, held = os.stat(workspace), os.fstat(lock)
    except FileNotFoundError:
        return False
    return (there.st_dev, there.st_ino) == (held.st_dev, held.st_ino)


def _close(lock: int) -> None:
    if lock >= 0:
        os.close(lock)
