"""Light on a scene: an environment in, the radiance leaving every vertex out, as a mesh, as a splat, as a session."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from splat2mesh.base.version import VERSION as __version__

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene as Scene

    from .api import RelitScene as RelitScene
    from .api import RelitSplat as RelitSplat
    from .api import estimate_albedo as estimate_albedo
    from .api import relight_scene as relight_scene
    from .api import relight_splat as relight_splat
    from .engine.relighter import Relighter as Relighter
    from .light.environment import Environment as Environment
    from .options import LightingOptions as LightingOptions
    from .viewer import view as view

_HOMES = {
    "Environment": ".light.environment",
    "LightingOptions": ".options",
    "Relighter": ".engine.relighter",
    "RelitScene": ".api",
    "RelitSplat": ".api",
    "Scene": "splat2mesh.scene.scene",
    "estimate_albedo": ".api",
    "relight_scene": ".api",
    "relight_splat": ".api",
    "view": ".viewer",
}
__all__ = [
    "Environment",
    "LightingOptions",
    "Relighter",
    "RelitScene",
    "RelitSplat",
    "Scene",
    "__version__",
    "estimate_albedo",
    "relight_scene",
    "relight_splat",
    "view",
]


def __getattr__(name: str) -> Any:
    """Import public names on first use, so that `--help` and `--version` stay instant."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name], __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
