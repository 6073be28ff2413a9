"""The hidden folders in which outputs grow: claimed by one run at a time, cleaned up after runs that were killed.

.NAME.unfinished/name    the name of the output
.NAME.unfinished/new     what is being written
.NAME.unfinished/old     the previous output, while the new one takes its place

A run holds an exclusive lock (flock) on the folder; the system releases it when the run ends, in whatever way.
"""

import hashlib
import os
import shutil
import warnings
from contextlib import suppress
from pathlib import Path

from .errors import DataWarning, InputError

NAME, NEW, OLD = "name", "new", "old"
SUFFIX = ".unfinished"
LONGEST_NAME = 255
"""Bytes of one name, on every file system in use."""


class Busy(Exception):
    """Another run holds the folder."""


def workspace_of(path: Path) -> Path:
    """Return the temporary path of an output: beside it, so a rename is one step. path: of the output."""
    stem = path.name
    if len(os.fsencode(stem)) > LONGEST_NAME - len(f".{SUFFIX}"):
        stem = hashlib.sha256(os.fsencode(stem)).hexdigest()[:32]
    return path.with_name(f".{stem}{SUFFIX}")


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
    """Remove the folder, its content and its lock. A previous output that could not be restored stays in it. lock: as
    `claim` returned it."""
    try:
        if not os.path.lexists(workspace / OLD) or _settled(workspace):
            with suppress(OSError):
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
        return set(os.listdir(workspace)) <= {NAME, NEW, OLD}
    except NotADirectoryError:
        return False


def _clean(workspace: Path) -> None:
    """Empty a locked folder that a killed run left, with a warning."""
    message = f"removed {workspace}, left by a run that was killed"
    if os.path.lexists(workspace / OLD):
        target, replaced = _target(workspace), not os.path.lexists(workspace / NEW)
        if not _settled(workspace):
            kept = _free_name(workspace.with_name(f"{target.name if target else workspace.name[1:]}.before"))
            (workspace / OLD).rename(kept)
            message += f"; the files that it was about to replace are now in {kept}"
        elif not replaced:
            message += f", and put {target} back"
    _empty(workspace)
    warnings.warn(message, DataWarning, stacklevel=4)


def _empty(workspace: Path) -> None:
    """Remove what is in the folder. The name goes last: without it the previous output would count as the only copy."""
    for entry in (workspace / OLD, workspace / NEW, workspace / NAME):
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        else:
            entry.unlink(missing_ok=True)


def _free_name(path: Path) -> Path:
    found, number = path, 1
    while os.path.lexists(found):
        number += 1
        found = path.with_name(f"{path.name}-{number}")
    return found


def _settled(workspace: Path) -> bool:
    """Whether the previous output is safe: replaced by the new one, or restored now."""
    target = _target(workspace)
    if target is None:
        return False
    if not os.path.lexists(workspace / NEW):
        return True
    if os.path.lexists(target):
        return False  # by something else: there are three, and none of them may go
    (workspace / OLD).rename(target)
    return True


def _target(workspace: Path) -> Path | None:
    try:
        name = (workspace / NAME).read_text(encoding="utf-8", errors="surrogateescape")
    except OSError:
        return None
    target = workspace.with_name(name) if name and "/" not in name and "\0" not in name else None
    return target if target is not None and workspace_of(target) == workspace else None


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
