"""The splat2mesh command of a city in tiles: parsed options in, results out."""

import argparse
import time
from typing import Any

from ..base.console import wants_progress
from ..base.errors import InputError
from ..base.progress import Stages

MEANINGLESS = ("cameras", "surface", "background", "stand", "eye", "max_chunk_vertices", "seed", "proxy")
"""Options that a city does not know."""


def mesh_city(
    options: argparse.Namespace,
    defaults: argparse.Namespace,  # of the same command
    output: str,
) -> tuple[list[str], Any]:
    """Mesh a city tile by tile: lines to show and the report."""
    from .city import convert_city
    from .tasks import engine

    for name in MEANINGLESS:
        if getattr(options, name) != getattr(defaults, name):
            option = "from" if name == "stand" else name.replace("_", "-")
            raise InputError(f"--{option}: has no meaning for a city in tiles; leave it out")
    stages = Stages(show=wants_progress(options))
    names = ("lod", "up", "detail", "memory")
    if options.plan:
        from .outlook import lines_of, outlook

        try:
            expected = outlook(options.input, **{name: getattr(options, name) for name in names}, stages=stages)
        finally:
            stages.close()
        return lines_of(expected), expected
    start = time.perf_counter()
    try:
        with engine(options.scheduler, options.workers, options.memory) as running:
            if running.dashboard:
                stages.tell(f"dashboard: {running.dashboard}")
            result = convert_city(
                options.input,
                output,
                running,
                **{name: getattr(options, name) for name in names},
                vertices=options.vertices,
                overwrite=options.overwrite,
                resume=options.resume,
                stages=stages,
            )
    finally:
        stages.close()
    lines = [
        f"{result['scene']}: {result['vertices']:,} vertices, {result['faces']:,} faces in {result['tiles']} tiles, "
        f"from {result['splats']:,} splats, {time.perf_counter() - start:.1f} s, "
        f"at most {result['peak_mb'] / 1024:.2f} GiB in a process"
    ]
    if options.verbose:
        lines += [f"  {label:<16}{value:7.2f} s" for label, value in stages.seconds.items()]
    return lines, result
