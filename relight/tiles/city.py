"""A city under a new light, tile by tile: CITY/relit/ENV_ANGLE holds each tile's files, tileset.json, report.json."""

import os
from typing import Any, cast

from splat2mesh.base.errors import InputError, UnfinishedError
from splat2mesh.base.progress import Stages
from splat2mesh.base.version import VERSION
from splat2mesh.options import TilingOptions, refuse_in_cities
from splat2mesh.tiles.city import CITY, SCHEMA_VERSION
from splat2mesh.tiles.plan import FILE, CityPlan
from splat2mesh.tiles.steps import TaskSteps, name_failed
from splat2mesh.tiles.store import Store
from splat2mesh.tiles.tasks import Task, costs, tiling_engine
from splat2mesh.tiles.tileset import tileset

from ..light import CAPTURED
from ..light.loading import light_of
from ..options import PLACE_TOLERANCE
from ..output.kinds import CITY_FILES
from ..request import RelightRequest
from .mixture import lamps_asked
from .parts import room_for
from .shared import LIGHT, write_sky
from .streamed import FOLDER, META, lod_meta
from .work import TileRequest, common_light, relit_environment, relit_far, relit_tile

ALBEDOS = ("estimated", "captured", "white")

DEFAULT_FORMATS = ("glb", "splat")

KNOWN = (
    *("scene", "env", "lighting", "angles_deg", "albedo", "exposure_ev", "formats", "sky", "tiling", "overwrite"),
    *("sun", "at", "north_deg", "harmonics", "live_mesh", "fps", "texture_size", "clear_cache"),
)
"""Fields of RelightRequest that a city takes, or that say nothing without another that it does not take."""

KNOWN_LIGHTING = (
    "method",
    "bands",
    "rays",
    "effects",
    "tolerance",
    "budget_s",
    "seed",
    "placed",
    "captured",
    "env_scale",
)


def is_city(path: str | os.PathLike[str]) -> bool:
    """Whether a folder or URL holds a city that was meshed in tiles."""
    return Store(path).exists(CITY)


def relight_city(
    request: RelightRequest,
    engine: Any = None,
    *,
    folder: str | None = None,
    stages: Stages | None = None,
) -> dict[str, Any]:
    """Light a city; returns the report, JSON-clean.

    Parameters
    ----------
    request : RelightRequest
        Its scene is what `convert_city` wrote. A city knows KNOWN alone, one angle, and of LightingOptions all but
        what becomes of captured lamps.
    engine : Loop or Cluster, optional
        What runs the tasks, where it is not made of the request's `tiling`.
    folder : str, optional
        Within the city; by the light and its angle without.

    Raises
    ------
    InputError
        For what cannot be used.
    UnfinishedError
        Where tiles failed and the others are done.
    """
    check_city(request)
    stages = stages or Stages()
    if engine is None:
        with tiling_engine(request.tiling or TilingOptions(), stages) as running:
            return _relit(request, running, folder, stages)
    return _relit(request, engine, folder, stages)


def check_city(request: RelightRequest) -> None:
    """Raise InputError for a field that cities do not know."""
    refuse_in_cities(request, KNOWN)
    refuse_in_cities(request.lighting, KNOWN_LIGHTING)
    if request.env == CAPTURED:
        raise InputError("`env` captured: a city in tiles takes another light")
    if len(request.angles_deg) > 1:
        raise InputError("`angles_deg`: a city in tiles takes one angle at a time")
    if request.albedo is not None and request.albedo not in ALBEDOS:
        raise InputError(f"`albedo` {request.albedo}: for a city, expected one of {', '.join(ALBEDOS)}")
    if set(request.formats or ()) - set(CITY_FILES):
        found = " ".join(request.formats or ())
        raise InputError(f"`formats` {found}: for a city, expected some of {' '.join(CITY_FILES)}")


def _relit(request: RelightRequest, engine: Any, folder: str | None, stages: Stages) -> dict[str, Any]:
    tiling, env = request.tiling or TilingOptions(), request.env
    memory, resume, overwrite = tiling.memory, tiling.resume, request.overwrite
    store = Store(cast("str | os.PathLike[str]", request.scene))
    albedo, exposure_ev, sky = request.albedo or "estimated", request.exposure_ev, request.sky
    angle_deg = request.angles_deg[0]
    formats = DEFAULT_FORMATS if request.formats is None else tuple(request.formats)
    light = light_of(env).rotated(angle_deg)
    if not store.exists(CITY):
        raise InputError(f"{store.root} holds no {CITY}: make a city with splat2mesh --tiles first")
    city = store.read_json(CITY)
    if city.get("schema_version", 0) > SCHEMA_VERSION:
        raise InputError(f"{store.root}: schema version {city['schema_version']}; update the tool")
    plan = CityPlan(**store.read_json(FILE)["plan"])
    folder = folder or f"relit/{light.name}_{angle_deg:.6f}".rstrip("0").rstrip(".")
    options = request.lighting.planned(PLACE_TOLERANCE)
    lamps_asked(options)  # one that cannot be read fails before any work
    asked = {
        "environment": light.name,
        "angle_deg": angle_deg,
        "albedo": albedo,
        "exposure_ev": exposure_ev,
        "formats": sorted(formats),
        "sky": sky,
        "memory": memory,
        "options": repr(options),
    }
    held = max(plan.counts) if {"splat", "sog"} & set(formats) else 0
    room_for(memory, held, sum(entry.get("far_vertices", 0) for entry in city["tiles"]))
    _begin(store, folder, asked, overwrite, resume)
    steps = TaskSteps(store, engine, stages)
    dealt = [store.read_json(f"splats/{number:05d}.json")["dealt"] for number in range(len(plan.pieces))]
    background = [number for number, counts in enumerate(dealt) if "-1" in counts]
    if not {"splat", "sog"} & set(formats):
        background = []
    told = store.read_json(f"{folder}/light.json") if store.exists(f"{folder}/light.json") else None
    if told is None or not store.exists(f"{folder}/{LIGHT}"):
        write_sky(store, folder, light)
        task = Task("light", common_light, (store, folder, options, albedo, exposure_ev, background))
        done = steps.run("light", [task])["light"]
        if done.error:
            raise UnfinishedError(f"the light of the capture failed: {done.error}")
        told = done.result
        store.write_json(f"{folder}/light.json", told)
    tasks, kept = [], {}
    if resume:
        names = {f"{folder}/{entry['name']}/relit.json" for entry in city["tiles"]}
        names |= {f"{folder}/far/{number:05d}.json" for number in range(len(dealt))}
        names |= {f"{folder}/{FOLDER}/environment.json"}
        checked = steps.run("check", [Task(f"check {name}", store.committed, (name,)) for name in sorted(names)])
        kept = {name: checked[f"check {name}"].result for name in names}
    wanted = TileRequest(options, str(albedo), tuple(formats), memory, plan.spacing)
    for tile, entry in enumerate(city["tiles"]):
        if kept.get(f"{folder}/{entry['name']}/relit.json") is None:
            sources = [number for number, counts in enumerate(dealt) if str(tile) in counts]
            tasks.append(Task(f"tile {tile}", relit_tile, (store, folder, told["sha256"], wanted, tile, sources)))
    environment = f"{folder}/{FOLDER}/environment.json"
    shared = store, folder, told["sha256"]
    for number in background:
        if "splat" in formats and kept.get(f"{folder}/far/{number:05d}.json") is None:
            tasks.append(Task(f"far {number}", relit_far, (*shared, number, sky)))
    if "sog" in formats and background and kept.get(environment) is None:
        tasks.append(Task("far", relit_environment, (*shared, background, sky)))
    found = steps.run("tiles", tasks)
    lost = [found[task.name] for task in tasks if found[task.name].error]
    if lost:
        failed = name_failed(lost)
        raise UnfinishedError(f"{len(lost)} of {len(tasks)} parts are not done ({failed}); run again with `resume`")
    records = [store.read_json(f"{folder}/{entry['name']}/relit.json") for entry in city["tiles"]]
    if "glb" in formats:
        full = [
            record | {"name": e["name"]} for record, e in zip(records, city["tiles"], strict=True) if record["vertices"]
        ]
        store.write_json(f"{folder}/tileset.json", tileset(full, "mesh.glb", None, plan.finest))
    leaves = [leaf for record in records for leaf in record.get("leaves", ())]
    if leaves:
        surrounded = bool(background) and store.read_json(environment)["splats"] > 0
        store.write_json(f"{folder}/{FOLDER}/{META}", lod_meta(leaves, surrounded))
    report = {
        "version": VERSION,
        **asked,
        "light": told,
        "tiles": len(records),
        "vertices": sum(record["vertices"] for record in records),
        "bytes": sum(about["bytes"] for record in records for about in record["files"].values()),
    }
    store.write_json(f"{folder}/report.json", report)
    return {
        **report,
        "output": store.path(folder),
        "seconds": dict(stages.seconds),
        **costs(steps.took.values()),
    }


def _begin(store: Store, folder: str, asked: dict[str, Any], overwrite: bool, resume: bool) -> None:
    """Make sure that what lies in a folder may be gone on with, or is gone. Raises InputError."""
    name = f"{folder}/asked.json"
    if store.exists(name):
        if resume and store.read_json(name) != asked:
            raise InputError(f"{store.path(folder)}: was started with other settings, so `resume` cannot continue")
        if not resume and not overwrite:
            raise InputError(
                f"{store.path(folder)} exists already: replace it with `overwrite` or continue with `resume`"
            )
        if not resume:
            store.remove(folder)
    store.write_json(name, asked)
