"""Write a scene with ground truth to a folder: its splat, mesh, albedo, cameras and light.

Objects: object, tabletop, room (open), figure, machine, still-life. Places: garden, courtyard, street, lounge (closed,
two windows, a lamp), nook (an open box), blocks (in no order); small and hard on light: closed-box, forest, cabinet,
one-window, white-sky.
Gloss: ceramics, with harmonics of degree 3.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from splat2mesh.base import console
from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import check_output, staged_folder
from splat2mesh.base.requests import option_names
from splat2mesh.splats.formats import write_inria_ply

from .cameras import SCENE_FROM_SPLAT, capture_views, seen_faces, write_colmap
from .city import write_city
from .files import write_ceramics, write_place, write_truth_ply
from .kinds import KINDS, build
from .light import bake, exposure
from .places import PLACES
from .splat import splats_from

EPILOG = """examples:
  python -m scenes tabletop
  python -m scenes room --kind room --splats 500000 --env sunset
  python -m scenes garden --kind garden --env cloudy --relit sunset
  python -m scenes big --splats 6000000 --seed 3
  python -m scenes table --kind ceramics --env studio --relit noon
  python -m scenes city --kind city --splats 30e6
"""


def main(arguments=None):
    """Parse the command line and run it; returns the exit code."""
    options = _parser().parse_args(arguments)
    display = console.Display(options.json, options.quiet, options.verbose)
    return console.run(lambda: _generate(options), display, option_names(_parser()))


def _parser():
    parser = argparse.ArgumentParser(
        "python -m scenes",
        description=__doc__,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="folder to write")
    parser.add_argument(
        "--kind",
        choices=[*KINDS, *PLACES, "ceramics", "city"],
        default="tabletop",
        help="what to build (default: tabletop)",
    )
    parser.add_argument(
        "--splats", type=_whole, default=100_000, metavar="N", help="number of splats (default: 100000)"
    )
    parser.add_argument("--vertices", type=int, metavar="N", help="about how many (default: 45000; places: 60000)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="another seed, another scene (default: 0)")
    parser.add_argument(
        "--env", default="noon", metavar="NAME", help="built-in sky, image file, or cloudy (default: noon)"
    )
    parser.add_argument(
        "--relit",
        action="append",
        default=[],
        metavar="NAME",
        help="places, ceramics: write the truth under this sky too; again for more",
    )
    parser.add_argument("--lamps", type=float, default=1.0, metavar="X", help="factor on a place's lamps under --relit")
    parser.add_argument("--degree", type=int, default=0, choices=(0, 1), help="of a place's harmonics (default: 0)")
    parser.add_argument("--matte", action="store_true", help="ceramics: without glaze, its metals painted")
    parser.add_argument("--views", type=int, default=64, metavar="N", help="number of cameras (default: 64)")
    parser.add_argument("--overwrite", action="store_true", help="replace OUT where it exists")
    parser.add_argument("--json", action="store_true", help="print truth.json instead of a summary")
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    parser.add_argument("-v", "--verbose", action="store_true", help="show the traceback of an error")
    return parser


def _whole(text):
    """A whole number, also written as 30e6."""
    if not float(text).is_integer():
        raise ValueError(text)
    return int(float(text))


def _generate(options):
    for name, least in (("splats", 100), ("views", 8), ("seed", 0)):
        if getattr(options, name) < least:
            raise InputError(f"--{name} {getattr(options, name)}: expected at least {least}")
    check_output(options.out, options.overwrite)
    if options.kind in PLACES:
        return write_place(options)
    if options.matte and options.kind != "ceramics":
        raise InputError(f"--kind {options.kind}: --matte is for ceramics")
    if options.kind == "ceramics":
        return write_ceramics(options)
    if options.kind == "city":
        return write_city(options)
    if options.relit or options.degree:
        raise InputError(f"--kind {options.kind}: --relit and --degree are for places: {' '.join(PLACES)}")
    from relight import Environment

    environment = Environment.load(options.env)
    truth = build(options.kind, options.seed, options.vertices or 45_000)
    views = capture_views(truth, options.views)
    seen = seen_faces(truth, views)
    radiance = bake(truth, environment)
    seen_vertices = np.zeros(len(truth.vertices), bool)
    seen_vertices[truth.faces[seen]] = True
    factor = exposure(radiance[seen_vertices])
    splats = splats_from(truth, factor * radiance, options.splats, options.seed, seen)
    facts = {
        "kind": truth.kind,
        "seed": truth.seed,
        "environment": options.env,
        "exposure": float(factor),
        "splats": len(splats),
        "vertices": len(truth.vertices),
        "faces": len(truth.faces),
        "views": len(views),
        "bounds": [truth.vertices.min(axis=0).tolist(), truth.vertices.max(axis=0).tolist()],
        "scene_from_splat": SCENE_FROM_SPLAT.tolist(),
    }
    with staged_folder(options.out, options.overwrite) as folder:
        write_inria_ply(folder / "splat.ply", splats)
        write_truth_ply(folder / "truth.ply", truth, factor * radiance, seen_vertices)
        write_colmap(folder / "sparse" / "0", views)
        (folder / "truth.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    return [f"{options.out}: {facts['splats']} splats, {facts['vertices']} vertices, {facts['views']} views"], facts


if __name__ == "__main__":
    sys.exit(main())
