"""Time against accuracy of the surface: every method and detail of splat2mesh against true meshes.

--samples sets the points on each mesh (100,000); a large scene, such as a room, needs more to raise the upper bound
that the row "truth" shows: the truth against itself.

FOLDER holds a splat (point_cloud.ply or splat.ply) and its truth (scenes/score.py). Without folders three are made.
Times are whole conversions after a warm-up, in processor seconds of all threads: steady beside other work.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.harness import ROOT, timed
from scenes.score import SAMPLES, read_truth, score
from splat2mesh import convert
from splat2mesh.base.choices import SURFACE_CHOICES
from splat2mesh.surface.extract import EFFORTS

QUICK = ["--ways", "field", "--details", "draft", "--kinds", "object", "--splats", "5000", "--samples", "2000"]
PLOT = {"x": "cpu_s", "y": "error", "by": ("scene", "way", "cameras")}
MADE = {"object": 100_000, "tabletop": 200_000, "room": 400_000}
"""Splats of the scenes that are generated."""


def arguments(parser):
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument(
        "--ways",
        nargs="+",
        default=list(SURFACE_CHOICES),
        choices=SURFACE_CHOICES,
        metavar="WAY",
        help="all by default",
    )
    parser.add_argument("--details", nargs="+", default=list(EFFORTS), choices=EFFORTS, metavar="LEVEL", help="same")
    parser.add_argument("--samples", type=int, default=SAMPLES, metavar="N", help="points on each mesh")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="seeds of the virtual views, means shown")
    parser.add_argument("--kinds", nargs="+", default=list(MADE), choices=MADE, metavar="KIND", help="generated scenes")
    parser.add_argument("--splats", type=int, help="per generated scene, instead of 100,000 to 400,000")


def run(options, report):
    with tempfile.TemporaryDirectory() as work:
        for folder in options.folders or generated(Path(work), options):
            measure(folder, options, report)


def generated(work, options):
    """Small scenes made for the purpose: an object, a table, a room."""
    for kind in options.kinds:
        command = [sys.executable, "-m", "scenes", work / kind, "--kind", kind, "-q", "--env", "overcast"]
        subprocess.run([*command, "--splats", str(options.splats or MADE[kind])], check=True, cwd=ROOT)
    return [work / kind for kind in options.kinds]


def measure(folder, options, report):
    """Convert one scene every way: a row for each."""
    splat = next(folder / name for name in ("point_cloud.ply", "splat.ply") if (folder / name).exists())
    true, centers, sphere = read_truth(folder)
    convert(splat, detail="draft", vertices=1000)
    samples, seeds = options.samples, options.seeds
    ways = [(way, detail, None) for way in options.ways for detail in options.details]
    ways += [("field", "normal", folder / "sparse/0")] if "field" in options.ways else []
    ceiling = score(true, true, centers, samples, sphere=sphere)
    columns = {"scene": "<12", "way": "<14", "detail": "<8", "cameras": "<8", "cpu_s": ".1f"}
    table = report.table(**columns, **dict.fromkeys(ceiling, ".3f"))
    table.add(scene=folder.name, way="truth, itself", **ceiling)
    for way, detail, cameras in ways:
        found = []
        for seed in range(seeds if way == "field" and not cameras else 1):
            settings = {"surface": way, "detail": detail, "cameras": cameras, "seed": seed}
            scene, _, seconds = timed(lambda s=settings: convert(splat, **s))
            mesh = scene.vertices @ scene.scene_from_splat[:3, :3], scene.faces
            found.append({"cpu_s": seconds, **score(mesh, true, centers, samples, sphere=sphere)})
        row = {"scene": folder.name, "way": way, "detail": detail, "cameras": "trained" if cameras else "virtual"}
        row |= {key: round(float(np.mean([run[key] for run in found])), 4) for key in found[0]}
        table.add(**row, error=1 - row["F@0.005"])
