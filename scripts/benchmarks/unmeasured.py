"""Small scenes without a plan's sample: error and processor seconds of what is taken there, beside those of plans.

Errors are those of `scripts/bench frontier`, under built-in skies and more lights by --env. `vertices` is how many each
generated scene has about. A plan's seconds are those of planning and of work, each by a fresh Relighter.
"""

import sys

import numpy as np

from benchmarks.frontier import copy, seconds_of, truths, warm_up
from benchmarks.harness import relative_error
from benchmarks.shapes import SHAPES, shape
from relight import Environment, LightingOptions, Relighter
from relight.planning import unmeasured
from relight.planning.planner import planned
from relight.planning.sample import PlannedScene

SKIES = "studio", "overcast", "noon", "sunset"
SCENES = *(name for name in SHAPES[:4]), "tabletop", "room", "object"
QUICK = ["tabletop", "--vertices", "800", "--directions", "512", "--skies", "noon"]


def arguments(parser):
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE")
    parser.add_argument("--vertices", type=int, default=3000, metavar="N")
    parser.add_argument("--skies", nargs="+", default=list(SKIES), metavar="FILE|NAME")
    parser.add_argument("--directions", type=int, default=8192, metavar="N", help="of the truth")


def run(options, report):
    lights = {name.rpartition("/")[2]: Environment.load(name).rotated(30.0) for name in options.skies}
    unmeasured.UNMEASURED_VERTICES = sys.maxsize
    warm_up()
    columns = {"scene": "<14", "vertices": ",d", "light": "<12", "settings": "<70", "error": ".4f", "seconds": ".3f"}
    table = report.table("seconds", **columns, plan_seconds=".3f", plan_error=".4f")
    for name in options.scenes:
        made = shape(name, options.vertices)
        scene, count = made.scene, made.scene.vertex_count
        albedo = np.full((count, 3), 0.5, np.float32) if made.albedo is None else made.albedo
        occluder = Relighter(scene).occluder
        rows = np.random.default_rng(5).choice(count, min(1000, count), replace=False)
        expected = truths(occluder, rows, lights, albedo, options.directions)
        for light, environment in lights.items():
            for least, _ in unmeasured.UNMEASURED:
                asked = LightingOptions(tolerance=max(least, 0.01))
                plan = unmeasured.unmeasured(PlannedScene(occluder, albedo), asked)
                shading, seconds = _lit(scene, environment, albedo, plan.settings)
                by_plan, plan_seconds = _lit(scene, environment, albedo, asked)
                row = {"scene": name, "vertices": count, "light": light, "settings": str(plan.settings)}
                errors = [relative_error(each.radiance[rows], expected[light]) for each in (shading, by_plan)]
                table.add(**row, error=errors[0], seconds=seconds, plan_seconds=plan_seconds, plan_error=errors[1])


def _lit(scene, environment, albedo, wanted):
    """(Shading, processor seconds) by Settings, or by a plan for LightingOptions and its work."""
    relighter, environment = Relighter(scene), copy(environment)
    _ = relighter.occluder  # is built in any case
    if not isinstance(wanted, LightingOptions):
        return seconds_of(lambda: relighter.shading(environment, albedo, wanted))[::-1]

    def all_of_it():
        known = relighter.precomputed
        made = Relighter(scene, wanted, precomputed=known)
        made._planner._made = lambda light, tint, angles: planned(
            PlannedScene(known.occluder, tint), light, wanted, angles, known.there()
        )
        return made.shading(environment, albedo)

    return seconds_of(all_of_it)[::-1]
