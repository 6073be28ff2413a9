"""A city from splats to meshes: survey, deal, look, mesh, tile by tile into a folder or bucket, resumable.

plan.json            the request, and how the city is cut
splats/              the source divided among the tiles, kept for `relight`
work/                depth maps, removed once the tiles that need them are done
tiles/00003/         mesh.ply, mesh.glb, its coarse twins far.ply, far.glb and, of many tiles, distant.ply; mesh.json
                     with checksums
city.json            all tiles; tileset.json: 3D Tiles
"""

import os
from collections import Counter
from dataclasses import asdict
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..base.inputs import is_url
from ..base.progress import Stages
from ..base.version import VERSION
from ..options import ConvertOptions, TilingOptions, refuse_in_cities
from .look import look, probe, sights_of
from .memory import BASE_GB
from .pieces import CityPiece, pieces_of, size_of
from .plan import FILE, GB_PER_SPLAT, CityPlan, folder_of, known_plan, splats_for
from .store import Store
from .surface import mesh
from .survey import SAMPLE, deal, dealt_of, plan_of, sources_of, survey
from .tasks import Done, Loop, Task, TaskSteps, tiling_engine
from .tileset import tileset

CITY, SCHEMA_VERSION = "city.json", 1

PROBED = 4
"""Tiles whose surfaces determine the thickness of the city's."""

KNOWN = ("lod", "vertices", "up", "detail")
"""Fields of ConvertOptions that a city takes."""


def convert_city(
    source: str | os.PathLike[str],
    output: str | os.PathLike[str],
    options: ConvertOptions,
    tiling: TilingOptions,
    overwrite: bool,
    stages: Stages,
) -> dict[str, Any]:
    """Mesh a city tile by tile; returns the report, JSON-clean.

    source: path or URL, as `pieces_of` takes it. output: folder, or URL of fsspec. options: a city knows KNOWN alone;
    `vertices` are those of the whole city. tiling: memory, workers, and whether an earlier run with the same settings
    goes on. Raises InputError for what cannot be used. Raises UnfinishedError where tiles failed and the others are
    done.
    """
    refuse_in_cities(options, KNOWN)
    with tiling_engine(tiling) as engine:
        return city_in_steps(source, TaskSteps(Store(output), engine, stages), options, tiling, overwrite)


def city_in_steps(
    source: str | os.PathLike[str],
    steps: TaskSteps,
    options: ConvertOptions,
    tiling: TilingOptions,
    overwrite: bool = False,
) -> dict[str, Any]:
    """The same by an engine that runs already."""
    store = steps.store
    pieces = pieces_of(os.fspath(source), options.lod)
    asked = _asked(options, tiling)
    asked["source"] = [[piece.path, piece.first, piece.last, size_of(piece)] for piece in pieces]
    if not store.begin("", FILE, asked, overwrite, tiling.resume):
        store.write_json(FILE, {"asked": asked, "plan": asdict(_planned(steps, pieces, asked))})
    key, plan = known_plan(store)
    deals = [Task(f"deal {n}", deal, (store, key, n), record=dealt_of(n)) for n in range(len(plan.pieces))]
    steps.need("deal", [task for task in deals if not store.exists(task.record)])
    sources = sources_of(store, plan)
    if plan.fog == 0.0:
        key, plan = _probed(steps, plan, key, sources)
    records = _meshed(steps, plan, key, sources, tiling.resume)
    return _finished(steps, plan, records, source)


def _asked(options: ConvertOptions, tiling: TilingOptions) -> dict[str, Any]:
    """The settings that a resumed run must share."""
    asked: dict[str, Any] = {"up": options.up, "detail": options.detail}
    return asked | {"memory": tiling.memory, "tile_splats": tiling.tile_splats, "vertices": options.vertices}


def _planned(steps: TaskSteps, pieces: list[CityPiece], asked: dict[str, Any]) -> CityPlan:
    """Read the source and plan the city. Raises InputError for one that cannot be read or planned."""
    most = max(1, SAMPLE // len(pieces))
    tasks = [Task(f"survey {n}", survey, (piece, most)) for n, piece in enumerate(pieces)]
    found = steps.run("survey", tasks)
    for done in found.values():
        if done.error:
            raise InputError(done.error)
    return plan_of(pieces, [found[task.name].result for task in tasks], asked)


def _near(plan: CityPlan, sources: dict[int, list[int]], tile: int) -> dict[int, list[int]]:
    return {other: sources.get(other, []) for other in plan.near(tile, plan.reach)}


def _probed(steps: TaskSteps, plan: CityPlan, key: str, sources: dict[int, list[int]]) -> tuple[str, CityPlan]:
    """The plan with the thickness of surfaces, measured in a few of the fullest tiles, and its key."""
    store, fullest = steps.store, np.argsort(-np.array(plan.counts), kind="stable")
    chosen = sorted({int(tile) for tile in fullest[np.linspace(0, (len(fullest) - 1) / 2, PROBED).astype(int)]})
    tasks = [Task(f"probe {t}", probe, (store, key, t, _near(plan, sources, t))) for t in chosen]
    ratios = np.array([ratio for found in steps.need("probe", tasks) for ratio in found])
    plan.fog = max(float(np.median(ratios)) if len(ratios) else 0.0, 1e-6)
    store.write_json(FILE, {"asked": store.read_json(FILE)["asked"], "plan": asdict(plan)})
    return known_plan(store)


def _meshed(
    steps: TaskSteps, plan: CityPlan, key: str, sources: dict[int, list[int]], resumed: bool
) -> list[dict[str, Any]]:
    """The records of all tiles. Views are made before the meshes that need them, and go after the last of these. Raises
    UnfinishedError, which names the failed ones, once the others are done."""
    store, looks, meshes = steps.store, {}, []
    for tile in range(len(plan.tiles)):
        given = store, key, tile, _near(plan, sources, tile)
        looks[f"look {tile}"] = Task(f"look {tile}", look, given, record=sights_of(tile))
        after = tuple(f"look {other}" for other in plan.seers(tile))
        meshes.append(Task(f"mesh {tile}", mesh, given[:3], after, f"{folder_of(tile)}/mesh.json"))
    tasks: dict[str, Task] = {}
    waiting: Counter[str] = Counter()
    for task in steps.left(meshes) if resumed else meshes:
        new = [name for name in task.after if name not in waiting]
        tasks |= {name: looks[name] for name in new if not store.exists(looks[name].record)}
        tasks[task.name] = task
        waiting.update(task.after)

    def arrived(done: Done) -> None:
        for name in () if done.error else tasks[done.name].after:
            waiting[name] -= 1
            if not waiting[name]:
                store.remove(looks[name].record)

    steps.need("tiles", list(tasks.values()), arrived, "mesh")
    return [store.read_json(task.record) for task in meshes]


def _finished(
    steps: TaskSteps, plan: CityPlan, records: list[dict[str, Any]], source: str | os.PathLike[str]
) -> dict[str, Any]:
    store, tiles = steps.store, []
    for tile, record in enumerate(records):
        tiles.append({"name": folder_of(tile), "core": plan.core(tile).ravel().tolist(), **record})
    full = [entry for entry in tiles if entry["faces"]]
    if not full:
        raise InputError(f"{source}: no surface was found: is this a splat of a place?")
    totals = {
        "splats": plan.splats,
        "tiles": len(tiles),
        **{name: sum(entry[name] for entry in tiles) for name in ("vertices", "faces", "seam_vertices")},
    }
    meta = {
        "schema_version": SCHEMA_VERSION,
        "version": VERSION,
        "source": {"path": os.fspath(source) if is_url(source) else os.path.abspath(source), "pieces": plan.pieces},
        "scene_from_splat": plan.scene_from_splat,
        "up_from": plan.up_from,
        "statistics": {**totals, "fog": round(plan.fog, 4), "pixel": plan.pixel},
        "tiles": tiles,
    }
    store.write_json(CITY, meta)
    store.write_json("tileset.json", tileset(full, plan.finest, twins=True))
    store.remove("work")
    return {
        **totals,
        "scene": store.root,
        "bytes": sum(about["bytes"] for entry in tiles for about in entry["files"].values()),
        **steps.costs(),
    }


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
    plan = _planned(TaskSteps(Store("."), Loop(), stages or Stages()), pieces, _asked(options, tiling))
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
