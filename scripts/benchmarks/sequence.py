"""A sequence under a new light: dB of each frame against its truth, flicker on what rests, processor seconds.

A generated tabletop on which a column slides, or a box turns. PSNR with one gain a colour for all frames, in views
around. Flicker: the spread over time of the change of light less its true change, in percent, beside the noise of the
capture, of splats that do not move; also of those whose light stays, and of the others, which a moving shadow passes.
"""

import os
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.harness import timed
from relight.jobs.folders import relight_files
from relight.light.loading import light_of
from relight.request import RelightRequest
from scenes.cameras import capture_views
from scenes.sequence import MOTIONS, MovingTabletop
from splat2mesh.render.rasterize import rasterize
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.formats import read_splats, write_inria_ply

STEADY = 0.01
"""Spread over time, of the log of the true light on a splat, up to which it counts as light that stays."""

QUICK = ["--frames", "2", "--splats", "4000", "--views", "2"]


def arguments(parser):
    parser.add_argument("--frames", type=int, default=5)
    parser.add_argument("--splats", type=int, default=20_000)
    parser.add_argument("--views", type=int, default=6)
    parser.add_argument("--capture", default="noon", metavar="LIGHT")
    parser.add_argument("--light", default="sunset", metavar="LIGHT")
    parser.add_argument("--motion", choices=MOTIONS, default="slide")
    parser.add_argument("--lone", action="store_true", help="also light the last frame alone")


def run(options, report):
    scene = MovingTabletop(options.frames, options.splats, motion=options.motion)
    before, after = light_of(options.capture), light_of(options.light)
    gains = scene.gain(before), scene.gain(after)
    numbers = range(options.frames)
    names = [f"frame_{number:03d}.ply" for number in numbers]
    clean = [scene.splats(number, before, gains[0], 0.0) for number in numbers]
    true = [scene.splats(number, after, gains[1], 0.0) for number in numbers]
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as work:
        os.chdir(work)  # where scenes are kept
        folder, out = Path("frames"), Path("out")
        folder.mkdir()
        for number in numbers:
            write_inria_ply(folder / names[number], scene.splats(number, before, gains[0]))
        asked = RelightRequest(folder, options.light, sequence=True, output=out)
        done, _, seconds = timed(lambda: relight_files(asked))
        captured = [read_splats(folder / name) for name in names]
        relit = [read_splats(out / name) for name in names]
        table = report.table(frame="<16", state="<10", seconds=".1f", unchanged=".2f", relit=".2f")
        views = capture_views(scene.truth(0), options.views)
        wanted, *shown = ([_seen(each, views) for each in of] for of in (true, captured, relit))
        scores = [_psnr(pictures, wanted) for pictures in shown]
        for number, name in enumerate(names):
            entry = done.reports[0]["frames"][name]
            row = {"unchanged": scores[0][number], "relit": scores[1][number]}
            table.add(frame=name, state=entry["state"], seconds=entry["seconds"], **row)
        rest = ~scene.moving
        noise = _spread([_light(a) - _light(b) for a, b in zip(captured, clean, strict=True)], rest)
        change = [
            _light(a) - _light(b) - _light(c) + _light(d)
            for a, b, c, d in zip(relit, captured, true, clean, strict=True)
        ]
        steady = rest & (_changes(clean) < STEADY) & (_changes(true) < STEADY)
        report.note(f"noise of the capture {100 * noise:.2f}%, flicker {100 * _spread(change, rest):.2f}%")
        for name, rows in (("light stays", steady), ("a shadow passes", rest & ~steady)):
            if rows.any():
                share = rows.sum() / rest.sum()
                report.note(f"where {name} ({share:.0%} of them) {100 * _spread(change, rows):.2f}%")
        report.note(f"the sequence took {seconds:.1f} processor seconds")
        if options.lone:
            asked = RelightRequest(folder / names[-1], options.light, formats=("splat",), output="lone")
            report.note(f"its last frame alone {timed(lambda: relight_files(asked)).cpu:.1f}")
        os.chdir(here)


def _light(splats):
    """Log of linear colours (N, 3); darker than .02 counts as that."""
    return np.log(np.maximum(linear_from_srgb(np.clip(splats.colors_diffuse, 0.0, 1.0)), 0.02))


def _changes(frames):
    """Standard deviation over time (N,) of the light of splats without noise, in the colour where it is largest."""
    return np.std(np.stack([_light(each) for each in frames]), axis=0).max(axis=1)


def _spread(values, rows):
    """Root mean square, over rows, of the standard deviation over time."""
    return float(np.sqrt(np.var(np.stack(values)[:, rows], axis=0).mean()))


def _seen(splats, views):
    return np.stack([linear_from_srgb(np.clip(rasterize(splats, view, 0.01).color, 0.0, 1.0)) for view in views])


def _psnr(pictures, wanted):
    """PSNR of each frame in sRGB, after one gain a colour for all frames."""
    found, true = (np.stack(each).astype(np.float64) for each in (pictures, wanted))
    gain = (found * true).sum(axis=(0, 1, 2, 3)) / (found * found).sum(axis=(0, 1, 2, 3))
    error = ((np.clip(found * gain, 0, 1) ** (1 / 2.2) - true ** (1 / 2.2)) ** 2).mean(axis=(1, 2, 3, 4))
    return -10.0 * np.log10(error)
