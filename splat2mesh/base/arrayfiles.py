"""Reading NumPy's .npy and .npz files: each fault is a ValueError, and nothing is unpickled."""

import lzma
import os
import zipfile
import zlib
from collections.abc import Collection
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from .inputs import file_size

_PACKED = (EOFError, OSError, SyntaxError, OverflowError, TypeError, NotImplementedError, RuntimeError, KeyError)


def load_array(path: str | os.PathLike[str]) -> Any:
    """The array of a .npy file. Raises InputError for anything but a regular file, ValueError for one without a plain
    array. The header is checked against the size of the file first, and nothing is unpickled."""
    size = file_size(path, ".npy file")
    try:
        with _parsing():
            mapped = np.load(path, mmap_mode="r", allow_pickle=False)  # maps no more than there is
        if not isinstance(mapped, np.ndarray):
            raise ValueError("it holds several arrays, expected one .npy")
        return np.array(mapped)
    except Exception as error:  # the header is Python source, over which a dozen types are raised
        raise ValueError(f"{error} ({size} bytes)") from None


def load_arrays(path: str | os.PathLike[str], most: int, names: Collection[str] | None = None) -> dict[str, Any]:
    """The arrays of an .npz file, or those of some names alone, of at most `most` bytes unpacked. Raises ValueError for
    a file without arrays, or without all of the names."""
    file_size(path, ".npz file")
    try:
        with zipfile.ZipFile(path) as packed:
            entries = packed.infolist()
            size = sum(each.file_size for each in entries if names is None or each.filename[: -len(".npy")] in names)
            if size > most:
                raise ValueError(f"it announces {size:,} bytes, expected at most {most:,}")
        with _parsing(), np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in (file.files if names is None else names)}
    except (*_PACKED, zipfile.BadZipFile, zlib.error, lzma.LZMAError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None


def _parsing() -> AbstractContextManager[Any]:
    """numba's lock, for headers of arrays: Python before 3.11.8 can fail where two threads parse source
    (python/cpython#106905), and both a header and a compiled kernel are parsed."""
    from numba.core.compiler_lock import global_compiler_lock

    return global_compiler_lock
