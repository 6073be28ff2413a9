"""Compiled code without a writable folder, as in containers. Numba refuses to start without a cache folder.

Scene folders are writable, but unsafe for it: Numba caches code, and a scene may come from anybody.
"""

import warnings

from .errors import DataWarning


def allow_read_only_install() -> None:
    """Switch Numba's cache off, with a DataWarning, if it finds no folder for it. For a command."""
    from numba.core import caching, dispatcher

    try:
        caching.FunctionCache(allow_read_only_install)
    except RuntimeError:
        dispatcher.Dispatcher.enable_caching = lambda _: None  # type: ignore[method-assign,assignment]
        warnings.warn(
            "found no writable folder for compiled code, so every run compiles it again, which takes a minute: "
            "set NUMBA_CACHE_DIR to a writable folder",
            DataWarning,
            stacklevel=2,
        )
