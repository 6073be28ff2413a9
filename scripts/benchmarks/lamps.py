"""Placed lamps: error and time by rays for each kind, time by the number of lamps, and time of a change in a session.

Errors are relative L2 norms of direct light over all vertices, against --reference rays. For many lamps that share the
light of one: the time of a vertex and the error against all of them, on some of the vertices, with 32 rays and with
those of a plan for --tolerance. For a change in a session, each line the median of --changes: the light that is shown
at once, its picture (in software, where OpenGL is), exact shadows, and the full result of a relight.
"""

import os
import time

import numpy as np

from benchmarks.harness import relative_error, timed
from benchmarks.shapes import MADE_VERTICES, shape
from relight import LightingOptions, RelightRequest
from relight.jobs.job import Job
from relight.jobs.session import session_of
from relight.lamps.emitters import emitters_of
from relight.lamps.shapes import RectangleLamp, SphereLamp, TubeLamp
from relight.lamps.tracing import lamplight, ordered
from relight.planning.lamp_plan import plan_lamps
from relight.transfer.occluder import Frame, Occluder

QUICK = [
    "--vertices",
    "1000",
    "--counts",
    "1",
    "60",
    "--rays",
    "8",
    "16",
    "--reference",
    "32",
    "--probes",
    "50",
    "--changes",
    "2",
]


def arguments(parser):
    parser.add_argument("mesh", nargs="?", default="tabletop")
    parser.add_argument("--vertices", type=int, default=MADE_VERTICES, help="of a generated mesh")
    parser.add_argument("--rays", type=int, nargs="+", default=[8, 16, 32, 64, 128])
    parser.add_argument("--reference", type=int, default=1024, metavar="RAYS")
    parser.add_argument("--counts", type=int, nargs="+", default=[1, 10, 100, 1000, 10_000])
    parser.add_argument("--probes", type=int, default=400, help="vertices at which all of many lamps are traced")
    parser.add_argument("--tolerance", type=float, default=0.03, help="of the plan for many lamps")
    parser.add_argument("--changes", type=int, default=15, help="of lamps in a session, for each line")
    parser.add_argument("--edit", action="store_true", help="only the cost of a change in a session")


def run(options, report):
    mesh = shape(options.mesh, options.vertices)
    occluder = Occluder(mesh.vertices, mesh.normals, mesh.faces)
    frame = Frame.around(mesh.vertices, mesh.faces)
    report.note(f"{len(mesh.vertices):,} vertices, {len(mesh.faces):,} faces")
    if not options.edit:
        by_kind(occluder, frame, options, report)
        by_number(occluder, frame, options, report)
    by_change(mesh, frame, options, report)


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
        true = lamplight(occluder, emitters, options.reference, at=ordered(occluder, seed=1))
        for rays in options.rays:
            found, seconds, _ = timed(lambda n=rays, e=emitters: lamplight(occluder, e, n))
            table.add(lamp=name, rays=rays, error=relative_error(found, true), seconds=seconds)


def by_number(occluder, frame, options, report):
    """Time of a vertex by the number of lamps, and the error that the choice among them makes."""
    rng = np.random.default_rng(0)
    probes = np.sort(rng.choice(len(occluder.origins), min(options.probes, len(occluder.origins)), replace=False))
    columns = {"microseconds": ".2f", "error": ".4f", "planned": "d", "predicted": ".4f", "true": ".4f"}
    table = report.table(f"by number, 32 rays; planned for {options.tolerance:g}", lamps="d", **columns, plan_s=".2f")
    nothing = np.zeros_like(occluder.origins)
    for count in options.counts:
        places = frame.center + frame.diagonal * rng.uniform((-0.5, 0.1, -0.5), (0.5, 0.4, 0.5), (count, 3))
        bulbs = [SphereLamp(tuple(place), 0.002 * frame.diagonal, (900.0 / count,) * 3) for place in places]
        emitters = emitters_of(bulbs, frame.center, frame.diagonal)
        found, seconds, _ = timed(lambda e=emitters: lamplight(occluder, e, 32))
        true = lamplight(occluder, emitters, 64, at=ordered(occluder, probes, seed=1), every=True)
        error = relative_error(found[probes], true)
        plan, plan_s, _ = timed(lambda e=emitters: plan_lamps(occluder, e, nothing, options.tolerance))
        wanted = lamplight(occluder, emitters, plan.rays)[probes]
        made = {"planned": plan.rays, "predicted": plan.error, "true": relative_error(wanted, true), "plan_s": plan_s}
        table.add(lamps=count, microseconds=1e6 * seconds / len(found), error=error, **made)


def by_change(mesh, frame, options, report):
    """The time of a lamp's change in a session, until it shows and until it is complete."""
    from relight.viewer import view

    lighting = LightingOptions(captured=0.1, tolerance=0.02)
    request = RelightRequest(mesh.scene, "captured", lighting, angles_deg=(0.0,), caching="none", albedo="captured")
    window = view(session_of(Job(request)), off_screen=True, size=(960, 720))
    session = window.session
    rng = np.random.default_rng(0)

    def somewhere():
        place = frame.center + frame.diagonal * rng.uniform((-0.3, 0.15, -0.3), (0.3, 0.4, 0.3))
        return [float(each) for each in place]

    window.finish()
    session.bench.prepare()
    while not session.bench.ready:
        window.tick()
    text = "{:.4f},{:.4f},{:.4f}"
    number = session.lamps.add(text.format(*somewhere()))
    window.finish()
    acts = {
        "add": lambda: session.lamps.add(text.format(*somewhere())),
        "move, of 1": lambda: session.lamps.move(number, somewhere()),
        "brighten": lambda: session.lamps.change(number, stops=float(rng.uniform(-0.5, 0.5))),
        "dim the captured": lambda: session.lamps.dim(float(rng.uniform(0.05, 0.5))),
        "move, of 8": lambda: session.lamps.move(number, somewhere()),
    }
    load = f"load {os.getloadavg()[0]:.1f} of {os.cpu_count()} cores"
    table = report.table(f"a change, ms, {load}", change="<16", light=".0f", picture=".0f", complete=".0f")
    for name, act in acts.items():
        if name.endswith("8"):
            for _ in range(7):
                session.lamps.add(text.format(*somewhere()))
            rest(window)
        found = []
        for _ in range(options.changes):
            found.append(change(window, act))
            if name == "add":
                session.timeline.undo()
                rest(window)
        light, picture, complete = 1e3 * np.median(found, axis=0)
        table.add(change=name, light=light, picture=picture, complete=complete)
    window.close()


def rest(window):
    """Wait until the light is complete, and all is there for the next change."""
    window.finish()
    while window.session.bench._running:
        window.tick()


def change(window, act):
    """Seconds from a change to its light, its picture and the complete result."""
    session = window.session
    start = time.perf_counter()
    act()
    while session.bench.shown.state != session.lamps.state:
        session.poll()
    session.radiance()
    seconds = [time.perf_counter() - start]
    window.tick()
    seconds.append(time.perf_counter() - start)
    while not session.complete:
        session.hurry()
        session.poll()
    seconds.append(time.perf_counter() - start)
    rest(window)
    return seconds
