"""The network of the Neural-GASh paper against every other method of transfer: error, radiance under lights, time.

Errors are relative L2 against thousands of rays. Time is the least of some runs, in processor seconds of all
threads, with all preparation that a method needs (including the ray tracer's tree).
"""

from pathlib import Path

import numpy as np

from benchmarks.harness import geometric_mean, relative_error, timed
from benchmarks.shapes import MADE_VERTICES, shape
from relight import Environment
from relight.transfer.analytic import analytic
from relight.transfer.neuralgash import neural_gash
from relight.transfer.raytraced import raytraced, raytraced_scene

BANDS = 3  # that the network has
MOST_IN_FULL = 100_000
"""Vertices up to which all of a mesh is compared: a place has more, and its reference would take minutes."""
QUICK = ["tabletop", "--made", "3000", "--rays", "8", "--repeats", "1", "--reference", "256"]
PLOT = {"x": "seconds", "y": "transfer", "by": ("scene", "method")}


def arguments(parser):
    parser.add_argument("scenes", nargs="*", metavar="SCENE", default=["object", "tabletop"])
    parser.add_argument("--env", nargs="+", default=["studio", "sunset"], metavar="FILE|NAME")
    parser.add_argument("--rays", type=int, nargs="+", default=[8, 16, 32, 64])
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--reference", type=int, default=4096, help="rays of the reference")
    parser.add_argument("--made", type=int, default=MADE_VERTICES, metavar="N", help="vertices of generated scenes")
    parser.add_argument("--vertices", type=int, default=3000, help=f"drawn from meshes of more than {MOST_IN_FULL:,}")


def run(options, report):
    meshes = [shape(name, options.made) for name in options.scenes]
    lights = {Path(name).stem: Environment.load(name).sh(BANDS) for name in options.env}
    columns = {"method": "<16", "transfer": ".4f"} | dict.fromkeys(lights, ".4f")
    columns |= {"seconds": ".4f", "vertices_per_s": ",.0f"}
    rows = [row for mesh in meshes for row in every_method(mesh, lights, columns, options, report)]
    table = report.table("geometric means over the scenes", **columns)
    for method in dict.fromkeys(row["method"] for row in rows):
        of = [row for row in rows if row["method"] == method]
        table.add(method=method, **{key: geometric_mean([row[key] for row in of]) for key in list(of[0])[2:]})


def methods(mesh, rays):
    """Name -> function that gives the transfer (V, K) of a mesh, from nothing but its arrays."""
    ways = {
        "analytic": lambda: analytic(mesh.normals, BANDS),
        "neural-gash": lambda: neural_gash(mesh.vertices, mesh.normals),
    }
    for count in rays:
        ways[f"rays alone {count}"] = lambda r=count: raytraced(mesh.occluder, slice(None), BANDS, r)
        ways[f"raytraced {count}"] = lambda r=count: raytraced_scene(mesh.occluder, BANDS, r)
    return ways


def every_method(mesh, lights, columns, options, report):
    """A row for each method on one scene; returns them."""
    count = len(mesh.vertices)
    drawn = slice(None)
    if count > MOST_IN_FULL:
        drawn = np.random.default_rng(0).choice(count, min(options.vertices, count), replace=False)
    reference = raytraced(mesh.occluder, drawn, BANDS, options.reference, seed=2**32)
    table = report.table(f"{mesh.name}: {count:,} vertices", **columns)
    for method, way in methods(mesh, options.rays).items():
        transfer, seconds = least(way, options.repeats)
        transfer = transfer[drawn]
        row = {"scene": mesh.name, "method": method, "transfer": relative_error(transfer, reference)}
        row |= {name: relative_error(transfer @ light, reference @ light) for name, light in lights.items()}
        table.add(**row, seconds=seconds, vertices_per_s=count / seconds)
    return table.rows


def least(work, repeats):
    """Result of the last, and the least processor seconds of several calls."""
    runs = [timed(work) for _ in range(repeats)]
    return runs[-1].result, min(run.cpu for run in runs)
