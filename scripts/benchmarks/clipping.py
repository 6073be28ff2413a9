"""How much of a relit splat clips, beside its capture and the truth at the exposure of the capture.

Percentages of the pixels that show the scene, in views that were held back, whose largest channel is shown as 255, and
as 250 or more. Names and data are those of `scripts/bench baselines`.
"""

import tempfile
from pathlib import Path

from benchmarks import baselines
from benchmarks.harness import GROUND_TRUTH
from benchmarks.truths import clipped
from relight.jobs.job import Job
from relight.jobs.results import Results
from relight.request import RelightRequest
from splat2mesh.scene.color import srgb_from_linear

QUICK = baselines.QUICK


def arguments(parser):
    parser.add_argument("names", nargs="*", metavar="NAME", default=baselines.DEFAULT)
    parser.add_argument("--data", type=Path, default=GROUND_TRUTH)
    parser.add_argument("--scenes", type=Path, default=Path(tempfile.gettempdir()) / "bench_baselines")
    parser.add_argument("--lights", type=int, metavar="N", help="the first N lights only")
    parser.add_argument("--splats", type=int, default=50_000, help="of generated places")


def run(options, report):
    levels = {"255": 254.5, "250": 249.5}
    columns = [f"{what}_{level}" for level in levels for what in ("captured", "relit", "true")]
    table = report.table(scene="<18", light="<14", exposure=".3f", **dict.fromkeys(columns, ".2f"))
    for name in options.names:
        truth = baselines.truth_of(name, options)
        if truth is None:
            report.note(f"{name} left out: {options.data} holds no groundtruth/{name}")
            continue
        for light in [*truth.lights][: options.lights]:
            job = Job(RelightRequest(truth.folder, truth.lights[light], formats=("splat",)))
            shaded = next(iter(job.shaded()))
            row = {"scene": name, "light": light, "exposure": shaded.exposure}
            before, wanted = truth.pictures.pixels(job.inputs.splats[0], light)
            shown, _ = truth.pictures.pixels(Results(job).relit.relit(shaded), light)
            looks = {"captured": map(srgb_from_linear, before), "relit": map(srgb_from_linear, shown), "true": wanted}
            for what, colors in looks.items():
                colors = list(colors)
                row |= {f"{what}_{level}": clipped(colors, least) for level, least in levels.items()}
            table.add(**row)
