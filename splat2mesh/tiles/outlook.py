"""The expected cost of a city in tiles, before any work: `splat2mesh CITY --tiles --plan`."""

import os
import tempfile
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..base.progress import Stages
from ..options import ConvertOptions, TilingOptions, refuse_in_cities
from .city import KNOWN
from .memory import BASE_GB
from .pieces import pieces_of
from .plan import GB_PER_SPLAT, CityPlan, splats_for
from .store import Store
from .survey import LEAST_SAMPLE, SAMPLE, plan_of, say_all_dropped, survey
from .tasks import Loop, Task

SECONDS_PER_SPLAT = {"draft": 2.5e-4, "normal": 6.6e-4, "fine": 8.2e-4}
"""Processor seconds of meshing, by detail. Generated cities of 1 to 10 million splats in draft; one of 100,000 took 2.6
times as long in normal and 3.3 times in fine. A real capture with trees of needles took 4.1e-4 in draft."""

SCENE_BYTES, WORK_BYTES = 175.0, 400.0
"""For each splat: of a scene folder in draft, and of the depth maps that lie beside it while it is made."""


def outlook(
    source: str | os.PathLike[str],
    options: ConvertOptions | None = None,
    tiling: TilingOptions | None = None,
    *,
    stages: Stages | None = None,
) -> dict[str, Any]:
    """Return the plan of a city and its cost, JSON-clean. Reads the source once and leaves no files.

    Arguments and errors as of `convert_city`.
    """
    options, tiling = options or ConvertOptions(), tiling or TilingOptions()
    refuse_in_cities(options, KNOWN)
    pieces = pieces_of(os.fspath(source), options.lod)
    most, stages = max(LEAST_SAMPLE, SAMPLE // len(pieces)), stages or Stages()
    settings: dict[str, Any] = {"up": options.up, "detail": options.detail, "vertices": None}
    settings |= {"memory": tiling.memory, "tile_splats": tiling.tile_splats}
    with tempfile.TemporaryDirectory() as folder:
        store, counts = Store(folder), []
        with stages.stage("survey", total=len(pieces)) as advance:
            for done in Loop().run([Task(f"survey {n}", survey, (store, n, p, most)) for n, p in enumerate(pieces)]):
                if done.error:
                    raise InputError(done.error)
                counts.append(done.result)
                advance()
        say_all_dropped(counts)
        plan = plan_of(store, pieces, counts, settings)
    return {
        "splats": plan.splats,
        "tiles": len(plan.tiles),
        "tile_splats": plan.counts,
        "tile_size": [np.ptp(plan.core(tile), axis=0).round(3).tolist() for tile in range(len(plan.tiles))],
        "up_from": plan.up_from,
        "pixel": plan.pixel,
        "memory_gb": _memory(plan, splats_for(tiling.memory, tiling.tile_splats)),
        "processor_seconds": round(plan.splats * SECONDS_PER_SPLAT[options.detail]),
        "scene_mb": round(plan.splats * SCENE_BYTES / 2**20),
        "work_mb": round(plan.splats * WORK_BYTES / 2**20),
    }


def _memory(plan: CityPlan, most: int) -> float:
    """GiB of a process that works on the fullest tile, its halo included."""
    return round(BASE_GB + min(plan.splats, most) * GB_PER_SPLAT, 2)


def lines_of(result: dict[str, Any]) -> list[str]:
    """An outlook as lines of text."""
    low, high = min(result["tile_splats"]), max(result["tile_splats"])
    return [
        f"{'splats':<24}{result['splats']:,}",
        f"{'tiles':<24}{result['tiles']} of {low:,} to {high:,} splats",
        f"{'memory of a process':<24}{result['memory_gb']:g} GiB",
        f"{'processor time':<24}{result['processor_seconds'] / 60:.0f} min, divided by the workers",
        f"{'scene':<24}{result['scene_mb']:,} MB, and up to {result['work_mb']:,} MB of depth maps while it is made",
    ]
