"""The two networks against every other method of transfer: error, radiance under lights, time, time to equal error.

Errors are relative L2 against thousands of rays. Time is the least of some runs, in processor seconds of all
threads, with all preparation that a method needs (including the ray tracer's tree).

--equal-error measures the mixing network alone, in several numbers of bands and rays, against unfiltered and filtered
rays: geometric means of the errors over the meshes, processor microseconds per vertex, and the time of rays at the
error of the network over the time of the network, interpolated between measured numbers of rays along a power law
(beyond them, extended by its last two). Last, the quality of the network's expected error: expected over actual,
root mean square, for all vertices and by quarters from the least expected up.
"""

from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.harness import geometric_mean, relative_error, timed
from benchmarks.shapes import MADE_VERTICES, shape
from relight import Environment
from relight.transfer.analytic import analytic
from relight.transfer.neural import neural, neural_with_confidence
from relight.transfer.neuralgash import neural_gash
from relight.transfer.occluder import Occluder
from relight.transfer.raytraced import raytraced, raytraced_scene

BANDS = 3  # that the network of the Neural-GASh paper has
METHODS = {
    "rays": lambda occluder, bands, rays: raytraced(occluder, slice(None), bands, rays),
    "filtered": raytraced_scene,
    "neural": neural,
}
MOST_IN_FULL = 100_000
"""Vertices up to which all of a mesh is compared: a place has more, and its reference would take minutes."""
BASELINE_RAYS = 2, 3  # times the most rays: the baselines are measured this far beyond the network
QUICK = ["tabletop", "--made", "3000", "--rays", "8", "--repeats", "1", "--reference", "256"]
PLOT = {"x": "seconds", "y": "transfer", "by": ("scene", "method")}


def arguments(parser):
    parser.add_argument("scenes", nargs="*", metavar="SCENE", default=["object", "tabletop"])
    parser.add_argument("--env", nargs="+", default=["studio", "sunset"], metavar="FILE|NAME")
    parser.add_argument("--rays", type=int, nargs="+", default=[8, 16, 32, 64])
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--reference", type=int, default=4096, help="rays of the reference")
    parser.add_argument("--made", type=int, default=MADE_VERTICES, metavar="N", help="vertices of generated scenes")
    parser.add_argument("--equal-error", action="store_true", help="the mixing network alone")
    parser.add_argument("--bands", type=int, nargs="+", default=[3, 5, 10], help="... in this many bands")
    parser.add_argument(
        "--vertices",
        type=int,
        default=3000,
        help=f"... drawn from each mesh for its reference, and from any of more than {MOST_IN_FULL:,}",
    )


def run(options, report):
    meshes = [shape(name, options.made) for name in options.scenes]
    if options.equal_error:
        equal_error(meshes, options, report)
        return
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
        ways[f"neural {count}"] = lambda r=count: neural(mesh.occluder, BANDS, r)
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


def equal_error(meshes, options, report):
    """The mixing network against rays, by bands and rays."""
    counts = sorted({*options.rays, *(factor * max(options.rays) for factor in BASELINE_RAYS)})
    errors, seconds, expected, total = {}, {}, {}, 0
    for mesh in meshes:
        occluder: Occluder = mesh.occluder
        count = len(occluder.origins)
        total += count
        drawn = np.random.default_rng(0).choice(count, min(options.vertices, count), replace=False)
        reference = raytraced(occluder, drawn, max(options.bands), options.reference, seed=2**32 + 1)
        report.note(f"{mesh.name}: {count:,} vertices")
        neural(occluder, 3, 4)  # compiled, and the tree built
        for bands in options.bands:
            truth = reference[:, : bands**2]
            for rays in counts:
                for name, method in METHODS.items():
                    if name == "neural" and rays not in options.rays:
                        continue
                    transfer, spent = least(partial(method, occluder, bands, rays), options.repeats)
                    errors.setdefault((name, bands, rays), []).append(relative_error(transfer[drawn], truth))
                    seconds[name, bands, rays] = seconds.get((name, bands, rays), 0.0) + spent
            for rays in options.rays:
                squares = confidence_squares(occluder, bands, rays, drawn, truth)
                expected.setdefault((bands, rays), []).append(squares)
    mean = {key: geometric_mean(values) for key, values in errors.items()}
    micros = {key: 1e6 * value / total for key, value in seconds.items()}
    columns = {"bands": "d", "rays_": "d"} | dict.fromkeys(METHODS, ".4f") | {f"us_{name}": ".2f" for name in METHODS}
    table = report.table("errors, microseconds, time to equal error", **columns, t_rays=".2f", t_filtered=".2f")
    for bands in options.bands:
        for rays in options.rays:
            row = {name: mean[name, bands, rays] for name in METHODS}
            row |= {f"us_{name}": micros[name, bands, rays] for name in METHODS}
            for name in ("rays", "filtered"):
                curve = [(mean[name, bands, r], micros[name, bands, r]) for r in counts]
                ratio = time_to(row["neural"], *zip(*curve, strict=True)) / row["us_neural"]
                row[f"t_{name}"] = ratio
            table.add(bands=bands, rays_=rays, **row)
    quarters = [f"quarter_{number}" for number in (1, 2, 3, 4)]
    title = "expected over made error: all, by quarters of the vertices from the least expected"
    table = report.table(title, bands="d", rays="d", all=".2f", **dict.fromkeys(quarters, ".2f"))
    for (bands, rays), values in expected.items():
        squares = np.mean(np.array(values), axis=0)
        ratio = np.sqrt(squares[:, 0] / np.maximum(squares[:, 1], 1e-12))
        table.add(bands=bands, rays=rays, **dict(zip(("all", *quarters), map(float, ratio), strict=True)))


def confidence_squares(occluder, bands, rays, drawn, truth):
    """Mean squares of expected and made error, of all drawn vertices and of their quarters: (5, 2)."""
    transfer, confidence = neural_with_confidence(occluder, bands, rays)
    norm = np.linalg.norm(analytic(np.float32([[0, 1, 0]]), bands))
    made = np.linalg.norm(transfer[drawn] - truth, axis=1) / norm
    quarters = np.array_split(np.argsort(confidence[drawn]), 4)
    pairs = [(confidence[drawn][part], made[part]) for part in (np.arange(len(drawn)), *quarters)]
    return [[np.mean(x * x) for x in pair] for pair in pairs]


def time_to(error, errors, seconds):
    """Seconds to an error along the power laws between measurements, which run from few rays to many."""
    errors, seconds = np.log(errors), np.log(seconds)
    at = int(np.clip(np.searchsorted(-errors, -np.log(error)), 1, len(errors) - 1))
    slope = (seconds[at] - seconds[at - 1]) / (errors[at] - errors[at - 1])
    return float(np.exp(seconds[at] + slope * (np.log(error) - errors[at])))
