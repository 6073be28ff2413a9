"""open3d, in commands without its web viewer, which takes half of its import time and may be uninstalled."""

import sys
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from .console import owns_process

PAGES = ("plotly", "plotly.graph_objects", "dash")
"""Imports of `open3d.visualization` for its web pages."""


class _Absent(ModuleType):
    """Stands in for a package that open3d imports and nothing uses."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return None


def open3d() -> ModuleType:
    """Import open3d. A command never shows a page, so its process does not import the packages that draw pages. Neither
    does a library process if they are not installed."""
    if "open3d" not in sys.modules:
        own = owns_process()
        absent = [each for each in PAGES if each not in sys.modules and (own or find_spec(each.split(".")[0]) is None)]
    else:
        absent = []
    try:
        for name in absent:
            sys.modules[name] = _Absent(name)
        import open3d as whole
    finally:
        for name in absent:
            sys.modules.pop(name, None)
    return whole
