"""Another light and another angle on a scene that had a first light, as commands, beside another checkout.

SCENE is a scene folder; without any, a nook is generated. It is copied beside itself, and the copy gets a first light,
`--first`. Then come `--env` as a new light, with no plan kept, and the same turned by `--angle`. With `--against` all
runs alternate with those of another checkout of this project, which goes first. Processor seconds of all threads,
seconds of the clock, peak memory in MB, and how many files differ from the other's, reports aside. Both run compiled:
each command once before, unmeasured.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.frontier_places import made
from benchmarks.harness import ROOT

QUICK = ["--made", "nook", "--splats", "3000", "--vertices", "4000", "--repeats", "1"]


def arguments(parser):
    parser.add_argument("scenes", nargs="*", type=Path, metavar="SCENE")
    parser.add_argument("--first", default="sunset", metavar="FILE|NAME", help="the light before (default: sunset)")
    parser.add_argument("--env", default="noon", metavar="FILE|NAME", help="the new light (default: noon)")
    parser.add_argument("--angle", type=float, default=45.0, metavar="DEG")
    parser.add_argument("--splat", type=Path, metavar="FILE", help="the scene's splat, where it has moved")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT")
    parser.add_argument("--repeats", type=int, default=2, metavar="N")
    parser.add_argument("--made", nargs="+", default=["nook"], metavar="KIND", help="generated scenes")
    parser.add_argument("--splats", type=int, default=10_000, help="of a generated scene")
    parser.add_argument("--vertices", type=int, default=20_000, help="of the mesh of a generated scene")
    parser.add_argument("--out", type=Path, default=Path("again"), metavar="FOLDER", help="of generated scenes")


def run(options, report):
    trees = ([options.against.resolve()] if options.against else []) + [ROOT]
    for source in options.scenes or [made(kind, options) for kind in options.made]:
        table = report.table(
            source.name, run="<8", checkout="<20", cpu=".1f", clock=".1f", peak_mb=".0f", differing="d"
        )
        scene = source.parent.resolve() / f"{source.name}.measured"  # beside it: its splat is named from there
        shutil.rmtree(scene, ignore_errors=True)
        shutil.copytree(source, scene, ignore=shutil.ignore_patterns("relit"))
        try:
            for tree in trees:
                relit(tree, scene, options, options.first, 0.0)
            for repeat in range(options.repeats + 1):
                for kind, angle in (("light", 0.0), ("angle", options.angle)):
                    written = []
                    for tree in trees:
                        if kind == "light":
                            for name in ("plan-*.npz", "light-*.npz"):
                                for path in (scene / "cache").glob(name):
                                    path.unlink()
                        figures, files = relit(tree, scene, options, options.env, angle)
                        written.append(files)
                        differing = sum(files[name] != written[0].get(name) for name in files)
                        if repeat:
                            table.add(run=kind, checkout=tree.name, **figures, differing=differing)
        finally:
            shutil.rmtree(scene)


def relit(tree, scene, options, light, angle):
    """(figures, {name: hash} of the files) of one command of a checkout."""
    out = scene / "measured"
    shutil.rmtree(out, ignore_errors=True)
    light = Path(light).resolve() if Path(light).exists() else light
    words = ["--env", str(light), "--rotate", str(angle), "-o", str(out), "-q"]
    words += ["--splat", str(options.splat.resolve())] if options.splat else []
    start = time.perf_counter()
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    work = subprocess.Popen([sys.executable, "-m", "relight", str(scene), *words], cwd=tree, env=environment)
    _, status, used = os.wait4(work.pid, 0)
    work.returncode = os.waitstatus_to_exitcode(status)
    clock = time.perf_counter() - start
    if work.returncode:
        sys.exit(f"scripts/bench again: relight failed with {work.returncode}")
    files = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(out.iterdir())}
    files.pop("report.json", None)
    return {"cpu": used.ru_utime + used.ru_stime, "clock": clock, "peak_mb": used.ru_maxrss / 1024}, files
