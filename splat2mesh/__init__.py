"""Trained Gaussian splat in, clean chunked triangle mesh out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .base.version import VERSION as __version__

if TYPE_CHECKING:
    from .base.errors import DataWarning as DataWarning
    from .base.errors import InputError as InputError
    from .pipeline import convert as convert
    from .proxy import add_proxy as add_proxy
    from .scene.scene import Scene as Scene
    from .splats.splats import Splats as Splats

_HOMES = {
    "DataWarning": ".base.errors",
    "InputError": ".base.errors",
    "Scene": ".scene.scene",
    "Splats": ".splats.splats",
    "add_proxy": ".proxy",
    "convert": ".pipeline",
}
__all__ = ["DataWarning", "InputError", "Scene", "Splats", "__version__", "add_proxy", "convert"]


def __getattr__(name: str) -> Any:
    """Import public names on first use, so that `--help` and `--version` stay instant."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name], __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
