"""The splat2mesh command: arguments in, scene folder out. Holds no mathematics and imports nothing heavy."""

import argparse
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

from .base.commandline import Parser, chosen
from .base.console import peak_mb, run, wants_progress
from .base.manual import add_manuals
from .base.version import VERSION

EXAMPLES = """examples:
  splat2mesh garden.ply                        writes the scene folder garden/
  splat2mesh bust.spz -o bust --vertices 20000 --detail fine
  splat2mesh garden.ply --cameras sparse/0     looks from the cameras it was trained with
  splat2mesh plaza/lod-meta.json --lod 1       a streamed SOG, its second finest level
  splat2mesh robot/meta.json --plan            shows what would be done, does nothing
  splat2mesh room.json                         several splats, placed as the layout says, in one scene
  splat2mesh city/ -o meshed --memory 4        a capture larger than memory, tile by tile; --workers 8 shares the work

then: relight garden --env stpeters.exr --rotate 45"""


def parser() -> argparse.ArgumentParser:
    """The command line of splat2mesh."""
    parser = Parser(
        prog="splat2mesh",
        description="Turn a trained Gaussian splat into a clean, chunked triangle mesh that relight can light.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.signed = ("--up", "--eye")
    add = parser.add_argument
    add(
        "input",
        metavar="INPUT",
        help="splat: .ply (INRIA, 2DGS), .compressed.ply, .splat, .spz, .sog or its meta.json, the lod-meta.json of a "
        "streamed SOG, a folder of tiles; or a layout .json",
    )
    add(
        "-o",
        "--output",
        metavar="SCENE",
        help="scene folder to write (default: the input's name, without its suffixes)",
    )
    add(
        "--cameras",
        metavar="PATH",
        help="cameras of the capture: a COLMAP folder such as sparse/0, a cameras.json of INRIA, a transforms.json of "
        "nerfstudio, or none (default: the cameras.json of INRIA's output folder, else virtual views)",
    )
    add(
        "--lod",
        default="auto",
        metavar="N",
        help="level of a streamed SOG, 0 the finest; auto: the finest of at most 6 million splats "
        "(default: %(default)s)",
    )
    add(
        "--vertices",
        type=_count,
        default=None,
        metavar="N",
        help="size of the mesh; auto: 50,000 for an object, up to 400,000 for a place (default: auto)",
    )
    add("--max-chunk-vertices", type=int, default=40_000, metavar="N", help="limit of a chunk (default: %(default)s)")
    add(
        "--up",
        default="auto",
        metavar="AXIS",
        help="what is up in the splat: +y, -y, +z, -z, or auto: told by the cameras, else by the floor of a place, "
        "else -y (default: %(default)s)",
    )
    add("--detail", default="normal", metavar="LEVEL", help="draft, normal or fine (default: %(default)s)")
    add(
        "--surface",
        default="field",
        metavar="WAY",
        help="field, or sugar: the SuGaR paper's way (default: %(default)s)",
    )
    add(
        "--background",
        default="cut",
        metavar="WHAT",
        help="far background of an open scene: cut, or keep, which hides the light's sky (default: %(default)s)",
    )
    add(
        "--from",
        dest="stand",
        default="auto",
        metavar="WHERE",
        help="where the capture stood: auto, inside, outside (default: %(default)s)",
    )
    add(
        "--eye",
        action="append",
        type=_point,
        default=[],
        metavar="X,Y,Z",
        help="a place where the capture stood, in the splat's own frame; may be given several times",
    )
    add(
        "--proxy",
        metavar="KIND",
        help="proxy.glb too, for collisions in engines: closed (one surface around the mesh) or convex (parts)",
    )
    add("--seed", type=int, default=0, metavar="N", help="seed of the virtual views (default: %(default)s)")
    add_tiling(parser)
    add("--overwrite", action="store_true", help="replace a scene folder that exists")
    add("--plan", action="store_true", help="print what would be done, and do nothing")
    add("--json", action="store_true", help="print the result as one JSON object")
    add("-q", "--quiet", action="store_true", help="no progress, no summary")
    add("-v", "--verbose", action="store_true", help="stage times; the traceback of an error")
    add("--version", action="version", version=f"%(prog)s {VERSION}")
    add_manuals(parser)
    return parser


def add_tiling(parser: argparse.ArgumentParser) -> None:
    """The options of cities in tiles, which both commands have."""
    add = parser.add_argument_group("cities in tiles").add_argument
    add("--tiles", action="store_true", help="tile by tile, in bounded memory; any option of this group implies it")
    add("--memory", type=float, metavar="GIB", help="that a process may take: it sets the size of the tiles")
    add("--workers", type=int, metavar="N", help="processes on this machine that share the tiles")
    add(
        "--scheduler", metavar="ADDRESS", help="scheduler of dask.distributed whose workers do, such as tcp://host:8786"
    )
    add("--resume", action="store_true", help="go on where a run with the same settings stopped")


def wants_tiles(options: argparse.Namespace) -> bool:
    """Whether an option asks for a city in tiles."""
    return bool(options.tiles or options.resume) or any(
        value is not None for value in (options.memory, options.workers, options.scheduler)
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    return run(_command, parser().parse_args(arguments), {"stand": "--from", "eyes": "--eye"})


def _command(options: argparse.Namespace) -> tuple[list[str], Any]:
    from .base.errors import InputError
    from .base.outputs import check_output
    from .scene.folder import META, PICTURE, PROXY

    source = Path(options.input)
    if not os.path.exists(source) and "://" not in options.input:
        raise InputError(f"{source}: no such file")
    _understand(options)
    if wants_tiles(options) or "://" in options.input:
        from .tiles.command import mesh_city

        return mesh_city(options, parser().parse_args([options.input]), options.output or str(default_output(source)))
    output = Path(options.output or default_output(source))
    if options.plan:
        return _plan(options)
    check_output(output, options.overwrite, META)

    from .base.progress import Stages
    from .layout import convert_layout, is_layout
    from .pipeline import convert
    from .proxy import add_proxy, check_proxy

    check_proxy(options.proxy)
    start = time.perf_counter()
    stages = Stages(show=wants_progress(options))
    try:
        scene = (convert_layout if is_layout(source) else convert)(
            source,
            cameras=options.cameras,
            lod=options.lod,
            vertices=options.vertices,
            max_chunk_vertices=options.max_chunk_vertices,
            up=options.up,
            detail=options.detail,
            surface=options.surface,
            background=options.background,
            stand=options.stand,
            eyes=options.eye,
            seed=options.seed,
            stages=stages,
        )
        if options.proxy:
            with stages.stage("proxy"):
                add_proxy(scene, options.proxy, options.seed)
        with stages.stage("write"):
            scene.save(output, overwrite=options.overwrite)
    finally:
        stages.close()
    seconds = time.perf_counter() - start
    counts = scene.statistics
    lines = told(scene, output, seconds)
    lines += [f"  {output / PICTURE} shows splat and mesh"] * (scene.picture is not None)
    if options.proxy:
        bodies, faces = counts["proxy_bodies"], counts["proxy_faces"]
        named = "one closed surface" if options.proxy == "closed" else f"{bodies} convex parts"
        lines += [
            f"  {output / PROXY}: {named} of {faces:,} faces, within {2.5 * counts['proxy_voxel']:.2g} of the mesh"
        ]
    lines += [f"  next: relight {output} --env sunset"]
    if options.verbose:
        lines += [f"  {label:<16}{value:7.2f} s" for label, value in stages.seconds.items()]
    result = {
        "scene": str(output),
        "chunks": len(scene.chunks),
        **counts,
        "seconds": stages.seconds,
        "peak_mb": peak_mb(),
    }
    return lines, result


def told(scene: Any, output: Path, seconds: float | None = None) -> list[str]:
    """What a summary says of a Scene that was written: its size, and what told which way is up."""
    counts, took = scene.statistics, "" if seconds is None else f", {seconds:.1f} s"
    lines = [
        f"{output}: {counts['vertices']:,} vertices, {counts['faces']:,} faces in {len(scene.chunks)} chunks, "
        f"from {counts['splats']:,} splats{_level(scene)}{took}"
    ]
    objects = scene.settings.get("objects") or {"": scene.settings}
    for name, settings in objects.items():
        if settings.get("up_from", "asked for") != "asked for":
            lines.append(f"  up{f' of {name}' if name else ''}: {settings['up_from']} (--up overrules)")
    return lines


def _understand(options: argparse.Namespace) -> None:
    """Put the words of options into the form that the library knows. Raises InputError for others."""
    from .surface.extract import EFFORTS, WAYS
    from .views.standpoints import CHOICES
    from .views.upright import UP_CHOICES

    up = options.up.lower()
    options.up = chosen("--up", f"+{up}" if up in "xyz" else up, UP_CHOICES)
    options.detail = chosen("--detail", options.detail, EFFORTS)
    options.surface = chosen("--surface", options.surface, WAYS)
    options.proxy = options.proxy and chosen("--proxy", options.proxy, ("closed", "convex"))
    options.background = chosen("--background", options.background, ("cut", "keep"))
    options.stand = chosen("--from", options.stand, CHOICES)


def _level(scene: Any) -> str:
    return f" of level {scene.source['lod']}" if "lod" in scene.source else ""


def _plan(options: argparse.Namespace) -> tuple[list[str], Any]:
    from .layout import is_layout, plan_layout
    from .pipeline import plan

    names = ("cameras", "lod", "up", "detail", "surface", "background", "stand")
    settings = {name: getattr(options, name) for name in names} | {"eyes": options.eye}
    if not is_layout(options.input):
        result = plan(options.input, **settings)
        return _listed(result), result
    result = plan_layout(options.input, **settings)
    lines = _listed({"splats": result["splats"]})
    for name, planned in result["objects"].items():
        lines += ["", f"{name}:", *_listed(planned)]
    return lines, result


def _listed(result: dict[str, Any]) -> list[str]:
    return [f"{label:<24}{value}" for label, value in result.items()]


def _count(text: str) -> int | None:
    """A number of vertices, or None for auto."""
    return None if text == "auto" else int(text)


def _point(text: str) -> tuple[float, ...]:
    """Three numbers with commas between them."""
    point = tuple(float(part) for part in text.split(","))
    if len(point) != 3 or not all(map(math.isfinite, point)):
        raise ValueError(text)
    return point


def default_output(source: Path) -> str:
    """The input's name, in the current folder; never the folder that is the input."""
    source = source.resolve()
    if source.name in ("meta.json", "lod-meta.json"):
        source = source.parent
    name = source.name.split(".")[0] or "scene"
    return f"{name}_scene" if Path(name).resolve() == source else name


if __name__ == "__main__":
    sys.exit(main())
