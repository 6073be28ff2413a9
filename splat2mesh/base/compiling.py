"""Compiled code without a writable folder, as in containers. Numba refuses to start without a cache folder.

Scene folders are writable, but unsafe for it: Numba caches code, and a scene may come from anybody.
"""

import hashlib
import os
import sys
import tempfile
import warnings
from pathlib import Path

from .errors import DataWarning

PACKAGES = Path(__file__).resolve().parents[2]


KERNELS = PACKAGES / "splat2mesh" / "render"
"""A folder of modules with kernels, for which it is tried where a cache can be written."""


def allow_read_only_install() -> None:
    """Switch Numba's cache off, with a DataWarning, if it finds no folder for it. For a command."""
    if any(_writable(folder) for folder in _folders(KERNELS)):
        return
    from numba.core.dispatcher import Dispatcher

    Dispatcher.enable_caching = lambda dispatcher: None  # type: ignore[method-assign,assignment]
    warnings.warn(
        "found no writable folder for compiled code, so every run compiles it again, which takes a minute: "
        "set NUMBA_CACHE_DIR to a writable folder",
        DataWarning,
        stacklevel=2,
    )


def _folders(modules: Path) -> list[Path]:
    """Numba's candidates for the cache of a folder of modules, in order."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    home = Path("~").expanduser()
    local = os.environ.get("LOCALAPPDATA") or str(home)
    caches = {"darwin": home / "Library/Caches", "win32": Path(local)}
    own = caches.get(sys.platform, Path(os.environ.get("XDG_CACHE_HOME") or str(home / ".cache"))) / "numba"
    name = f"{modules.name}_{hashlib.sha1(str(modules).encode(), usedforsecurity=False).hexdigest()}"
    return [*([Path(given) / name] if given else []), modules / "__pycache__", own / name]


def _writable(folder: Path) -> bool:
    """Whether a file can be made in a folder, made if missing, as Numba does."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except (OSError, RuntimeError):
        return False
