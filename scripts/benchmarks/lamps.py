"""Placed lamps: error and time by rays for each kind, and time by the number of lamps.

Errors are relative L2 norms of direct light over all vertices, against --reference rays. Of many lamps, which share the
light of one, the time of a vertex and the error against each lamp by itself, on some of the vertices.
"""

import numpy as np

from benchmarks.harness import relative_error, timed
from benchmarks.shapes import MADE_VERTICES, shape
from relight.lamps.emitters import emitters_of
from relight.lamps.shapes import RectangleLamp, SphereLamp, TubeLamp
from relight.lamps.tracing import lamplight
from relight.transfer.occluder import Frame, Occluder

QUICK = ["--vertices", "1000", "--counts", "1", "60", "--rays", "8", "16", "--reference", "32", "--probes", "50"]


def arguments(parser):
    parser.add_argument("mesh", nargs="?", default="tabletop")
    parser.add_argument("--vertices", type=int, default=MADE_VERTICES, help="of a generated mesh")
    parser.add_argument("--rays", type=int, nargs="+", default=[8, 16, 32, 64, 128])
    parser.add_argument("--reference", type=int, default=1024, metavar="RAYS")
    parser.add_argument("--counts", type=int, nargs="+", default=[1, 10, 100, 1000, 10_000])
    parser.add_argument(
        "--probes", type=int, default=400, help="vertices at which each of many lamps is traced by itself"
    )


def run(options, report):
    mesh = shape(options.mesh, options.vertices)
    occluder = Occluder(mesh.vertices, mesh.normals, mesh.faces)
    frame = Frame.around(mesh.vertices, mesh.faces)
    report.note(f"{len(mesh.vertices):,} vertices, {len(mesh.faces):,} faces")
    by_kind(occluder, frame, options, report)
    by_number(occluder, frame, options, report)


def by_kind(occluder, frame, options, report):
    """Error and time of each kind by rays."""
    size = frame.diagonal
    x, y, z = frame.center + np.array([0.01, 0.35, 0.01]) * size
    lamps = {
        "bulb": SphereLamp((x, y, z), 0.02 * size, (9.0,) * 3),
        "globe": SphereLamp((x, y, z), 0.1 * size, (1.0,) * 3),
        "panel": RectangleLamp((x, y, z), (0.3 * size, 0, 0), (0, 0, 0.2 * size), (1.0,) * 3),
        "tube": TubeLamp((x, y, z), (x + 0.3 * size, y, z), 0.005 * size, (9.0,) * 3),
    }
    table = report.table("each kind", lamp="<6", rays="d", error=".4f", seconds=".3f")
    for name, lamp in lamps.items():
        emitters = emitters_of([lamp], frame.center, size)
        true = lamplight(occluder, emitters, options.reference, seed=1)
        for rays in options.rays:
            found, seconds, _ = timed(lambda n=rays, e=emitters: lamplight(occluder, e, n))
            table.add(lamp=name, rays=rays, error=relative_error(found, true), seconds=seconds)


def by_number(occluder, frame, options, report):
    """Time of a vertex by the number of lamps, and the error that the choice among them makes."""
    rng = np.random.default_rng(0)
    probes = np.sort(rng.choice(len(occluder.origins), min(options.probes, len(occluder.origins)), replace=False))
    table = report.table("by number, 32 rays", lamps="d", microseconds=".2f", error=".4f")
    for count in options.counts:
        places = frame.center + frame.diagonal * rng.uniform((-0.5, 0.1, -0.5), (0.5, 0.4, 0.5), (count, 3))
        bulbs = [SphereLamp(tuple(place), 0.002 * frame.diagonal, (900.0 / count,) * 3) for place in places]
        emitters = emitters_of(bulbs, frame.center, frame.diagonal)
        found, seconds, _ = timed(lambda e=emitters: lamplight(occluder, e, 32))
        true = sum(lamplight(occluder, emitters.of_lamp(number), 32, rows=probes) for number in range(count))
        error = relative_error(found[probes], true)
        table.add(lamps=count, microseconds=1e6 * seconds / len(found), error=error)
