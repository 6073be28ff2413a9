"""Write a scene with ground truth to a folder: its splat, mesh, albedo, cameras and light."""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from splat2mesh.base import console
from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import check_output, staged_folder
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.splats.formats import write_inria_ply

from .cameras import SCENE_FROM_SPLAT, capture_views, seen_faces, write_colmap
from .kinds import KINDS, build
from .light import bake, exposure
from .splat import splats_from

EPILOG = """examples:
  python -m scenes tabletop
  python -m scenes room --kind room --splats 500000 --env sunset
  python -m scenes big --splats 6000000 --seed 3
"""


def main(arguments=None):
    """Parse the command line and run it; returns the exit code."""
    return console.run(_generate, _parser().parse_args(arguments))


def _parser():
    parser = argparse.ArgumentParser(
        "python -m scenes",
        description=__doc__,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="folder to write")
    parser.add_argument("--kind", choices=KINDS, default="tabletop", help="what to build (default: tabletop)")
    parser.add_argument("--splats", type=int, default=100_000, metavar="N", help="number of splats (default: 100000)")
    parser.add_argument("--vertices", type=int, default=45_000, metavar="N", help="about how many (default: 45000)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="another seed, another scene (default: 0)")
    parser.add_argument("--env", default="noon", metavar="NAME", help="built-in sky or image file (default: noon)")
    parser.add_argument("--views", type=int, default=64, metavar="N", help="number of cameras (default: 64)")
    parser.add_argument("--overwrite", action="store_true", help="replace OUT where it exists")
    parser.add_argument("--json", action="store_true", help="print truth.json instead of a summary")
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    parser.add_argument("-v", "--verbose", action="store_true", help="show the traceback of an error")
    return parser


def _generate(options):
    for name, least in (("splats", 100), ("views", 8), ("seed", 0)):
        if getattr(options, name) < least:
            raise InputError(f"--{name} {getattr(options, name)}: expected at least {least}")
    check_output(options.out, options.overwrite)
    from relight import Environment

    environment = Environment.load(options.env)
    truth = build(options.kind, options.seed, options.vertices)
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
    with staged_folder(options.out) as folder:
        write_inria_ply(folder / "splat.ply", splats)
        _write_truth_ply(folder / "truth.ply", truth, factor * radiance, seen_vertices)
        write_colmap(folder / "sparse" / "0", views)
        (folder / "truth.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    return [f"{options.out}: {facts['splats']} splats, {facts['vertices']} vertices, {facts['views']} views"], facts


def _write_truth_ply(path, truth, radiance, seen):
    """Binary PLY, scene frame: position, normal, linear albedo, baked sRGB colour, part, seen (0 or 1)."""
    layout = [("position", "<f4", 3), ("normal", "<f4", 3), ("albedo", "<f4", 3), ("color", "u1", 3)]
    vertex = np.zeros(len(truth.vertices), [*layout, ("part", "u1"), ("seen", "u1")])
    vertex["position"], vertex["normal"], vertex["albedo"] = (
        truth.vertices,
        truth.normals,
        truth.albedo_linear,
    )
    vertex["color"] = bytes_from_unit(srgb_from_linear(radiance))
    vertex["part"], vertex["seen"] = truth.part, seen
    face = np.zeros(len(truth.faces), [("count", "u1"), ("indices", "<i4", 3)])
    face["count"], face["indices"] = 3, truth.faces
    floats = ["x", "y", "z", "nx", "ny", "nz", "albedo_r", "albedo_g", "albedo_b"]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertex)}"]
    header += [f"property float {name}" for name in floats]
    header += [f"property uchar {name}" for name in ("red", "green", "blue", "part", "seen")]
    header += [f"element face {len(face)}", "property list uchar int vertex_indices", "end_header", ""]
    with open(path, "wb") as file:
        file.write("\n".join(header).encode("ascii"))
        vertex.tofile(file)
        face.tofile(file)


if __name__ == "__main__":
    sys.exit(main())
