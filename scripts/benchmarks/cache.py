"""Savings of cached transfers: the first light of a scene, the same at another angle, other lights, each as a new run.

Without scenes an object and a table are generated, with their true albedo. Every row has a separate Relighter, as a
new run of the command does; all share one temporary cache folder. Processor seconds of all threads, without reading
files; rays are those for transfers and bounces.
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.harness import timed
from benchmarks.shapes import MADE_VERTICES, shape
from relight import Environment, Relighter
from relight.transfer.store import Cache, geometry_key

QUICK = ["tabletop", "--vertices", "4000", "--env", "studio", "--tolerance", "0.05"]


def arguments(parser):
    parser.add_argument("scenes", nargs="*", metavar="SCENE", default=["object", "tabletop"])
    parser.add_argument("--env", nargs="+", default=["studio", "overcast", "noon"], metavar="FILE|NAME")
    parser.add_argument("--tolerance", type=float, default=0.01)
    parser.add_argument("--vertices", type=int, default=MADE_VERTICES, help="of generated scenes")


def run(options, report):
    warm = Environment.load("studio")
    for name in options.scenes:
        made = shape(name, options.vertices)
        scene, albedo = made.scene, made.albedo
        albedo = np.ones(made.vertices.shape, np.float32) if albedo is None else albedo
        Relighter(scene, tolerance=0.05).shade(warm, albedo)  # compiles
        title = f"{made.name}: {len(scene.vertices):,} vertices, tolerance {options.tolerance:g}"
        table = report.table(title, light="<12", angle=".0f", seconds=".3f", rays=",", of_the_first=".1%")
        with tempfile.TemporaryDirectory() as folder:
            for light in options.env:
                first = None
                for angle in (0.0, 45.0):
                    relighter = Relighter(scene, tolerance=options.tolerance, cache=Cache(folder, geometry_key(scene)))
                    environment = Environment.load(light).rotated(angle)
                    seconds = timed(lambda r=relighter, e=environment, a=albedo: r.shade(e, a)).cpu
                    first = first or seconds
                    row = {"light": Path(light).stem, "angle": angle, "seconds": seconds}
                    table.add(**row, rays=relighter.rays_traced, of_the_first=seconds / first)
