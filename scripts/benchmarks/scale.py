"""Seconds and peak memory of splat2mesh, and with --light of the first light, as scenes grow, stage by stage.

Each scene is generated and converted by a separate process; its time and memory are what the system charged it.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.harness import ROOT, growth
from splat2mesh.splats.formats import read_splats, write_inria_ply
from splat2mesh.splats.splats import DEGREE_OF_COEFFICIENTS

SIZES = (100_000, 500_000, 2_000_000, 5_800_000)  # the last one is the largest of the public trained scenes
SHINE = 0.02  # spread of the coefficients that make the colours of a scene depend on the direction
COEFFICIENTS = {degree: count for count, degree in DEGREE_OF_COEFFICIENTS.items()}
QUICK = ["2000", "4000", "--detail", "draft", "--degree", "0"]


def arguments(parser):
    add = parser.add_argument
    add("sizes", type=int, nargs="*", default=SIZES, metavar="SPLATS", help=f"scene sizes (default: {SIZES})")
    add("--kind", default="tabletop", help="kind of scene, see python -m scenes --help (default: %(default)s)")
    add("--degree", type=int, choices=COEFFICIENTS, default=3, help="of the colours (default: %(default)s)")
    add("--detail", default="normal", help="of the conversion (default: %(default)s)")
    add("--light", metavar="NAME", help="of `relight` after it, whose stages follow")
    add("--repeats", type=int, default=1, metavar="N", help="conversions, the fastest counts (default: %(default)s)")
    add("--folder", type=Path, help="folder that keeps and reuses the scenes (default: temporary)")


def run(options, report):
    if min(options.sizes) < 100 or options.repeats < 1:
        raise SystemExit("a scene has at least 100 splats, and is converted at least once")
    results = []
    with tempfile.TemporaryDirectory(prefix="bench_scale.") as temporary:
        folder = options.folder or Path(temporary)
        for size in options.sizes:
            splat = scene(folder, options.kind, size, options.degree)
            runs = [convert(splat, Path(temporary) / "scene", options.detail) for _ in range(options.repeats)]
            results.append({"splats": size, **min(runs, key=lambda run: run["cpu"])})
            if options.light:
                results[-1] |= light(Path(temporary) / "scene", splat, options.light)
            report.note(" ".join(f"{key}={value:.7g}" for key, value in results[-1].items()))
            if not options.folder:
                splat.unlink()
    sizes = [result["splats"] for result in results]
    columns = {"figure": "<26"} | {f"{size:,}": ",.2f" for size in sizes} | {"exponent": ".2f"}
    table = report.table("seconds, peak in MiB; exponent p of the growth, cost ~ splats^p, of the last step", **columns)
    for key in dict.fromkeys(key for result in results for key in result if key != "splats"):
        costs = [result.get(key, 0.0) for result in results]
        table.add(
            figure=key,
            **{f"{size:,}": cost for size, cost in zip(sizes, costs, strict=True)},
            exponent=growth(sizes, costs),
        )


def scene(folder, kind, size, degree):
    """The path of a splat file of this size, made unless it is there."""
    splat = folder / f"{kind}_{size}_{degree}.ply"
    if not splat.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as workspace:
            made = Path(workspace) / "made"
            charged([sys.executable, "-m", "scenes", made, "--kind", kind, "--splats", str(size), "-q"])
            # In a separate process: a later child would be charged with all the memory its parent ever held.
            with ProcessPoolExecutor(1) as process:
                process.submit(write_as_trained, made / "splat.ply", splat, degree).result()
    return splat


def write_as_trained(source, target, degree):
    """Copy a splat file with what slows the conversion of trained ones: no order, and many coefficients (noise)."""
    rng = np.random.default_rng(0)
    splats = read_splats(source)
    splats = splats.take(rng.permutation(len(splats)))
    rest = rng.standard_normal((len(splats), COEFFICIENTS[degree] - 1, 3), np.float32)
    sh = np.concatenate([splats.sh, np.float32(SHINE) * rest], axis=1)
    write_inria_ply(target, replace(splats, sh=sh))


def convert(splat, out, detail):
    """Convert one file: seconds of each stage, wall and processor seconds of the process, peak memory in MiB."""
    command = [
        sys.executable,
        "-m",
        "splat2mesh.cli",
        splat,
        "-o",
        out,
        "--detail",
        detail,
        "--overwrite",
        "--json",
    ]
    output, wall, usage = charged(command)
    stages = json.loads(output)["seconds"]
    return {**stages, "start": wall - sum(stages.values()), **_whole(wall, usage)}


def light(scene, splat, name):
    """The same of the first light of a scene: a relit splat."""
    command = [sys.executable, "-m", "relight", scene, "--splat", splat, "--env", name, "--format", "splat", "-q"]
    _, wall, usage = charged([*command, "-o", scene.with_name("lit"), "--overwrite"])
    stages = json.loads((scene.with_name("lit") / "report.json").read_text())["seconds"]
    return {f"light: {stage}": seconds for stage, seconds in (stages | _whole(wall, usage)).items()}


def _whole(wall, usage):
    unit = 2**20 if sys.platform == "darwin" else 2**10  # of ru_maxrss, per MiB
    return {"wall": wall, "cpu": usage.ru_utime + usage.ru_stime, "peak": usage.ru_maxrss / unit}


def charged(command):
    """Run a command in a separate process: its stdout, its wall seconds and its resource usage."""
    start = time.perf_counter()
    process = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, cwd=ROOT)
    output = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{command[2]} ended with exit code {process.returncode}")
    return output, time.perf_counter() - start, usage
