"""open3d, in commands without its web viewer, which takes half of its import time."""

import sys
from types import ModuleType
from typing import Any

from .console import owns_process

PAGES = ("plotly", "plotly.graph_objects", "dash")
"""The imports of `open3d.visualization` for them."""


class _Absent(ModuleType):
    """Stands for a package of which nothing is used."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return None


def open3d() -> ModuleType:
    """Import open3d.

    Returns
    -------
    module
        A command never shows a page, so that in its process what draws them is not imported along.
    """
    if "open3d" in sys.modules or not owns_process():
        import open3d as whole

        return whole
    absent = [name for name in PAGES if name not in sys.modules]
    try:
        for name in absent:
            sys.modules[name] = _Absent(name)
        import open3d as whole
    finally:
        for name in absent:
            sys.modules.pop(name, None)
    return whole
