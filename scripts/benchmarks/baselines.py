"""What each step of relighting a splat is worth, on path-traced scenes: from the unchanged file to all of it.

    unchanged         the file as captured
    new light alone   captured colours times the unshadowed light on their normals: the captured light stays in
    normals, known    ratio of new to captured light by the normal alone, both lights known, without shadows and bounces
    normals           the same, with the captured light estimated
    ours, known       shadows, bounces, leaves and the fit in views, with the captured light known but for its exposure
    ours              the two commands without options

The data folder holds groundtruth/NAME (point_cloud.ply, env_train.exr, test_views.npz, meta.json) and env/LIGHT.exr.
PSNR is the mean over the test views where alpha is above 1/2, in sRGB: with one gain for all colours, and one for each.
"""

import json
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.harness import GROUND_TRUTH
from benchmarks.relit import GAINS, Pictures
from benchmarks.shapes import light_of
from relight import Environment
from relight.job import Job
from relight.request import RelightRequest
from relight.transfer.analytic import analytic
from splat2mesh.pipeline import convert
from splat2mesh.scene.color import luminance

BANDS = 3
"""Of the light on normals: nine harmonics hold it to 1%."""

QUICK = ["spot", "--lights", "1"]


def arguments(parser):
    parser.add_argument("names", nargs="*", metavar="NAME", default=["spot", "tabletop", "patio"])
    parser.add_argument("--data", type=Path, default=GROUND_TRUTH)
    parser.add_argument("--scenes", type=Path, default=Path(tempfile.gettempdir()) / "bench_baselines")
    parser.add_argument("--lights", type=int, metavar="N", help="the first N lights only")


def run(options, report):
    if not (options.data / "groundtruth").is_dir():
        raise SystemExit(f"{options.data} holds no groundtruth folder: name one with --data")
    table = report.table(scene="<10", light="<14", way="<16", psnr_gain=".2f", psnr_wb=".2f")
    for name in options.names:
        for row in rows(name, options):
            table.add(**row)


def rows(name, options):
    """Rows of the table, of one scene."""
    truth = options.data / "groundtruth" / name
    folder = options.scenes / name
    if not folder.exists():
        convert(truth / "point_cloud.ply", up="+y").save(folder)
    meta = json.loads((truth / "meta.json").read_text())
    captured_in, pictures = Environment.load(truth / "env_train.exr"), Pictures(truth)
    for light in meta["lights"]["relight"][: options.lights]:
        environment = light_of(options.data / "env", light)
        for way, splats in ways(folder, environment, captured_in):
            gain, balanced = score(pictures, splats, light)
            yield {"scene": name, "light": light, "way": way, "psnr_gain": gain, "psnr_wb": balanced}


def ways(folder, environment, captured_in):
    """Names and splats, from nothing done to all."""
    ours = job_of(folder, environment)
    known = job_of(folder, environment, captured_in)
    binding, look = ours.binding, ours.appearance
    on_normals = analytic(ours.scene.normals, BANDS).astype(np.float64)

    def lit(light):
        return np.maximum(on_normals @ light.sh(BANDS), 1e-4).astype(np.float32)

    new = lit(environment)
    yield "unchanged", ours.splats[0]
    yield "new light alone", binding.relit(np.ones_like(new), new / np.median(luminance(new)))
    for way, before in (("normals, known", lit(captured_in)), ("normals", lit(look.environment))):
        yield way, binding.relit(before, new * np.float32(np.median(luminance(before)) / np.median(luminance(new))))
    for way, job in (("ours, known", known), ("ours", ours)):
        shaded = next(iter(job.shaded()))
        received = job.appearance.received(shaded.shading.radiance, shaded.exposure)
        yield way, job.binding.relit(job.appearance.irradiance, received, shaded.exposure)


def job_of(folder, environment, captured_in=None):
    return Job(RelightRequest(folder, environment, formats=("splat",), capture_env=captured_in))


def score(pictures, splats, light):
    """PSNR in dB with the best gain for all colours, and with that of each colour."""
    shown, wanted = pictures.pixels(splats, light)
    every = np.array([pictures.errors(shown, wanted, gain) for gain in GAINS])  # (gains, views, colours)
    each = np.stack([every[every[:, :, c].mean(axis=1).argmin(), :, c] for c in range(3)], axis=1)
    alike = every[every.mean(axis=(1, 2)).argmin()]
    return tuple(float(-10 * np.log10(e.mean(axis=1)).mean()) for e in (alike, each))
