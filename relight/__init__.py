"""Light on a scene: an environment in, the radiance leaving every vertex out."""

from splat2mesh import __version__

_HOMES = {"Environment": "light.environment", "Relighter": "engine.relighter"}
__all__ = [*_HOMES, "__version__"]


def __getattr__(name):
    """Import public names on first use, so that `--help` and `--version` stay instant."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
