"""Renames without loss: one that never replaces, one that swaps two, each in a single step where possible."""

import ctypes
import errno
import functools
import os
import sys
from pathlib import Path
from typing import Any

_AT_FDCWD, _NOREPLACE, _EXCHANGE = -100, 1, 2  # linux/fcntl.h, linux/fs.h
_UNABLE = (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EPERM)
"""Errors of a kernel or file system that cannot do it, such as network file systems and some containers."""


def rename_new(source: Path, target: Path) -> None:
    """Rename to a path that does not exist.

    Raises FileExistsError if it exists; both stay unchanged.
    """
    if not _renameat2(source, target, _NOREPLACE):
        if os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(target))
        source.rename(target)  # of a folder: fails by itself where a folder that holds something stands now


def exchange(source: Path, target: Path) -> bool:
    """Swap two existing paths in one step.

    False, with both as they are, where the system cannot.
    """
    return _renameat2(source, target, _EXCHANGE)


def _renameat2(source: Path, target: Path, flags: int) -> bool:
    call = _call()
    if call is None:
        return False
    if call(_AT_FDCWD, os.fsencode(source), _AT_FDCWD, os.fsencode(target), flags) == 0:
        return True
    number = ctypes.get_errno()
    if number in _UNABLE:
        return False
    raise OSError(number, os.strerror(number), str(source), None, str(target))


@functools.cache
def _call() -> Any:
    """renameat2 of the C library: Linux has it since glibc 2.28 and musl 1.2; elsewhere None."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        call = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError):
        return None
    call.argtypes = [ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_uint]
    return call
