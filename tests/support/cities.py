"""A small city in tiles for tests: generated, and rendered with few pixels."""

from argparse import Namespace
from hashlib import sha256
from pathlib import Path

from relight.request import RelightRequest
from relight.tiles.city import relight_city
from scenes.city import write_city
from splat2mesh.base.progress import Stages
from splat2mesh.options import ConvertOptions, TilingOptions
from splat2mesh.tiles import survey
from splat2mesh.tiles.city import city_in_steps
from splat2mesh.tiles.store import Store
from splat2mesh.tiles.tasks import Loop, TaskSteps

SPLATS, TILE_SPLATS, PIXELS = 24_000, 9_000, 40


def few_pixels(patch):
    """Let views be so small that a city takes seconds."""
    patch.setitem(survey.PIXELS, "draft", PIXELS)


def generated(folder):
    """A city of four blocks in a new folder; returns the folder of its tiles."""
    write_city(Namespace(out=Path(folder), splats=SPLATS, seed=0, env="noon"))
    return Path(folder) / "tiles"


def meshed(source, output, engine=None, **settings):
    """The report of `city_in_steps`, at the cheapest."""
    wanted = {"detail": "draft", "tile_splats": TILE_SPLATS, "up": "-y", **settings}
    tiling = TilingOptions(**{name: wanted.pop(name) for name in ("memory", "tile_splats", "resume") if name in wanted})
    overwrite, stages = wanted.pop("overwrite", False), wanted.pop("stages", None) or Stages()
    steps = TaskSteps(Store(output), engine or Loop(), stages)
    return city_in_steps(source, steps, ConvertOptions(**wanted), tiling, overwrite)


def relit_city(city, env, options, engine=None, stages=None, folder=None, memory=None, resume=False, **fields):
    """The report of `relight_city` in this process."""
    tiling = TilingOptions(memory=memory, resume=resume)
    request = RelightRequest(city, env, options, tiling=tiling, **fields)
    return relight_city(request, engine or Loop(), folder=folder, stages=stages)


def sums(folder):
    """SHA-256 of every file of a folder, by its name; of a run's own records none."""
    folder = Path(folder)
    return {
        path.relative_to(folder).as_posix(): sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
