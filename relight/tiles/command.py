"""The relight command of a city in tiles: parsed options in, results out."""

import argparse
from typing import Any

from splat2mesh.base.commandline import several, share
from splat2mesh.base.console import wants_progress
from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Stages

MEANINGLESS = ("capture_env", "plan", "no_cache", "view", "screenshot", "serve", "animate", "output", "sheet", "bake")
"""Options that a city does not know, as it does not know `splat` and `lights`."""


def understood(options: argparse.Namespace, defaults: argparse.Namespace, angles: list[float]) -> list[str]:
    """The formats that options of a city ask for. Raises InputError for an option that a city does not know."""
    from .city import FORMATS

    for name in (*MEANINGLESS, "splat", "lights"):
        if getattr(options, name) != getattr(defaults, name):
            raise InputError(f"--{name.replace('_', '-')}: has no meaning for a city in tiles; leave it out")
    if len(angles) > 1:
        raise InputError(f"--rotate {options.rotate}: a city in tiles takes one angle at a time")
    return several("--format", options.format, FORMATS) or ["glb", "splat"]


def light_city(
    options: argparse.Namespace,
    defaults: argparse.Namespace,  # of the same command
    angles: list[float],
) -> tuple[list[str], Any]:
    """Light a city that splat2mesh made in tiles: lines to show and the report."""
    from splat2mesh.tiles.tasks import engine

    from ..options import LightingOptions
    from .city import relight_city

    formats = understood(options, defaults, angles)
    names = ("method", "bands", "rays", "effects", "budget_s", "seed")
    tolerance = share("--tolerance", options.tolerance)
    wishes = LightingOptions(**{name: getattr(options, name) for name in names}, tolerance=tolerance)
    stages = Stages(show=wants_progress(options))
    try:
        with engine(options.scheduler, options.workers, options.memory) as running:
            if running.dashboard:
                stages.tell(f"dashboard: {running.dashboard}")
            result = relight_city(
                options.scene,
                options.env,
                running,
                wishes,
                angle_deg=angles[0],
                albedo=options.albedo or "estimated",
                exposure_ev=options.exposure,
                formats=tuple(formats),
                sky=options.sky,
                memory=options.memory,
                overwrite=options.overwrite,
                resume=options.resume,
                stages=stages,
            )
    finally:
        stages.close()
    return [f"{result['output']}: {result['vertices']:,} vertices in {result['tiles']} tiles"], result
