"""Reading untrusted files: regular files only, sizes checked against limits, and one kind of error for all failures.

No content is trusted: a header that declares more than its file can hold is refused before memory is allocated, a name
inside a file leads only into the file's own folder, and no exception of a parser gets through.
"""

import json
import os
import stat
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from .errors import InputError

MIB = 1 << 20

LARGEST_TEXT = 64 * MIB
"""Bytes of a JSON file, or a library of materials: the largest known, the tree of a streamed SOG, has 3 MB."""

GIB = MIB << 10
"""Bytes that a file may take, unpacked or as a picture, where nothing says more."""

FREE = MIB
"""Bytes, pixels, splats or nodes that any part of a file may have, however small the rest is."""

LEAST_SPLAT_BYTES = 6
"""Bytes that a splat takes, at least, where there are many: places and rotations are noise to every packer, and real
captures take 10 to 20. So a file of 32 MB announces at most 5.6 million, which a small machine can still convert."""


def file_size(path: str | os.PathLike[str], what: str = "file") -> int:
    """Bytes of a regular file. Raises InputError for missing files, folders, pipes, sockets and devices."""
    try:
        found = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"cannot read {path}: no such file, expected a {what}") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"cannot read {path}: it is a {_kind(found.st_mode)}, expected a {what}")
    return found.st_size


def is_url(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a URL, which fsspec reads."""
    return "://" in os.fspath(path)


def check_special(path: str | os.PathLike[str]) -> None:
    """Raise InputError for pipes, sockets and devices, on which a reader would wait; files, folders and missing paths
    pass."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return  # its reader gives the better message
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise InputError(f"{path} is not a regular file but a {_kind(mode)}: copy its content into a file first")


def read_json(path: str | os.PathLike[str], **how: Any) -> Any:
    """The content of a JSON file of at most LARGEST_TEXT bytes; `how` goes to json.loads. Raises InputError for
    anything but a regular file, for one too large and for invalid JSON."""
    size = file_size(path, "JSON file")
    if size > LARGEST_TEXT:
        raise InputError(f"{path} takes {size >> 20} MB, expected at most {LARGEST_TEXT >> 20} of JSON")
    try:
        return loads(Path(path).read_bytes(), **how)
    except InputError:  # of a hook
        raise
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"{path}: not valid JSON ({error})") from error


def loads(text: str | bytes, **how: Any) -> Any:
    """json.loads, with ValueError for all its exceptions: deep nesting, long numbers, bytes that are no text."""
    try:
        return json.loads(text, **how)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def check_count(path: str | os.PathLike[str], count: int, size: int, what: str = "splats") -> None:
    """Raise InputError where `count` splats, announced by a header, cannot be in so many bytes of packed data."""
    most = max(FREE, size // LEAST_SPLAT_BYTES)
    if count > most:
        raise InputError(
            f"{path} announces {count:,} {what} in {size:,} bytes, expected at most {most:,}: it is damaged, "
            "or made to fill the memory"
        )


def inside(folder: str | os.PathLike[str], name: object, named_by: str | os.PathLike[str]) -> Path:
    """The path of a file that another file names, in its folder or below. Raises InputError for a name that leads
    outside.

    folder: where the name starts. named_by: the file that holds it, for the message. Links out of the folder are
    followed: they were made on this machine.
    """
    text = str(name)
    posix, windows = PurePosixPath(text), PureWindowsPath(text)
    leads_out = posix.is_absolute() or windows.drive or windows.root or ".." in (*posix.parts, *windows.parts)
    if not isinstance(name, str) or not text or "\0" in text or "://" in text or leads_out:
        raise InputError(f"{named_by} names {text[:80]!r}, which lies outside its folder: copy the whole folder")
    return Path(folder) / posix


@contextmanager
def reading(path: str | os.PathLike[str]) -> Iterator[None]:
    """Within the block, every failure is an InputError about `path`: parsers raise dozens of types on broken input."""
    try:
        yield
    except (InputError, Warning, NameError, ImportError):  # the last two: not the fault of a file
        raise
    except OSError as error:
        name, reason = error.filename or path, error.strerror or error
        raise InputError(f"cannot read {name}: {reason}") from error
    except MemoryError as error:
        raise InputError(f"{path} needs more memory than is available: it is too large, or damaged") from error
    except Exception as error:
        reason = (str(error).splitlines() or [""])[0][:160]
        raise InputError(
            f"{path} is damaged or not what it should be ({type(error).__name__}: {reason}): copy or export it again"
        ) from error


@contextmanager
def quiet_numbers() -> Iterator[None]:
    """Within the block, numbers beyond their type silently become infinite or NaN: readers count them later."""
    import numpy as np

    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        yield


def _kind(mode: int) -> str:
    kinds = {stat.S_ISDIR: "directory", stat.S_ISFIFO: "pipe", stat.S_ISSOCK: "socket"}
    return next((name for test, name in kinds.items() if test(mode)), "device")
