"""The network of the Neural-GASh paper against every other method of transfer: error, radiance under lights, time.

Errors are relative L2 against thousands of rays; mse and sd are mean and standard deviation, over the vertices, of the
squared error of their nine coefficients, in units of 1e-4. Time is the least of some runs, in
processor seconds of all threads, with all preparation that a method needs (including the ray tracer's tree).
"""

from pathlib import Path

import numpy as np

from benchmarks.harness import geometric_mean, relative_error, timed
from benchmarks.shapes import MADE_VERTICES, shape
from relight import Environment
from relight.sh.cga import vertex_motors
from relight.transfer.analytic import analytic
from relight.transfer.neuralgash import BATCH, MODEL, UnitFrame, neural_gash
from relight.transfer.sessions import open_session
from relight.transfer.visibility import raytraced_scene
from scenes.plain_rays import raytraced

BANDS = 3  # that the network has
MOST_IN_FULL = 100_000
"""Vertices up to which all of a mesh is compared: a place has more, and its reference would take minutes."""
UNIT = UnitFrame(np.zeros(3), 1.0)
QUICK = ["tabletop", "--made", "3000", "--rays", "8", "--repeats", "1", "--reference", "256"]
PLOT = {"x": "seconds", "y": "transfer", "by": ("scene", "method")}


def arguments(parser):
    parser.add_argument("scenes", nargs="*", metavar="SCENE", default=["object", "tabletop"])
    parser.add_argument("--env", nargs="+", default=["studio", "sunset"], metavar="FILE|NAME")
    parser.add_argument("--rays", type=int, nargs="+", default=[8, 16, 32, 64])
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--reference", type=int, default=4096, help="rays of the reference")
    parser.add_argument("--made", type=int, default=MADE_VERTICES, metavar="N", help="vertices of generated scenes")
    parser.add_argument(
        "--sessions", type=int, default=0, metavar="N", help="chunks of 10,000 vertices: time of a pool"
    )
    parser.add_argument("--vertices", type=int, default=3000, help=f"drawn from meshes of more than {MOST_IN_FULL:,}")


def run(options, report):
    meshes = [shape(name, options.made) for name in options.scenes]
    lights = {Path(name).stem: Environment.load(name).sh(BANDS) for name in options.env}
    columns = {"method": "<16", "transfer": ".4f", "mse": ".2f", "sd": ".2f"} | dict.fromkeys(lights, ".4f")
    columns |= {"seconds": ".4f", "vertices_per_s": ",.0f"}
    rows = [row for mesh in meshes for row in every_method(mesh, lights, columns, options, report)]
    table = report.table("geometric means over the scenes", **columns)
    for method in dict.fromkeys(row["method"] for row in rows):
        of = [row for row in rows if row["method"] == method]
        table.add(method=method, **{key: geometric_mean([row[key] for row in of]) for key in list(of[0])[2:]})
    seam(report)
    if options.sessions:
        pool(options.sessions, options.repeats, report)


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
        squared = 1e4 * np.square(transfer - reference).mean(axis=1)
        row |= {"mse": float(squared.mean()), "sd": float(squared.std())}
        row |= {name: relative_error(transfer @ light, reference @ light) for name, light in lights.items()}
        table.add(**row, seconds=seconds, vertices_per_s=count / seconds)
    return table.rows


def seam(report, lean=5e-5, count=1000):
    """What the network makes of two normals on either side of straight down: the motor's rotor changes sign there.

    Against it, the same pairs about another normal, where the rotor does not.
    """
    rng = np.random.default_rng(0)
    turn = rng.uniform(0.0, 2.0 * np.pi, count)
    side = lean * np.stack([np.cos(turn), np.zeros(count), np.sin(turn)], axis=1)
    points = rng.uniform(-0.55, 0.55, (2 * count, 3))  # within the unit ball, as all of a scene
    points[count:] = points[:count]
    for name, axis in (("straight down", [0.0, -1.0, 0.0]), ("straight up", [0.0, 1.0, 0.0])):
        normals = np.concatenate([axis + side, axis - side])
        one, other = np.split(neural_gash(points, normals, frame=UNIT), 2)
        apart = np.linalg.norm(one - other, axis=1) / np.linalg.norm(one, axis=1)
        report.note(
            f"normals {2 * lean} apart, {name}: transfers apart by {apart.mean():.2%}, at most {apart.max():.2%}"
        )


def pool(chunks, repeats, report, size=10_000):
    """The network on chunks of a scene: a session for each, as in the paper, or one for all."""
    rng = np.random.default_rng(0)
    points, normals = rng.uniform(-0.55, 0.55, (chunks * size, 3)), rng.normal(size=(chunks * size, 3))
    motors = vertex_motors(points, normals)
    parts = np.split(motors, chunks)
    opened = [timed(lambda: open_session(MODEL, 1)) for _ in parts]
    sessions = [each.result for each in opened]

    def run(session, rows, batch):
        for start in range(0, len(rows), batch):
            session.run(None, {"motor": rows[start : start + batch]})

    table = report.table(f"{chunks} chunks of {size:,} vertices", sessions="<30", seconds=".3f")
    of = {f"one, batches of {BATCH:,}": lambda: run(sessions[0], motors, BATCH)}
    of["one, one batch"] = lambda: run(sessions[0], motors, len(motors))
    of["one a chunk, one batch each"] = lambda: [run(*each, size) for each in zip(sessions, parts, strict=True)]
    of[f"one a chunk, batches of {BATCH:,}"] = lambda: [run(*each, BATCH) for each in zip(sessions, parts, strict=True)]
    for name, work in of.items():
        table.add(sessions=name, seconds=least(work, repeats)[1])
    report.note(f"a session takes {min(each.cpu for each in opened):.3f} processor s to open")


def least(work, repeats):
    """Result of the last, and the least processor seconds of several calls."""
    runs = [timed(work) for _ in range(repeats)]
    return runs[-1].result, min(run.cpu for run in runs)
