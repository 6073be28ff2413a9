"""Generated gardens and nooks, relit by both commands, against the unchanged file: where relighting loses.

One row for each place, seed and light: PSNR with one gain for each colour of the unchanged splats and of ours, against
the same splats in their true colours, and what the report says of its own estimate. Rows are kept in rows.jsonl of the
folder of scenes: a second call goes on where the first one ended.
"""

import json
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.harness import GROUND_TRUTH
from benchmarks.truths import generated
from relight.jobs.job import Job
from relight.jobs.writer import Writer
from relight.request import RelightRequest
from scenes.pictures import psnr
from splat2mesh.scene.color import luminance

CAPTURES = ("overcast", "cloudy", "noon", "sunset"), ("overcast", "cloudy", "rnl", "campus", "noon", "kitchen")
"""Lights of the captures, by seed in turns: built-in ones alone, and with those of the data folder."""

LIGHTS = ("studio", "noon", "sunset", "overcast"), ("stpeters", "grace", "campus", "rnl")
"""New lights, the first three that are not that of the capture."""

QUICK = ["--seeds", "1", "--kinds", "nook", "--splats", "6000", "--lights", "1"]


def arguments(parser):
    parser.add_argument("--seeds", default="1-12", metavar="A-B", help="or a list: 1,4,7")
    parser.add_argument("--kinds", nargs="+", default=["garden", "nook"])
    parser.add_argument("--splats", type=int, default=30_000)
    parser.add_argument("--lights", type=int, default=3, metavar="N", help="the first N lights only")
    parser.add_argument("--data", type=Path, default=GROUND_TRUTH, help="folder whose env holds more lights")
    parser.add_argument("--scenes", type=Path, default=Path(tempfile.gettempdir()) / "bench_gardens")


def run(options, report):
    options.scenes.mkdir(parents=True, exist_ok=True)
    columns = {"place": "<22", "light": "<10", "unchanged": ".2f", "ours": ".2f", "gain": ".2f"}
    columns |= dict.fromkeys(("evidence", "change"), ".2f")
    table = report.table(**columns)
    file = options.scenes / "rows.jsonl"
    there = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    for seed in seeds_of(options.seeds):
        for kind in options.kinds:
            for row in rows(kind, seed, options, there):
                if row not in there:
                    with open(file, "a") as out:
                        out.write(json.dumps(row) + "\n")
                table.add(**row)
    gains = [row["gain"] for row in table.rows]
    if gains:
        lost = sum(gain < -0.1 for gain in gains)
        report.note(f"{lost} of {len(gains)} more than .1 dB below unchanged; mean gain {np.mean(gains):.2f} dB")


def seeds_of(text):
    """Whole numbers of "1-4,7"."""
    parts = [part.split("-") for part in text.split(",")]
    return [seed for part in parts for seed in range(int(part[0]), int(part[-1]) + 1)]


def rows(kind, seed, options, there):
    """Rows of one place, one a light."""
    rich = (options.data / "env").is_dir()
    sky = CAPTURES[rich][seed % len(CAPTURES[rich])]
    names = [name for name in LIGHTS[rich] if name != sky][:3]
    place, known = f"{kind}{seed}-{sky}-{options.splats // 1000}k", {}
    for row in there:
        if row["place"] == place:
            known[row["light"]] = row
    wanted, job, truth = names[: options.lights], None, None
    for name in wanted:
        if name in known:
            yield known[name]
            continue
        if truth is None:
            truth = generated(kind, seed, sky, names, options.scenes, options.splats, options.data, "draft")
        light = truth.lights[name]
        job = job.under(light) if job else Job(RelightRequest(truth.folder, light, formats=("splat",)))
        yield {"place": place, "light": name, **measured(job, truth, name)}


def measured(job, truth, name):
    """The scores of one light, and its entries in the report."""
    shaded, look = next(iter(job.shaded())), job.known.appearance
    unchanged = psnr(*truth.pictures.pixels(job.inputs.splats[0], name)).psnr_wb
    ours = psnr(*truth.pictures.pixels(Writer(job).relit_splats(shaded), name)).psnr_wb
    row = {"unchanged": unchanged, "ours": ours, "gain": ours - unchanged}
    capture = look.capture or {}
    return row | {
        "change": change(look, shaded),
        "evidence": float(np.mean(capture["evidence"])),
        **{key: capture[key] for key in ("brightness", "concentration")},
        "kept": look.as_captured,
    }


def change(look, shaded):
    """Spread of the logarithm of the change of light over the vertices, weighted alike: 0 where all change alike."""
    after, before = look.received(shaded.shading.radiance), look.irradiance
    logs = np.log(np.maximum(luminance(after), 1e-4)) - np.log(np.maximum(luminance(before), 1e-4))
    return float(np.std(logs))
