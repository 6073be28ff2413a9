"""From a splat file to its first look and to the final result: how long each takes, and how far apart they are.

FILE is a splat; without any, a nook is generated. Each is relit by `relight FILE --quick`, then by `relight FILE`, that
meshes it, as commands in an empty folder. Seconds of the clock until the first picture is there and until the end, and
processor seconds of all threads. `db` is the PSNR of the first look's colours against the final ones, over Gaussians
that are no far background, weighted by opacity and area. With --truth both are scored against the pictures of a known
scene too, with one gain for each colour: `first_db`, `final_db`. All run compiled: the quick command once before,
unmeasured.

Then, for each FILE, what a person has on the screen after some seconds (--at) and at the end: the splat as captured,
the first look, or the final one. The figures are PSNR of pictures against that of the final splat, from the camera of
the scene's preview. --strip writes these pictures, a row for each FILE. On a busy machine, --waits gives the seconds
that a quiet one took.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import imageio.v3 as iio
import numpy as np

from benchmarks.harness import ROOT
from relight.light.loading import light_of
from relight.output.picture import RelitPicture
from scenes.pictures import Pictures
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.foreground import far_background
from splat2mesh.splats.formats import read_splats

QUICK = ["--kind", "object", "--splats", "3000"]

SIZE, QUALITY = (360, 270), 80
"""Pixels of the pictures of a strip, and how well they are kept."""

SOLID = 0.5
"""Opacity from which a pixel shows the scene."""


def arguments(parser):
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE")
    parser.add_argument("--env", default="sunset", metavar="FILE|NAME")
    parser.add_argument("--up", default="auto", metavar="AXIS")
    parser.add_argument("--truth", type=Path, metavar="FOLDER", help="of a scene, with pictures under --env")
    parser.add_argument("--at", type=float, nargs="+", default=[5.0, 10.0, 30.0], metavar="S", help="default: 5 10 30")
    parser.add_argument("--strip", type=Path, metavar="FILE", help="write what the screen shows at these times")
    parser.add_argument(
        "--waits", type=float, nargs="+", metavar="S", help="seconds until first looks and ends, in pairs"
    )
    parser.add_argument("--kind", default="nook", help="of the generated scene")
    parser.add_argument("--splats", type=int, default=30_000, help="of the generated scene")


def run(options, report):
    waits = options.waits or []
    if options.waits and len(waits) != 2 * len(options.files):
        sys.exit("scripts/bench first_look: --waits takes two numbers for each FILE")
    with tempfile.TemporaryDirectory() as folder:
        columns = {"first_s": ".1f", "first_cpu": ".1f", "final_s": ".1f", "final_cpu": ".1f", "db": ".1f"}
        columns |= {"first_db": ".1f", "final_db": ".1f"} if options.truth else {}
        columns |= {f"at_{seconds:g}": ".1f" for seconds in options.at}
        table, rows = report.table("", scene="<14", splats="d", **columns), []
        for number, source in enumerate(options.files or [_made(options, Path(folder))]):
            row, stages = _row(source.resolve(), options, Path(folder))
            if waits:
                stages = _at_other_times(stages, *waits[2 * number : 2 * number + 2])
            pictures = Stages(Path(folder), stages)
            table.add(**row, **{f"at_{seconds:g}": pictures.psnr(seconds) for seconds in options.at})
            rows.append(np.concatenate([pictures.at(seconds) for seconds in (*options.at, math.inf)], axis=1))
        if options.strip:
            iio.imwrite(options.strip, np.concatenate(rows), quality=QUALITY)


def _made(options, folder):
    from scenes.__main__ import main as made

    made([str(folder / "made"), "--kind", options.kind, "--splats", str(options.splats), "--views", "24"])
    return folder / "made" / "splat.ply"


def _row(source, options, folder):
    """The figures of a FILE, and its stages: seconds from which each is seen, and its splat file."""
    light = str(Path(options.env).resolve()) if Path(options.env).exists() else options.env
    words = [str(source), "--env", light, "--up", options.up, "-q"]
    seen = None
    for name in ("warm", "first"):
        seen = _timed([*words, "--quick", "-o", name], folder, refused=True)
    whole, whole_cpu = _timed([*words, "--format", "splat", "png", "-o", "final"], folder)
    stages = [(0.0, source), (whole, folder / "final" / "relit_splat.ply")]
    if seen:
        stages.insert(1, (seen[0], folder / "first" / "relit_splat.ply"))
    splats = [read_splats(file) for _, file in stages]
    found = {"scene": source.parent.name if source.stem == "point_cloud" else source.stem, "splats": len(splats[0])}
    found |= {"final_s": whole, "final_cpu": whole_cpu}
    if seen:
        found |= {"first_s": seen[0], "first_cpu": seen[1], "db": _apart(*splats[1:])}
    if options.truth:
        truth = Pictures(options.truth)
        for name, each in zip(("first_db", "final_db")[-len(splats) + 1 :], splats[1:], strict=True):
            found[name] = truth.score(each, Path(options.env).stem).psnr_wb
    return found, stages


def _at_other_times(stages, first, final):
    """The same as if first look and end had been there after other seconds."""
    return [(wait, file) for wait, (_, file) in zip((0.0, *(first, final)[3 - len(stages) :]), stages, strict=True)]


class Stages:
    """What is seen of a scene after some seconds. stages: seconds from which each is seen, and splat files, the last
    final. folder: of the results."""

    def __init__(self, folder, stages):
        report = json.loads((folder / "final" / "report.json").read_text())
        environment = light_of(report["environment"]["source"] or report["environment"]["name"])
        scene = Scene.load(folder / report["scene"])
        picture = RelitPicture(scene, size=SIZE, samples=1)
        self._waits = [wait for wait, _ in stages]
        splats = [read_splats(file) for _, file in stages]
        self._seen = [picture.seen(each) for each in splats]
        behind = [None, *[environment] * (len(splats) - 1)]
        self._shown = [
            picture.of_splats(each, light, report["exposure"], inset=False)
            for each, light in zip(splats, behind, strict=True)
        ]

    def _number(self, seconds):
        return max(number for number, wait in enumerate(self._waits) if wait <= seconds)

    def at(self, seconds):
        """The picture, (H, W, 3) uint8."""
        return self._shown[self._number(seconds)]

    def psnr(self, seconds):
        """Of the splats against the final ones where these are, in dB; None of the final ones."""
        number, final = self._number(seconds), self._seen[-1]
        if number == len(self._seen) - 1:
            return None
        off = (np.clip(self._seen[number].color, 0, 1) - np.clip(final.color, 0, 1))[final.alpha > SOLID]
        return float(-10.0 * np.log10(np.mean(off.astype(np.float64) ** 2)))


def _timed(words, folder, refused=False):
    """Seconds of the clock and of all threads; None where `refused` may be, and is, what was asked."""
    start = time.perf_counter()
    work = subprocess.Popen(
        [sys.executable, "-m", "relight", *words], cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    _, status, used = os.wait4(work.pid, 0)
    work.returncode = os.waitstatus_to_exitcode(status)
    if work.returncode == 2 and refused:
        return None
    if work.returncode:
        sys.exit(f"scripts/bench first_look: relight failed with {work.returncode}")
    return time.perf_counter() - start, used.ru_utime + used.ru_stime


def _apart(first, final):
    """PSNR of display colours."""
    scales = np.sort(final.scales, axis=1)
    weight = (final.opacities * scales[:, 1] * scales[:, 2]).astype(np.float64)
    weight = np.minimum(weight, np.percentile(weight, 95)) * ~far_background(final)
    colors = [np.clip(each.colors_diffuse, 0.0, 1.0) for each in (first, final)]
    error = weight @ ((colors[0] - colors[1]) ** 2).mean(axis=1) / weight.sum()
    return -10.0 * np.log10(error)
