"""The gain of each step in relighting a splat, from the unchanged file to all steps.

    unchanged         the file as captured
    new light alone   captured colours times the unshadowed light on their normals: the captured light stays in
    one SH light      ratio by the normal of two lights of nine coefficients, without shadows: the captured one is
                      fitted to the colours, as if all had one albedo
    normals, known    ratio of new to captured light by the normal alone, both lights known, without shadows and
                      bounces, as TranSplat relights diffuse surfaces
    normals           the same, with our estimate of the captured light
    ours, known       shadows, bounces, leaves and the fit in views, with the captured light known but for its exposure
    ours              the two commands without options

A NAME is a trained scene of the data folder (groundtruth/NAME with point_cloud.ply, env_train.exr, test_views.npz and
meta.json, and env/LIGHT.exr), or a generated place as KIND:SEED:SKY, which needs no data. PSNR is the mean over views,
in sRGB, over the pixels that show the scene: with one gain for all colours, and one for each.
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.harness import GROUND_TRUTH
from benchmarks.truths import generated, trained
from relight.jobs.job import Job
from relight.request import RelightRequest
from relight.sh.harmonics import evaluate
from relight.sh.normals import unit_normals
from relight.transfer.analytic import analytic
from scenes.pictures import psnr
from splat2mesh.scene.color import luminance

BANDS, FEW = 10, 3
"""Bands of lights on normals, and of the single light of nine coefficients."""

LEAST = 0.02
"""Least light, as a share of the median, of a fitted light, which may be negative."""

DEFAULT = ["spot", "tabletop", "ceramics", "patio", "parlour", "garden:3:overcast"]
SKIES = ("noon", "sunset", "studio")
"""New lights of generated places."""

QUICK = ["nook:2:overcast", "--lights", "1", "--splats", "6000"]


def arguments(parser):
    parser.add_argument("names", nargs="*", metavar="NAME", default=DEFAULT)
    parser.add_argument("--data", type=Path, default=GROUND_TRUTH)
    parser.add_argument("--scenes", type=Path, default=Path(tempfile.gettempdir()) / "bench_baselines")
    parser.add_argument("--lights", type=int, metavar="N", help="the first N lights only")
    parser.add_argument("--splats", type=int, default=50_000, help="of generated places")


def run(options, report):
    table = report.table(scene="<18", light="<14", way="<16", psnr_gain=".2f", psnr_wb=".2f")
    for name in options.names:
        truth = truth_of(name, options)
        if truth is None:
            report.note(f"{name} left out: {options.data} holds no groundtruth/{name}")
            continue
        for light in [*truth.lights][: options.lights]:
            for way, splats in ways(truth, truth.lights[light]):
                found = psnr(*truth.pictures.pixels(splats, light))
                table.add(scene=name, light=light, way=way, psnr_gain=found.psnr_gain, psnr_wb=found.psnr_wb)


def truth_of(name, options):
    """The Truth of a NAME, or None where the data lacks it."""
    options.scenes.mkdir(parents=True, exist_ok=True)
    kind, *rest = name.split(":")
    if rest:
        return generated(kind, int(rest[0]), rest[1], SKIES, options.scenes, options.splats, options.data)
    return trained(name, options.data, options.scenes) if (options.data / "groundtruth" / name).is_dir() else None


def ways(truth, environment):
    """Names and splats, from nothing done to all."""
    ours, known = (
        Job(RelightRequest(truth.folder, environment, formats=("splat",), capture_env=capture))
        for capture in (None, truth.captured_in)
    )
    binding, look, normals = ours.known.binding, ours.known.appearance, ours.known.scene.normals
    on_normals = analytic(normals, BANDS).astype(np.float64)

    def ratio(before, after):
        """Splats under a ratio of irradiances (V, 3), as bright as they were at the median."""
        before, after = (np.maximum(each, LEAST * np.median(luminance(each))) for each in (before, after))
        after = after * np.median(luminance(before)) / np.median(luminance(after))
        return binding.relit(before.astype(np.float32), after.astype(np.float32))

    def lit(light):
        return on_normals @ light.sh(BANDS)

    new = lit(environment)
    yield "unchanged", ours.inputs.splats[0]
    yield "new light alone", ratio(np.ones_like(new), new)
    yield "one SH light", ratio(fitted(normals, look.captured), on_normals[:, : FEW**2] @ environment.sh(FEW))
    yield "normals, known", ratio(lit(truth.captured_in), new)
    # A separated room has lamps, but no distant light.
    if look.environment is not None and look.room is None:
        yield "normals", ratio(lit(look.environment), new)
    for way, job in (("ours, known", known), ("ours", ours)):
        shaded = next(iter(job.shaded()))
        received = shaded.shading.received
        if received is None:
            received = job.known.appearance.received(shaded.shading.radiance, shaded.exposure)
        yield way, job.known.binding.relit(job.known.appearance.irradiance, received, shaded.exposure)


def fitted(normals, captured):
    """(V, 3) irradiance of the nine coefficients that explain captured colours (V, 3) by their normals alone.

    Source: Basri and Jacobs, "Lambertian reflectance and linear subspaces" (2003): nine harmonics of the normal.
    """
    basis = evaluate(unit_normals(normals), FEW).astype(np.float64)
    return basis @ np.linalg.lstsq(basis, captured.astype(np.float64), rcond=None)[0]
