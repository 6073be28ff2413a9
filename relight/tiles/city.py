"""A city under a new light, tile by tile: CITY/relit/ENV_ANGLE holds each tile's files, tileset.json, report.json."""

import os
from dataclasses import replace
from typing import Any, cast

from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Stages
from splat2mesh.base.version import VERSION
from splat2mesh.options import TilingOptions, refuse_in_cities
from splat2mesh.splats.formats.streamed import META
from splat2mesh.tiles.city import CITY
from splat2mesh.tiles.plan import known_plan
from splat2mesh.tiles.store import Store
from splat2mesh.tiles.survey import sources_of
from splat2mesh.tiles.tasks import Task, TaskSteps, tiling_engine
from splat2mesh.tiles.tileset import tileset

from ..lamps.spec import asked_lamps
from ..light.loading import light_of
from ..options import PLACE_TOLERANCE
from ..output.kinds import CITY_FILES
from ..request import RelightRequest
from .local import room_for
from .shared import LIGHT, city_of
from .streamed import FOLDER, lod_meta
from .work import TileRequest, common_light, relit_environment, relit_far, relit_tile

ALBEDOS = ("estimated", "captured", "white")

DEFAULT_FORMATS = ("glb", "splat")

KNOWN = (
    *("scene", "env", "lighting", "angles_deg", "albedo", "exposure_ev", "formats", "sky", "tiling", "overwrite"),
    *("sun", "at", "north_deg", "harmonics", "live_mesh", "fps", "texture_size", "clear_cache"),
)
"""Fields of RelightRequest that a city accepts, or that have no effect without a field that it rejects."""

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
    request: RelightRequest,  # of the folder that `convert_city` wrote
    engine: Any = None,  # a Loop or Cluster that runs the tasks; by default of the request's `tiling`
    *,
    folder: str | None = None,  # name within the city; by default the light and its angle
    stages: Stages | None = None,
) -> dict[str, Any]:
    """Light a city; returns the report, JSON-clean.

    A city accepts the fields KNOWN, one angle, and all LightingOptions except those for captured lamps. Raises
    InputError for input that cannot be used, and UnfinishedError if some tiles failed; the others are done.
    """
    check_city(request)
    stages = stages or Stages()
    if engine is None:
        with tiling_engine(request.tiling or TilingOptions()) as running:
            return CityRun(request, running, folder, stages).report()
    return CityRun(request, engine, folder, stages).report()


def check_city(request: RelightRequest) -> None:
    """Raise InputError for a field that cities reject."""
    refuse_in_cities(request, KNOWN)
    refuse_in_cities(request.lighting, KNOWN_LIGHTING)
    if len(request.angles_deg) > 1:
        raise InputError("`angles_deg`: a city in tiles takes one angle at a time")
    if request.albedo is not None and request.albedo not in ALBEDOS:
        raise InputError(f"`albedo` {request.albedo}: for a city, expected one of {', '.join(ALBEDOS)}")
    if set(request.formats or ()) - set(CITY_FILES):
        found = " ".join(request.formats or ())
        raise InputError(f"`formats` {found}: for a city, expected some of {' '.join(CITY_FILES)}")


class CityRun:
    """One light for a city, from its request to its report. Each step keeps its files, so that a later run resumes."""

    def __init__(self, request: RelightRequest, engine: Any, folder: str | None, stages: Stages) -> None:
        """Read the city and prepare the folder of results. Raises InputError for a folder without a city, for lamps
        that cannot be read, if memory is short, and if the folder holds other results."""
        self._request, self._tiling = request, request.tiling or TilingOptions()
        self._store = store = Store(cast("str | os.PathLike[str]", request.scene))
        angle_deg = request.angles_deg[0]
        self._sky = light_of(request.light).rotated(angle_deg)
        self._tiles, (_, self._plan) = city_of(store)["tiles"], known_plan(store)
        name = f"{self._sky.name}_{angle_deg:.6f}".rstrip("0").rstrip(".")
        self._folder = folder or f"relit/{name}"
        formats = DEFAULT_FORMATS if request.formats is None else tuple(request.formats)
        options = request.lighting.planned(PLACE_TOLERANCE)
        albedo, memory = cast(str, request.albedo or "estimated"), self._tiling.memory
        self._asked = {
            "environment": self._sky.name,
            "angle_deg": angle_deg,
            "albedo": albedo,
            "exposure_ev": request.exposure_ev,
            "formats": sorted(formats),
            "sky": request.sky,
            "memory": memory,
            "options": repr(options),
        }
        options = replace(options, placed=tuple(asked_lamps(options.placed)))  # workers may not have their files
        self._each = TileRequest(options, albedo, formats, memory, self._plan.spacing)
        self._steps = TaskSteps(store, engine, stages)
        self._sources, splats = sources_of(store, self._plan), bool({"splat", "sog"} & set(formats))
        self._far = self._sources.get(-1, []) if splats else []
        coarse = sum(entry.get("far_vertices", 0) for entry in self._tiles)
        room_for(memory, max(self._plan.counts) if splats else 0, coarse)
        record = f"{self._folder}/asked.json"
        store.begin(self._folder, record, self._asked, request.overwrite, self._tiling.resume)
        store.write_json(record, self._asked)

    def _light(self) -> dict[str, Any]:
        """The content of light.json, on the light that all tiles share: computed, or read if the file exists."""
        store, name = self._store, f"{self._folder}/light.json"
        if not (store.exists(name) and store.exists(f"{self._folder}/{LIGHT}")):
            given = store, self._folder, self._each, self._sky, self._request.exposure_ev, self._far
            task = Task("light", common_light, given)
            store.write_json(name, self._steps.need("light", [task])[0])
        return cast("dict[str, Any]", store.read_json(name))

    def _tasks(self, key: str) -> tuple[list[Task], list[Task]]:
        """Tasks that light the tiles, and those for the far background, each kind of file its own. key: of the shared
        light."""
        folder, shared = self._folder, (self._store, self._folder, key)
        tiles, far = [], []
        for tile, entry in enumerate(self._tiles):
            given = self._each, tile, self._sources.get(tile, [])
            record = f"{folder}/{entry['name']}/relit.json"
            tiles.append(Task(f"tile {tile}", relit_tile, (*shared, *given), record=record))
        if "splat" in self._each.formats:
            for n in self._far:
                record = f"{folder}/far/{n:05d}.json"
                far.append(Task(f"far {n}", relit_far, (*shared, n, self._request.sky), record=record))
        if "sog" in self._each.formats and self._far:
            record = f"{folder}/{FOLDER}/environment.json"
            far.append(Task("far", relit_environment, (*shared, self._far, self._request.sky), record=record))
        return tiles, far

    def report(self) -> dict[str, Any]:
        """Light what is unfinished, write report.json and the files that join the tiles; return the report. Raises
        UnfinishedError if some fail."""
        store, folder, light = self._store, self._folder, self._light()
        tiles, far = self._tasks(light["sha256"])
        self._steps.need("tiles", self._steps.left(tiles + far) if self._tiling.resume else tiles + far)
        records = [store.read_json(task.record) for task in tiles]
        if "glb" in self._each.formats:
            named = (record | {"name": entry["name"]} for record, entry in zip(records, self._tiles, strict=True))
            full = [record for record in named if record["vertices"]]
            store.write_json(f"{folder}/tileset.json", tileset(full, self._plan.finest, twins=False))
        leaves = [leaf for record in records for leaf in record.get("leaves", ())]
        if leaves:
            surrounded = bool(self._far) and store.read_json(far[-1].record)["splats"] > 0
            store.write_json(f"{folder}/{FOLDER}/{META}", lod_meta(leaves, surrounded))
        report = {
            "version": VERSION,
            **self._asked,
            "light": light,
            "tiles": len(records),
            "vertices": sum(record["vertices"] for record in records),
            "bytes": sum(about["bytes"] for record in records for about in record["files"].values()),
        }
        store.write_json(f"{folder}/report.json", report)
        return {**report, "output": store.path(folder), **self._steps.costs()}
