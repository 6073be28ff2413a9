"""The splat2mesh command: arguments in, scene folder out. Holds no mathematics and imports nothing heavy."""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from .base.choices import DEFAULT_FPS
from .base.commandline import Parser, count
from .base.completion import add_completion, offer
from .base.console import Display, open_streams, peak_mb, run
from .base.errors import InputError
from .base.inputs import is_url
from .base.progress import Stages
from .base.requests import given, option_names
from .base.specs import vector
from .base.version import VERSION
from .options import CHOICES, ConvertOptions, TilingOptions

EXAMPLES = """examples:
  splat2mesh garden.ply                        writes the scene folder garden/
  splat2mesh bust.spz -o bust --vertices 20000 --detail fine
  splat2mesh garden.ply --cameras sparse/0     uses the cameras of the training
  splat2mesh plaza/lod-meta.json --lod 1       the second finest level of a streamed SOG
  splat2mesh robot/meta.json --plan            shows the plan, does nothing
  splat2mesh garden.spz --info                 what the file is and says, and what would be dropped
  splat2mesh room.json                         several splats in one scene, placed by a layout
  splat2mesh frames/ --sequence                numbered splats that move: a mesh for each, and one that plays
  splat2mesh city/ -o meshed --memory 4        a capture larger than memory, in tiles; --workers 8 shares the work

then: relight garden --env stpeters.exr --rotate 45"""

DEFAULT_TEXTURE = "auto"
"""Default texture of the command, for people who look at its output; the library makes one only on request."""

MESHING_WORDS: dict[str, Iterable[str]] = {
    **CHOICES,
    "vertices": ("auto",),
    "texture": ("auto", "none"),
    "lod": ("auto",),
}
"""Words that shells offer for the options of `add_meshing`, by field."""


def parser() -> argparse.ArgumentParser:
    """The command line of splat2mesh."""
    parser = Parser(
        prog="splat2mesh",
        description="Turn a trained Gaussian splat into a clean, chunked triangle mesh that relight can light.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        argument_default=argparse.SUPPRESS,
    )
    parser.signed = ("--up", "--eye")
    add = parser.add_argument
    add(
        "input",
        metavar="INPUT",
        help="splat: .ply (INRIA, 2DGS), .compressed.ply, .splat, .ksplat, .spz, .sog or its meta.json, .glb, .usd, "
        ".lcc, the lod-meta.json of a streamed SOG, a folder of tiles; or a layout .json",
    )
    add(
        "-o",
        "--output",
        metavar="SCENE",
        help="scene folder to write (default: the input's name without its suffixes)",
    )
    add_meshing(add, DEFAULT_TEXTURE)
    add("--seed", type=int, metavar="N", help=f"seed of the virtual views (default: {ConvertOptions.seed})")
    sequence = "INPUT is a folder of numbered splats, the frames of a sequence: also write frames/NAME.glb and "
    sequence += "sequence.glb, which plays them"
    add("--sequence", action="store_true", help=sequence)
    add("--fps", type=float, metavar="N", help=f"frames per second of sequence.glb (default: {DEFAULT_FPS:g})")
    add_tiling(parser)
    add("--overwrite", action="store_true", help="replace an existing scene folder")
    add("--plan", action="store_true", help="print what the command would do, and do nothing")
    add("--info", action="store_true", help="print what a splat or its cameras hold, and do nothing")
    add_display(add)
    add("--version", action="version", version=f"%(prog)s {VERSION}")
    add_completion(parser)
    offer(parser, MESHING_WORDS)
    return parser


def add_meshing(add: Callable[..., Any], default_texture: int | str = ConvertOptions.texture) -> None:
    """Add the options that are fields of ConvertOptions, which both commands have. add: `add_argument` of a group."""
    cameras = "cameras of the capture: a COLMAP folder such as sparse/0, a cameras.json of INRIA, a transforms.json of "
    cameras += "nerfstudio, or none (default: the cameras.json of INRIA's output folder, else virtual views)"
    add("--cameras", metavar="PATH", help=cameras)
    lod = "level of a streamed SOG, 0 is the finest; auto: the finest of at most 6 million splats (default: auto)"
    add("--lod", metavar="N", help=lod)
    vertices = "size of the mesh; auto: 50,000 for an object, up to 400,000 for a place (default: auto)"
    add("--vertices", metavar="N", help=vertices)
    most = f"largest chunk of the mesh (default: {ConvertOptions.max_chunk_vertices})"
    add("--max-chunk-vertices", type=int, metavar="N", help=most)
    up = "up axis of the splat: +y, -y, +z, -z, or auto: from the cameras, or else the floor of a place, or "
    up += "else -y (default: auto)"
    add("--up", metavar="AXIS", help=up)
    add("--detail", metavar="LEVEL", help=f"draft, normal or fine (default: {ConvertOptions.detail})")
    surface = f"field, or sugar: as in the SuGaR paper (default: {ConvertOptions.surface})"
    add("--surface", metavar="WAY", help=surface)
    background = "far background of an open scene: cut, or keep, which blocks the sky of a new light "
    add("--background", metavar="WHAT", help=f"{background}(default: {ConvertOptions.background})")
    stand = f"where the capture stood: auto, inside, outside (default: {ConvertOptions.stand})"
    add("--from", dest="stand", metavar="WHERE", help=stand)
    eye = "a position of the capture, in the splat's own frame; repeatable"
    add("--eye", dest="eyes", action="append", metavar="X,Y,Z", help=eye)
    foliage = "leaves and grass in the mesh: mesh (as surfaces), cards (small quads), none (left out) "
    add("--foliage", metavar="WHAT", help=f"{foliage}(default: {ConvertOptions.foliage})")
    texture = "side of the texture of mesh.glb in texels; auto: as fine as the splats, up to 4,096; none: no mesh.glb "
    add("--texture", metavar="N", help=f"{texture}(default: {default_texture})")
    proxy = "also write proxy.glb for collisions: closed (one surface around the mesh) or convex (parts)"
    add("--proxy", metavar="KIND", help=proxy)


def add_tiling(parser: argparse.ArgumentParser) -> None:
    """Add the options of cities in tiles, which both commands have."""
    add = parser.add_argument_group("cities in tiles").add_argument
    add("--tiles", action="store_true", help="work in tiles, in bounded memory; any option of this group implies it")
    add("--memory", type=float, metavar="GIB", help="memory for each process; sets the size of the tiles")
    add("--workers", type=int, metavar="N", help="number of processes on this machine that share the tiles")
    add(
        "--scheduler",
        metavar="ADDRESS",
        help="scheduler of dask.distributed whose workers share the tiles, such as tcp://host:8786",
    )
    add("--resume", action="store_true", help="continue where a run with the same settings stopped")


def add_display(add: Callable[..., Any]) -> None:
    """Add the options of Display, which both commands have. add: `add_argument` of a parser or a group."""
    add("--json", action="store_true", help="print the result as one JSON object")
    add("-q", "--quiet", action="store_true", help="no progress, no summary")
    add("-v", "--verbose", action="store_true", help="stage times, and tracebacks of errors")


def convert_options(words: argparse.Namespace) -> ConvertOptions:
    """Return the mesh options of a command line. Raises InputError for words that mean nothing."""
    said = given(ConvertOptions, words)
    if "up" in said:
        up = said["up"].lower()
        said["up"] = f"+{up}" if up in "xyz" else up
    if "vertices" in said:
        said["vertices"] = _count(said["vertices"])
    if "texture" in said:
        said["texture"] = said["texture"].lower()
    if "eyes" in said:
        said["eyes"] = [vector("eyes", text) for text in said["eyes"]]
    return ConvertOptions(**said)


def tiling_options(words: argparse.Namespace) -> TilingOptions | None:
    """Return the options of a city, or None without any."""
    said = given(TilingOptions, words)
    return TilingOptions(**said) if said or hasattr(words, "tiles") else None


def display_options(words: argparse.Namespace) -> Display:
    """Return the output of a command."""
    return Display(**given(Display, words))


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    open_streams()
    words = parser().parse_args(arguments)
    display = display_options(words)
    return run(lambda: _command(words, display), display, option_names(parser()))


def _command(words: argparse.Namespace, display: Display) -> tuple[list[str], Any]:
    if not os.path.exists(words.input) and "://" not in words.input:
        raise InputError(f"{words.input}: no such file")
    options, tiling = convert_options(words), tiling_options(words)
    if hasattr(words, "sequence") and (tiling is not None or hasattr(words, "plan")):
        raise InputError(f"--{'plan' if tiling is None else 'tiles'}: not supported for a sequence; leave it out")
    if hasattr(words, "fps") and not hasattr(words, "sequence"):
        raise InputError("--fps: it belongs to --sequence; give that too")
    if hasattr(words, "info"):
        from .info import info_of, lines_of

        found = info_of(words.input, options)
        return lines_of(found), found
    return _meshed(words, display, options, tiling)


def _meshed(
    words: argparse.Namespace, display: Display, options: ConvertOptions, tiling: TilingOptions | None
) -> tuple[list[str], Any]:
    from .api import mesh_files, mesh_sequence, plan_mesh

    if not hasattr(words, "texture") and tiling is None and not is_url(words.input):
        options = ConvertOptions.of(options, texture=DEFAULT_TEXTURE)
    start, stages = time.perf_counter(), Stages(show=display.progress)
    try:
        if hasattr(words, "plan"):
            found = plan_mesh(words.input, options, tiling=tiling, stages=stages)
            return _plan_lines(found), found
        where, overwrite = (words.input, getattr(words, "output", None), options), hasattr(words, "overwrite")
        if hasattr(words, "sequence"):
            meshed = mesh_sequence(*where, overwrite=overwrite, stages=stages, fps=getattr(words, "fps", DEFAULT_FPS))
        else:
            meshed = mesh_files(*where, overwrite=overwrite, stages=stages, tiling=tiling)
    finally:
        stages.close()
    seconds = time.perf_counter() - start
    if meshed.scene is None:
        lines, result = _city_lines(meshed.report, seconds), meshed.report
    else:
        from .summary import extras_of, summary_of

        output = Path(meshed.output)
        lines = summary_of(meshed.scene, output, seconds) + extras_of(meshed.scene, output)
        lines += [*meshed.notes, f"  next: relight {output} --env sunset"]
        result = {**meshed.report, "peak_mb": peak_mb()}
    if display.verbose:
        lines += [f"  {label:<16}{value:7.2f} s" for label, value in stages.seconds.items()]
    return lines, result


def _city_lines(report: dict[str, Any], seconds: float) -> list[str]:
    return [
        f"{report['scene']}: {report['vertices']:,} vertices, {report['faces']:,} faces in {report['tiles']} tiles, "
        f"from {report['splats']:,} splats, {seconds:.1f} s, at most {report['peak_mb'] / 1024:.2f} GiB in a process"
    ]


def _plan_lines(found: dict[str, Any]) -> list[str]:
    if "tile_splats" in found:
        from .tiles.city import lines_of

        return lines_of(found)
    if "objects" not in found:
        return _listed(found)
    lines = _listed({"splats": found["splats"]})
    for name, planned in found["objects"].items():
        lines += ["", f"{name}:", *_listed(planned)]
    return lines


def _listed(result: dict[str, Any]) -> list[str]:
    return [f"{label:<24}{value}" for label, value in result.items()]


def _count(text: str) -> int | None:
    """A number of vertices, or None for auto."""
    return None if text == "auto" else count("--vertices", text)


if __name__ == "__main__":
    sys.exit(main())
