"""A city from splats to meshes: survey, deal, look, mesh, tile by tile into a folder or bucket, resumable.

plan.json            the request, and how the city is cut
splats/              the source divided among the tiles, kept for `relight`
work/                depth maps, removed once the tiles that need them are done
tiles/00003/         mesh.ply, mesh.glb, its coarse twins far.ply, far.glb and, of many tiles, distant.ply; mesh.json
                     with checksums
city.json            all tiles; tileset.json: 3D Tiles
"""

import hashlib
import json
import os
import tempfile
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..base.inputs import is_url
from ..base.outputs import check_output
from ..base.progress import Stages
from ..base.version import VERSION
from ..options import ConvertOptions, TilingOptions, refuse_in_cities
from .look import look, probe
from .memory import BASE_GB
from .pieces import CityPiece, pieces_of, size_of
from .plan import FILE, GB_PER_SPLAT, CityPlan, folder_of, splats_for
from .store import Store
from .surface import mesh
from .survey import deal, plan_of, say_all_dropped, survey_tasks
from .tasks import Done, Loop, Task, TaskSteps, costs, tiling_engine
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
    with tiling_engine(tiling, stages) as engine:
        return city_in_steps(source, TaskSteps(Store(output), engine, stages), options, tiling, overwrite)


def city_in_steps(
    source: str | os.PathLike[str],
    steps: TaskSteps,
    options: ConvertOptions,
    tiling: TilingOptions,
    overwrite: bool = False,
) -> dict[str, Any]:
    """The same by an engine that runs already."""
    store, resume = steps.store, tiling.resume
    asked: dict[str, Any] = {
        "up": options.up,
        "detail": options.detail,
        "memory": tiling.memory,
        "tile_splats": tiling.tile_splats,
        "vertices": options.vertices,
    }
    pieces = pieces_of(os.fspath(source), options.lod)
    asked["source"] = [[piece.path, piece.first, piece.last, size_of(piece)] for piece in pieces]
    if not _goes_on(store, asked, overwrite, resume):
        _surveyed(steps, pieces, asked)
    key = hashlib.sha256(store.read(FILE)).hexdigest()
    plan = CityPlan.read(store, key)
    sources = _dealt(steps, plan, key)
    if plan.fog == 0.0:
        key, plan = _probed(steps, plan, key, sources)
    records = _meshed(steps, plan, key, sources, resume)
    return _finished(steps, plan, records, source)


def _goes_on(store: Store, asked: dict[str, Any], overwrite: bool, resume: bool) -> bool:
    """Whether there is a plan to resume. Raises InputError for a folder that must not be written."""
    there = store.exists(FILE)
    if resume:
        if there and store.read_json(FILE)["asked"] != json.loads(json.dumps(asked)):
            raise InputError(
                f"{store.root}: was started with other settings or another source, so `resume` cannot continue"
            )
        return there
    if store.is_local:
        check_output(store.root, overwrite, FILE)
    elif there and not overwrite:
        raise InputError(f"{store.root} exists already: choose another `output`, or `overwrite` or `resume` it")
    store.remove(".")
    store.write("work/begun", b"")  # an unwritable folder fails before a large source is read
    return False


def _surveyed(steps: TaskSteps, pieces: list[CityPiece], asked: dict[str, Any]) -> CityPlan:
    """Read the source and plan the city, in FILE. Raises InputError for one that cannot be read or planned."""
    tasks = survey_tasks(steps.store, pieces)
    found = steps.run("survey", tasks)
    lost = [done for done in found.values() if done.error]
    if lost:  # an unreadable source is bad input, and nothing of value was written yet
        steps.store.remove(".")
        raise InputError(lost[0].error)
    counts = [found[task.name].result for task in tasks]
    say_all_dropped(counts)
    try:
        plan = plan_of(steps.store, pieces, counts, asked)
    except InputError:
        steps.store.remove(".")
        raise
    steps.store.write_json(FILE, {"asked": asked, "plan": plan.as_dict()})
    steps.store.remove("work/survey")
    return plan


def _dealt(steps: TaskSteps, plan: CityPlan, key: str) -> dict[int, list[int]]:
    """For each tile the pieces that hold splats of it."""
    names = [f"splats/{number:05d}.json" for number in range(len(plan.pieces))]
    missing = [number for number, name in enumerate(names) if not steps.store.exists(name)]
    steps.need("deal", [Task(f"deal {n}", deal, (steps.store, key, n)) for n in missing])
    sources: dict[int, list[int]] = {tile: [] for tile in range(len(plan.tiles))}
    for number, name in enumerate(names):
        for tile in steps.store.read_json(name)["dealt"]:
            if int(tile) >= 0:
                sources[int(tile)].append(number)
    return sources


def _near(plan: CityPlan, sources: dict[int, list[int]], tile: int) -> dict[int, list[int]]:
    return {other: sources[other] for other in plan.near(tile, plan.reach)}


def _probed(steps: TaskSteps, plan: CityPlan, key: str, sources: dict[int, list[int]]) -> tuple[str, CityPlan]:
    """The plan with the thickness of surfaces, measured in a few of the fullest tiles."""
    fullest = np.argsort(-np.array(plan.counts), kind="stable")
    chosen = sorted(fullest[np.linspace(0, (len(fullest) - 1) / 2, PROBED).astype(int)].tolist())
    tasks = [Task(f"probe {t}", probe, (steps.store, key, t, _near(plan, sources, t))) for t in dict.fromkeys(chosen)]
    ratios = np.array([ratio for found in steps.need("probe", tasks) for ratio in found])
    plan.fog = max(float(np.median(ratios)) if len(ratios) else 0.0, 1e-6)
    asked = steps.store.read_json(FILE)["asked"]
    steps.store.write_json(FILE, {"asked": asked, "plan": plan.as_dict()})
    key = hashlib.sha256(steps.store.read(FILE)).hexdigest()
    return key, CityPlan.read(steps.store, key)


def _meshed(
    steps: TaskSteps, plan: CityPlan, key: str, sources: dict[int, list[int]], resumed: bool
) -> list[dict[str, Any]]:
    """The records of all tiles. Raises UnfinishedError, which names the failed ones, once the others are done."""
    store, count = steps.store, len(plan.tiles)
    names = [f"{folder_of(tile)}/mesh.json" for tile in range(count)]
    records = steps.committed(names) if resumed else [None] * count
    tasks, waiting = _mesh_tasks(steps, plan, key, sources, [tile for tile in range(count) if records[tile] is None])

    def arrived(done: Done) -> None:
        kind, number = done.name.split()
        if kind == "mesh" and not done.error:
            for other in plan.seers(int(number)):
                waiting[other] -= 1
                if waiting[other] == 0:
                    store.remove_file(f"work/sights/{other:05d}.json")
                    store.remove_file(f"work/sights/{other:05d}.npz")

    steps.need("tiles", tasks, arrived, "mesh")
    return [store.read_json(name) for name in names]


def _mesh_tasks(
    steps: TaskSteps, plan: CityPlan, key: str, sources: dict[int, list[int]], missing: list[int]
) -> tuple[list[Task], dict[int, int]]:
    """What makes some tiles: views before the meshes that need them; and how many meshes need those of each tile."""
    tasks: list[Task] = []
    waiting = dict.fromkeys(range(len(plan.tiles)), 0)
    for tile in missing:
        for other in plan.seers(tile):
            if not waiting[other] and not steps.store.exists(f"work/sights/{other:05d}.json"):
                tasks.append(Task(f"look {other}", look, (steps.store, key, other, _near(plan, sources, other))))
            waiting[other] += 1
        after = tuple(f"look {other}" for other in plan.seers(tile))
        tasks.append(Task(f"mesh {tile}", mesh, (steps.store, key, tile), after))
    return tasks, waiting


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
    store.write_json("tileset.json", tileset(full, "mesh.glb", "far.glb", plan.finest))
    store.remove("work")
    return {
        **totals,
        "scene": store.root,
        "bytes": sum(about["bytes"] for entry in tiles for about in entry["files"].values()),
        "seconds": dict(steps.stages.seconds),
        **costs(steps.took.values()),
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
    settings: dict[str, Any] = {"up": options.up, "detail": options.detail, "vertices": None}
    settings |= {"memory": tiling.memory, "tile_splats": tiling.tile_splats}
    with tempfile.TemporaryDirectory() as folder:
        plan = _surveyed(TaskSteps(Store(folder), Loop(), stages or Stages()), pieces, settings)
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
