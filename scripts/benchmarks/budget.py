"""Planned seconds against the seconds that the light takes, from small scenes to large.

Processor seconds of all threads, of a light after its plan, for each CASE: SCENE:VERTICES:LIGHT:TOLERANCE. Planning
times its rays by the processor's clock here, so other work on the machine does not count. Beside them: the
rays per vertex that were planned, and those after the check, which doubles them where they are too noisy for the
tolerance. A plan for a budget is never doubled.
"""

import time

import numpy as np

from benchmarks.harness import timed
from benchmarks.shapes import shape
from relight import Environment, Relighter
from relight.planning import sample

SMALL = "ball-on-plane:8000:overcast:.05", "room:1000:overcast:.03", "bumps:1000:noon:.01", "bumps:10000:noon:.01"
LARGE = "bumps:300000:overcast:.05", "bumps:300000:noon:.05", "room:1000000:overcast:.05", "bumps:1000000:overcast:.05"
QUICK = ["bumps:1000:overcast:.05"]


class _ProcessorClock:
    perf_counter = staticmethod(time.process_time)


def arguments(parser):
    """Arguments of this subject."""
    parser.add_argument("cases", nargs="*", default=(*SMALL, *LARGE), metavar="CASE")


def run(options, report):
    """Plan and light each case."""
    sample.time = _ProcessorClock
    warm = shape("ball-on-plane").scene
    for light in {case.split(":")[2] for case in options.cases}:  # compiled
        Relighter(warm, tolerance=0.03).shade(Environment.load(light), np.full(warm.vertices.shape, 0.5, np.float32))
    columns = {"scene": "<14", "vertices": ",d", "light": "<9", "tolerance": ".3f", "planned": "d", "traced": "d"}
    table = report.table("seconds", **columns, ray_ns=".0f", predicted=".3f", took=".3f", ratio=".2f")
    made = None
    for case in options.cases:
        name, count, light, tolerance = case.split(":")
        made = made if made and made[0] == (name, count) else ((name, count), shape(name, int(count)))
        scene, albedo, environment = made[1].scene, made[1].albedo, Environment.load(light)
        relighter = Relighter(scene, tolerance=float(tolerance))
        plan = relighter.plan_for(environment, albedo)
        predicted, planned = plan.seconds, plan.settings.rays
        took = timed(lambda r=relighter, e=environment, a=albedo: r.shade(e, a)).cpu
        row = {"scene": name, "vertices": scene.vertex_count, "light": light, "tolerance": float(tolerance)}
        row |= {"planned": planned, "traced": plan.settings.rays, "ray_ns": 1e9 * plan.choice.measured.sample.ray_s}
        table.add(**row, predicted=predicted, took=took, ratio=predicted / took)
