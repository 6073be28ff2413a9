"""Writing results so that nothing half-written is ever left behind."""

import os
import shutil
import tempfile
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError


def check_output(path, overwrite):
    """Refuse, before any work is done, an output that exists or cannot be made.

    Raises InputError when `path` exists and `overwrite` is false, or when its parent folder cannot be written.
    """
    path = Path(path)
    if path.exists() and not overwrite:
        raise InputError(f"{path} exists already: give another name with -o, or replace it with --overwrite")
    parent = path.absolute().parent
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise InputError(f"cannot write to {parent}: choose a folder that can be written with -o")


@contextmanager
def staged_folder(path):
    """Yield a temporary folder beside `path`; it becomes `path` when the block succeeds, vanishes when it fails."""
    path = Path(path).absolute()
    path.parent.mkdir(parents=True, exist_ok=True)
    staging = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    try:
        staging.chmod(0o777 & ~_umask())
        yield staging
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.exists():
            path.unlink()
        staging.rename(path)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask
