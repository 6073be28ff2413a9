"""Compiled code where nothing can be written: containers, service users. Numba refuses to start without a cache folder.

Scene folders are writable, but unsafe for it: Numba caches code, and a scene may come from anybody.
"""

import os
import sys
import warnings
from pathlib import Path

from .errors import DataWarning

PACKAGES = Path(__file__).resolve().parents[2]


def allow_read_only_install() -> None:
    """Switch Numba's cache off, with a DataWarning, if it finds no folder for it. For a command."""
    if any(map(_writable, _folders())):
        return
    from numba.core.dispatcher import Dispatcher

    Dispatcher.enable_caching = lambda dispatcher: None  # type: ignore[method-assign,assignment]
    warnings.warn(
        "found no writable folder for compiled code, so every run compiles it again, which takes a minute: "
        "set NUMBA_CACHE_DIR to a writable folder",
        DataWarning,
        stacklevel=2,
    )


def _folders() -> list[Path]:
    """Numba's candidates for its cache folder, in order."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    beside = PACKAGES / "splat2mesh" / "render" / "__pycache__"
    home = Path("~").expanduser()
    local = os.environ.get("LOCALAPPDATA") or str(home)
    caches = {"darwin": home / "Library/Caches", "win32": Path(local)}
    own = caches.get(sys.platform, Path(os.environ.get("XDG_CACHE_HOME") or str(home / ".cache")))
    return [*([Path(given)] if given else []), beside, own / "numba"]


def _writable(folder: Path) -> bool:
    """Whether a file can be made in a folder, which is made where it is missing, as Numba does."""
    import tempfile

    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except (OSError, RuntimeError):
        return False
