"""Trained Gaussian splat in, clean chunked triangle mesh out."""

import os

__version__ = "0.1.0"

# Numba tries TBB first and warns about old ones, which some machines have; OpenMP comes with every wheel used here.
os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp tbb workqueue")

# OpenMP threads spin while they wait; where other work shares the cores that costs milliseconds a parallel loop.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

_HOMES = {
    "convert": "pipeline",
    "Splats": "splats.splats",
    "Scene": "scene.scene",
    "InputError": "base.errors",
    "DataWarning": "base.errors",
}
__all__ = [*_HOMES, "__version__"]


def __getattr__(name):
    """Import public names on first use, so that `--help` and `--version` stay instant."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
