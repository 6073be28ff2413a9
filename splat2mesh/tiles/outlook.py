"""How a city would be cut into tiles, before any work: `splat2mesh CITY --tiles --plan`."""

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
from .plan import GB_PER_SPLAT, splats_for
from .store import Store
from .survey import plan_of, say_all_dropped, survey_tasks
from .tasks import Loop


def outlook(
    source: str | os.PathLike[str],
    options: ConvertOptions | None = None,
    tiling: TilingOptions | None = None,
    *,
    stages: Stages | None = None,
) -> dict[str, Any]:
    """Return the plan of a city, JSON-clean. Reads the source once and leaves no files. Arguments and errors as of
    `convert_city`."""
    options, tiling = options or ConvertOptions(), tiling or TilingOptions()
    refuse_in_cities(options, KNOWN)
    pieces = pieces_of(os.fspath(source), options.lod)
    stages = stages or Stages()
    settings: dict[str, Any] = {"up": options.up, "detail": options.detail, "vertices": None}
    settings |= {"memory": tiling.memory, "tile_splats": tiling.tile_splats}
    with tempfile.TemporaryDirectory() as folder:
        store, counts = Store(folder), []
        with stages.stage("survey", total=len(pieces)) as advance:
            for done in Loop().run(survey_tasks(store, pieces)):
                if done.error:
                    raise InputError(done.error)
                counts.append(done.result)
                advance()
        say_all_dropped(counts)
        plan = plan_of(store, pieces, counts, settings)
    most = splats_for(tiling.memory, tiling.tile_splats)  # of the fullest tile, its halo included
    return {
        "splats": plan.splats,
        "tiles": len(plan.tiles),
        "tile_splats": plan.counts,
        "tile_size": [np.ptp(plan.core(tile), axis=0).round(3).tolist() for tile in range(len(plan.tiles))],
        "up_from": plan.up_from,
        "pixel": plan.pixel,
        "memory_gb": round(BASE_GB + min(plan.splats, most) * GB_PER_SPLAT, 2),
    }


def lines_of(result: dict[str, Any]) -> list[str]:
    """An outlook as lines of text."""
    low, high = min(result["tile_splats"]), max(result["tile_splats"])
    return [
        f"{'splats':<24}{result['splats']:,}",
        f"{'tiles':<24}{result['tiles']} of {low:,} to {high:,} splats",
        f"{'memory of a process':<24}{result['memory_gb']:g} GiB",
    ]
