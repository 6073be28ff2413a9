"""A city under a new light, tile by tile: CITY/relit/ENV_ANGLE holds each tile's files, tileset.json, report.json."""

import os
from typing import Any, cast

from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Stages
from splat2mesh.base.version import VERSION
from splat2mesh.options import TilingOptions, refuse_in_cities
from splat2mesh.tiles.city import CITY, SCHEMA_VERSION
from splat2mesh.tiles.plan import FILE, CityPlan
from splat2mesh.tiles.store import Store
from splat2mesh.tiles.tasks import Task, TaskSteps, costs, tiling_engine
from splat2mesh.tiles.tileset import tileset

from ..lamps.spec import asked_lamps
from ..light.loading import light_of
from ..options import PLACE_TOLERANCE
from ..output.kinds import CITY_FILES
from ..request import RelightRequest
from .local import room_for
from .shared import LIGHT, write_sky
from .streamed import FOLDER, META, lod_meta
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
        with tiling_engine(request.tiling or TilingOptions(), stages) as running:
            return _relit(request, running, folder, stages)
    return _relit(request, engine, folder, stages)


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


def _relit(request: RelightRequest, engine: Any, folder: str | None, stages: Stages) -> dict[str, Any]:
    run = CityRun(request, engine, folder, stages)
    run.begin()
    light = run.light_of_capture()
    run.light_tiles(light["sha256"])
    return run.report(light)


class CityRun:
    """One light for a city, from its request to its report. Each step keeps its files, so that a later run resumes."""

    def __init__(self, request: RelightRequest, engine: Any, folder: str | None, stages: Stages) -> None:
        """Read the city. Raises InputError for a folder without a city, or for lamps that cannot be read."""
        self._tiling = request.tiling or TilingOptions()
        self._store = Store(cast("str | os.PathLike[str]", request.scene))
        self._albedo, self._exposure_ev, self._sky = request.albedo or "estimated", request.exposure_ev, request.sky
        self._overwrite, self._angle_deg = request.overwrite, request.angles_deg[0]
        self._formats = DEFAULT_FORMATS if request.formats is None else tuple(request.formats)
        self._light = light_of(request.light).rotated(self._angle_deg)
        self._city = _city_of(self._store)
        self._plan = CityPlan(**self._store.read_json(FILE)["plan"])
        name = f"{self._light.name}_{self._angle_deg:.6f}".rstrip("0").rstrip(".")
        self._folder = folder or f"relit/{name}"
        self._options = request.lighting.planned(PLACE_TOLERANCE)
        asked_lamps(self._options.placed)  # an unreadable light fails before any work
        self._steps, self._stages = TaskSteps(self._store, engine, stages), stages
        pieces = range(len(self._plan.pieces))
        self._dealt = [self._store.read_json(f"splats/{number:05d}.json")["dealt"] for number in pieces]
        far = [number for number, counts in enumerate(self._dealt) if "-1" in counts]
        self._background = far if self._writes_splats else []

    @property
    def _writes_splats(self) -> bool:
        return bool({"splat", "sog"} & set(self._formats))

    @property
    def _asked(self) -> dict[str, Any]:
        """The settings that a resumed run must share."""
        return {
            "environment": self._light.name,
            "angle_deg": self._angle_deg,
            "albedo": self._albedo,
            "exposure_ev": self._exposure_ev,
            "formats": sorted(self._formats),
            "sky": self._sky,
            "memory": self._tiling.memory,
            "options": repr(self._options),
        }

    def begin(self) -> None:
        """Prepare the folder of results. Raises InputError if memory is short or the folder holds other results."""
        held = max(self._plan.counts) if self._writes_splats else 0
        room_for(self._tiling.memory, held, sum(entry.get("far_vertices", 0) for entry in self._city["tiles"]))
        _begin(self._store, self._folder, self._asked, self._overwrite, self._tiling.resume)

    def light_of_capture(self) -> dict[str, Any]:
        """The light that all tiles share, the content of light.json: computed, or read if the file exists."""
        store, name = self._store, f"{self._folder}/light.json"
        if store.exists(name) and store.exists(f"{self._folder}/{LIGHT}"):
            return cast("dict[str, Any]", store.read_json(name))
        write_sky(store, self._folder, self._light)
        given = store, self._folder, self._options, self._albedo, self._exposure_ev, self._background
        (found,) = self._steps.need("light", [Task("light", common_light, given)])
        store.write_json(name, found)
        return cast("dict[str, Any]", found)

    def light_tiles(self, sha256: str) -> None:
        """Light every unfinished part. sha256: of the shared light. Raises UnfinishedError if some fail."""
        self._steps.need("tiles", self._tasks(sha256, self._done() if self._tiling.resume else set()))

    def _done(self) -> set[str]:
        """Records of the parts that an earlier run finished."""
        names = {self._record_of(entry) for entry in self._city["tiles"]} | {self._environment}
        names |= {self._record_of_far(number) for number in range(len(self._dealt))}
        listed = sorted(names)
        return {name for name, found in zip(listed, self._steps.committed(listed), strict=True) if found is not None}

    def _record_of(self, entry: dict[str, Any]) -> str:
        return f"{self._folder}/{entry['name']}/relit.json"

    def _record_of_far(self, number: int) -> str:
        return f"{self._folder}/far/{number:05d}.json"

    @property
    def _environment(self) -> str:
        return f"{self._folder}/{FOLDER}/environment.json"

    def _tasks(self, sha256: str, done: set[str]) -> list[Task]:
        """The unfinished tasks: tiles, and far background in its own kind of file."""
        shared = self._store, self._folder, sha256
        wanted = TileRequest(self._options, str(self._albedo), self._formats, self._tiling.memory, self._plan.spacing)
        tasks = []
        for tile, entry in enumerate(self._city["tiles"]):
            if self._record_of(entry) not in done:
                sources = [number for number, counts in enumerate(self._dealt) if str(tile) in counts]
                tasks.append(Task(f"tile {tile}", relit_tile, (*shared, wanted, tile, sources)))
        for number in self._background:
            if "splat" in self._formats and self._record_of_far(number) not in done:
                tasks.append(Task(f"far {number}", relit_far, (*shared, number, self._sky)))
        if "sog" in self._formats and self._background and self._environment not in done:
            tasks.append(Task("far", relit_environment, (*shared, self._background, self._sky)))
        return tasks

    def report(self, light: dict[str, Any]) -> dict[str, Any]:
        """Write report.json and the files that join the tiles; return the report. light: the shared light."""
        records = [self._store.read_json(self._record_of(entry)) for entry in self._city["tiles"]]
        self._join(records)
        report = {
            "version": VERSION,
            **self._asked,
            "light": light,
            "tiles": len(records),
            "vertices": sum(record["vertices"] for record in records),
            "bytes": sum(about["bytes"] for record in records for about in record["files"].values()),
        }
        self._store.write_json(f"{self._folder}/report.json", report)
        output, seconds = self._store.path(self._folder), dict(self._stages.seconds)
        return {**report, "output": output, "seconds": seconds, **costs(self._steps.took.values())}

    def _join(self, records: list[dict[str, Any]]) -> None:
        """Write the index of the meshes, and that of the streamed splats."""
        store, tiles = self._store, self._city["tiles"]
        if "glb" in self._formats:
            named = (record | {"name": entry["name"]} for record, entry in zip(records, tiles, strict=True))
            full = [record for record in named if record["vertices"]]
            store.write_json(f"{self._folder}/tileset.json", tileset(full, "mesh.glb", None, self._plan.finest))
        leaves = [leaf for record in records for leaf in record.get("leaves", ())]
        if leaves:
            surrounded = bool(self._background) and store.read_json(self._environment)["splats"] > 0
            store.write_json(f"{self._folder}/{FOLDER}/{META}", lod_meta(leaves, surrounded))


def _city_of(store: Store) -> dict[str, Any]:
    """The content of city.json. Raises InputError without a city, or for one of a newer version."""
    if not store.exists(CITY):
        raise InputError(f"{store.root} holds no {CITY}: make a city with splat2mesh --tiles first")
    city = cast("dict[str, Any]", store.read_json(CITY))
    if city.get("schema_version", 0) > SCHEMA_VERSION:
        raise InputError(f"{store.root}: schema version {city['schema_version']}; update the tool")
    return city


def _begin(store: Store, folder: str, asked: dict[str, Any], overwrite: bool, resume: bool) -> None:
    """Make sure that a folder is empty or can be resumed. Raises InputError."""
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
