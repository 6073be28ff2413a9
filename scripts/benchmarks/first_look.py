"""From a splat file to its first look and to the final result: how long each takes, and how far apart they are.

FILE is a splat; without any, a nook is generated. Each is relit by `relight FILE --quick`, then by `relight FILE`, that
meshes it, as commands in an empty folder. Seconds of the clock until the first picture is there and until the end, and
processor seconds of all threads. `db` is the PSNR of the first look's colours against the final ones, over Gaussians
that are no far background, weighted by opacity and area. With --truth both are scored against the pictures of a known
scene too, with one gain for each colour: `first_db`, `final_db`. All run compiled: the quick command once before,
unmeasured.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.harness import ROOT

QUICK = ["--kind", "object", "--splats", "3000"]


def arguments(parser):
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE")
    parser.add_argument("--env", default="sunset", metavar="FILE|NAME")
    parser.add_argument("--up", default="auto", metavar="AXIS")
    parser.add_argument("--truth", type=Path, metavar="FOLDER", help="of a scene, with pictures under --env")
    parser.add_argument("--kind", default="nook", help="of the generated scene")
    parser.add_argument("--splats", type=int, default=30_000, help="of the generated scene")


def run(options, report):
    with tempfile.TemporaryDirectory() as folder:
        columns = {"first_s": ".1f", "first_cpu": ".1f", "final_s": ".1f", "final_cpu": ".1f", "db": ".1f"}
        columns |= {"first_db": ".1f", "final_db": ".1f"} if options.truth else {}
        table = report.table("", scene="<14", splats="d", **columns)
        for source in options.files or [_made(options, Path(folder))]:
            table.add(**_row(source.resolve(), options, Path(folder)))


def _made(options, folder):
    from scenes.__main__ import main as made

    made([str(folder / "made"), "--kind", options.kind, "--splats", str(options.splats), "--views", "24"])
    return folder / "made" / "splat.ply"


def _row(source, options, folder):
    from splat2mesh.splats.formats import read_splats

    light = str(Path(options.env).resolve()) if Path(options.env).exists() else options.env
    words = [str(source), "--env", light, "--up", options.up, "-q"]
    for name in ("warm", "first"):
        wait, cpu = _timed([*words, "--quick", "-o", name], folder)
    whole, whole_cpu = _timed([*words, "--format", "splat", "png", "-o", "final"], folder)
    splats = [read_splats(folder / name / "relit_splat.ply") for name in ("first", "final")]
    found = {"scene": source.parent.name if source.stem == "point_cloud" else source.stem, "splats": len(splats[0])}
    found |= {"first_s": wait, "first_cpu": cpu, "final_s": whole, "final_cpu": whole_cpu, "db": _apart(*splats)}
    if options.truth:
        from scenes.pictures import Pictures

        truth = Pictures(options.truth)
        for name, each in zip(("first_db", "final_db"), splats, strict=True):
            found[name] = truth.score(each, Path(options.env).stem).psnr_wb
    return found


def _timed(words, folder):
    """Seconds of the clock and of all threads."""
    start = time.perf_counter()
    work = subprocess.Popen(
        [sys.executable, "-m", "relight", *words], cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    _, status, used = os.wait4(work.pid, 0)
    work.returncode = os.waitstatus_to_exitcode(status)
    if work.returncode:
        sys.exit(f"scripts/bench first_look: relight failed with {work.returncode}")
    return time.perf_counter() - start, used.ru_utime + used.ru_stime


def _apart(first, final):
    """PSNR of display colours."""
    from splat2mesh.surface.background import far_background

    scales = np.sort(final.scales, axis=1)
    weight = (final.opacities * scales[:, 1] * scales[:, 2]).astype(np.float64)
    weight = np.minimum(weight, np.percentile(weight, 95)) * ~far_background(final)
    colors = [np.clip(each.colors_diffuse, 0.0, 1.0) for each in (first, final)]
    error = weight @ ((colors[0] - colors[1]) ** 2).mean(axis=1) / weight.sum()
    return -10.0 * np.log10(error)
