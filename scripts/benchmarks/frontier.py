"""Every way to light a scene, time against error, and the choices of `--tolerance`: CSV, JSON and one plot.

SCENE is a scene folder, a mesh file, or a generated one: ball, ball-on-plane, tabletop, room, object. Light
bounces where vertices have colours. Every setting of a grid (method, bands, rays, suns, bounces) is measured, and the
plan of each tolerance. With --plans the table is that of the plans: predicted, checked and true error, and the work
beside that of the cheapest setting of the grid that would have met the tolerance.

Errors are relative L2 of exit radiance over 1,500 vertices. The truth is `relight.transfer.reference` with
16,384 directions; where light bounces, that of 2,048 directions at every vertex, bounced by 256 rays of each
until it fades, then gathered again at the 1,500 by 2,048 rays. Times are processor seconds of all threads,
medians over repetitions, each by a fresh Relighter, over the time in which bare Embree shoots one shadow ray
from every vertex, measured in between: so they carry over to other machines. Times are once for the scene
plus once for a light; reading and planning do not count.
"""

import csv
import json
import sys
from pathlib import Path

import numpy as np

from benchmarks.frontier_plot import draw, label, print_frontier, print_plans
from benchmarks.harness import relative_error, timed
from benchmarks.shapes import shape
from relight import Environment, Relighter
from relight.planning import costs
from relight.transfer import sampling
from relight.transfer.bounces import Interreflection, with_bounces
from relight.transfer.occluder import Occluder
from relight.transfer.reference import reference
from relight.transfer.settings import BOUNCE_TOLERANCE, Settings
from relight.transfer.split_light import split_light
from relight.transfer.store import Cache

SAMPLES = 1500
DIRECTIONS, FIELD_DIRECTIONS = 16384, 2048
FIELD_RAYS, GATHER_RAYS = 256, 2048
TOLERANCES = 0.05, 0.02, 0.01, 0.005
BARE_RAYS = 16  # of each vertex, for the unit of time
MADE_VERTICES = 12_000
DEFAULT_SCENES = ("ball", "ball-on-plane", "tabletop", "room", "object")
QUICK = ["tabletop", "--env", "noon", "--bands", "3", "--rays", "8", "--suns", "0", "--bounces", "0", "--repeats", "1"]
QUICK += ["--tolerances", "0.05", "--directions", "1024"]


def arguments(parser):
    parser.add_argument("scenes", nargs="*", default=DEFAULT_SCENES, metavar="SCENE")
    parser.add_argument("--env", nargs="+", default=["studio", "overcast", "noon", "sunset"], metavar="FILE|NAME")
    parser.add_argument("--angle", type=float, default=30.0, metavar="DEG", help="turn of the lights (default 30)")
    parser.add_argument("--plans", action="store_true", help="print the table of plans; draw nothing")
    parser.add_argument("--tolerances", nargs="+", type=float, default=list(TOLERANCES), metavar="T")
    parser.add_argument("--bands", nargs="+", type=int, default=[3, 5, 8, 10], metavar="B")
    parser.add_argument("--rays", nargs="+", type=int, default=[8, 16, 32, 64, 128, 256, 512], metavar="N")
    parser.add_argument("--suns", nargs="+", type=float, default=[0.0, 0.012, 0.006, 0.003], metavar="T")
    parser.add_argument("--bounces", nargs="+", type=int, default=[0, 16, 64], metavar="N", help="bounce rays")
    parser.add_argument("--repeats", type=int, default=3, metavar="N")
    parser.add_argument("--directions", type=int, default=DIRECTIONS, metavar="N", help="of the truth")
    parser.add_argument("--out", type=Path, default=Path("frontier"), metavar="FOLDER")
    parser.add_argument("--draw", type=Path, metavar="JSON", help="draw the plot of an earlier run again")


def run(options, report):
    options.out.mkdir(parents=True, exist_ok=True)
    if options.draw:
        draw(json.loads(options.draw.read_text()), options.out / "frontier.png")
        return
    lights = {Path(name).stem: Environment.load(name).rotated(options.angle) for name in options.env}
    warm_up()
    found = {"scenes": {}, "grid": [], "plans": []}
    for name in options.scenes:
        mesh = shape(name, MADE_VERTICES)
        measure(mesh.name, mesh.scene, mesh.albedo, lights, options, found)
        found["plans"] = judged(found)
        (options.out / "frontier.json").write_text(json.dumps(found) + "\n")
        for kind in ("grid", "plans"):
            with (options.out / f"{kind}.csv").open("w", newline="") as file:
                writer = csv.DictWriter(file, list(found[kind][0]))
                writer.writeheader()
                writer.writerows(found[kind])
    if not options.plans:
        print_frontier(found, report)
        draw(found, options.out / "frontier.png")
    print_plans(found, report)


def warm_up():
    """Compile everything."""
    scene, light = shape("ball-on-plane").scene, Environment.load("noon")
    albedo = np.full(scene.vertices.shape, 0.5, np.float32)
    Relighter(scene, tolerance=0.05).shade(light, albedo)
    for method, rays in (("raytraced", 16), ("neural-gash", 0), ("analytic", 0), ("blinn-phong", 0)):
        bouncing = (8, 0.01) if method == "raytraced" else (0, 0.0)
        settings = Settings(method, 3, rays, 0.01 if rays else 0.0, *bouncing)
        Relighter(scene).shading(light, albedo, settings)


def truths(occluder, rows, lights, albedo, directions):
    """Exit radiance (R, 3) of the rows, by light: all of it, converged."""
    found = {name: reference(occluder, rows, light, directions) for name, light in lights.items()}
    if albedo is None:
        return found
    matrix = Interreflection(occluder, FIELD_RAYS)
    origins, normals = occluder.origins[rows], occluder.normals[rows]
    gathered = {name: np.zeros((len(rows), 3)) for name in lights}
    fields = {}
    for name, light in lights.items():
        direct = reference(occluder, slice(None), light, FIELD_DIRECTIONS)
        fields[name] = with_bounces(direct, albedo, matrix, 1e-5, 64)[0].astype(np.float64)
    azimuths = sampling.fibonacci_azimuths(GATHER_RAYS)
    for start in range(0, len(rows), 256):
        part = slice(start, start + 256)
        shot = np.zeros((len(origins[part]), GATHER_RAYS, 6), np.float32)
        sampling.shoot(origins[part], normals[part], azimuths, 7, shot)
        _, face, uv, face_normal = occluder.first_hits(shot)
        ray = np.nonzero(face >= 0)
        corners = occluder.faces[face[ray]].astype(np.int64)
        shares = np.stack([1.0 - uv[ray].sum(axis=1), *uv[ray].T], axis=1)
        side = np.sign(np.einsum("ic,ikc->i", face_normal[ray], occluder.normals[corners]) + 1e-30)
        shares[side * np.einsum("ic,ic->i", face_normal[ray], shot[ray][:, 3:]) >= 0.0] = 0.0  # backs are black
        for name, field in fields.items():
            arriving = np.einsum("ik,ikc->ic", shares, field[corners])
            for color in range(3):
                sums = np.bincount(ray[0], arriving[:, color], len(shot))
                gathered[name][part, color] = sums / GATHER_RAYS
    return {name: albedo[rows] * (found[name] + gathered[name]) for name in lights}


def measure(name, scene, albedo, lights, options, found):
    """Add the grid and the plans of one scene to the results."""
    occluder = Occluder(scene.vertices, scene.normals, scene.faces)
    count = len(occluder.origins)
    rows = np.random.default_rng(5).choice(count, min(SAMPLES, count), replace=False)
    expected = truths(occluder, rows, lights, albedo, options.directions)
    bare, taken, errors = [], {}, {}
    for _ in range(options.repeats):
        fresh = {light: copy(environment) for light, environment in lights.items()}
        splits = {}
        for transfer in transfers(options):
            bare.append(bare_seconds(occluder))
            for light, settings, seconds, radiance in lit(scene, albedo, fresh, splits, transfer, options):
                taken.setdefault((light, settings), []).append(seconds)
                errors[light, settings] = relative_error(radiance[rows], expected[light])
    unit = float(np.median(bare))
    found["scenes"][name] = {"vertices": count, "bare_ns_per_ray": 1e9 * unit / count, "albedo": albedo is not None}
    for (light, settings), seconds in taken.items():
        low, middle, high = (float(value) for value in np.quantile(seconds, [0.25, 0.5, 0.75]) / unit)
        row = {"scene": name, "light": light, "method": settings.method, "bands": settings.bands}
        row |= {"rays": settings.rays, "suns": settings.sun_tolerance, "bounce_rays": settings.bounce_rays}
        row |= {"error": errors[light, settings], "work": middle, "work_q1": low, "work_q3": high}
        found["grid"].append(row | {"seconds": middle * unit, "vertices_per_s": count / (middle * unit)})
    for light, environment in lights.items():
        for tolerance in options.tolerances:
            runs = [planned(scene, albedo, environment, tolerance) for _ in range(min(2, options.repeats))]
            plan, shading = runs[0][:2]
            settings = shading.settings
            unsure = plan.choice.measured.sample.unsure
            predicted = sum(costs.seconds(plan.settings, count, count, 1.0 / count, plan.sun_count, unsure=unsure))
            off = relative_error(shading.radiance[rows], expected[light])
            row = {"scene": name, "light": light, "tolerance": tolerance, "plan": str(settings)}
            row |= {"predicted": plan.error, "checked": plan.checked, "true": off, "suns_predicted": plan.sun_count}
            row |= {"suns": shading.sun_count, "work_predicted": predicted}
            row |= {
                key: float(np.median([run[at] for run in runs])) / unit for key, at in (("work", 2), ("planning", 3))
            }
            row |= {"without": {effect: without for effect, without, _ in plan.contributions}}
            found["plans"].append(row | {"cheapest": None, "cheapest_work": None, "ratio": None})
            print(f"{name} {light} {tolerance:g}: true {off:.2%}, {settings}", file=sys.stderr, flush=True)


def transfers(options):
    """Settings of each transfer of the grid, without suns and bounces."""
    yield from (Settings("analytic", bands) for bands in (2, 3, 5))
    yield from (Settings(method, 3) for method in ("blinn-phong", "neural-gash"))
    for bands in options.bands:
        yield from (Settings("raytraced", bands, rays) for rays in options.rays)


def lit(scene, albedo, lights, splits, transfer, options):
    """(light, Settings, seconds, radiance) of one transfer under all lights, with all suns and bounces.

    Seconds are of what a fresh Relighter takes more for its first light than for the same again, of splitting the
    light, once for all transfers of so many bands, and of its light.
    """
    relighter, once = Relighter(scene), 0.0
    even = Environment(np.ones((4, 8, 3), np.float32))
    for bounce_rays in options.bounces if transfer.rays and albedo is not None else (0,):
        settings = transfer._replace(bounce_rays=bounce_rays, bounce_tolerance=BOUNCE_TOLERANCE if bounce_rays else 0.0)
        first, again = (seconds_of(lambda s=settings: relighter.shading(even, albedo, s))[0] for _ in range(2))
        geometry, once = once + max(0.0, first - again), once or max(0.0, first - again)
        for suns in options.suns if transfer.rays else (0.0,):
            chosen = settings._replace(sun_tolerance=suns)
            for light, environment in lights.items():
                key = light, settings.bands, suns
                if key not in splits and settings.method != "blinn-phong":
                    splits[key] = seconds_of(lambda e=environment, c=chosen: split_light(e, c, Cache()))[0]
                seconds, shading = seconds_of(lambda e=environment, c=chosen: relighter.shading(e, albedo, c))
                yield light, chosen, geometry + splits.get(key, 0.0) + seconds, shading.radiance


def planned(scene, albedo, environment, tolerance):
    """(plan, Shading, seconds of the work, of planning) by a fresh Relighter; what planning found is found again."""
    relighter = Relighter(scene, tolerance=tolerance)
    planning, plan = seconds_of(lambda: relighter.plan_for(copy(environment), albedo))
    work, shading = seconds_of(lambda: relighter.shading(copy(environment), albedo))
    return plan, shading, work, planning


def copy(environment):
    """The same light, without any cached results."""
    return Environment(environment.radiance, environment.name, environment.rotation_deg)


def seconds_of(work):
    """(processor seconds of all threads, result)."""
    result, _, seconds = timed(work)
    return seconds, result


def bare_seconds(occluder):
    """Processor seconds of bare Embree for one shadow ray from every vertex, of 16 from each."""
    origins, normals = occluder.origins, occluder.normals
    shot = np.zeros((len(origins), BARE_RAYS, 6), np.float32)
    sampling.shoot(origins, normals, sampling.fibonacci_azimuths(BARE_RAYS), 0, shot)
    return timed(lambda: occluder.occluded(shot)).cpu / BARE_RAYS


def judged(found):
    """The plans' rows with the cheapest setting of the grid that is within each tolerance."""
    for row in found["plans"]:
        same = [each for each in found["grid"] if all(each[key] == row[key] for key in ("scene", "light"))]
        good = [each for each in same if each["error"] <= row["tolerance"]]
        if good:
            best = min(good, key=lambda each: each["work"])
            row |= {"cheapest": label(best), "cheapest_work": best["work"], "ratio": row["work"] / best["work"]}
    return found["plans"]
