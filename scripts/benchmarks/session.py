"""Pictures per second of an interactive session while its light turns, and the time of each part.

Off screen, so no monitor paces it; a tabletop of VERTICES (100,000) under the built-in lights. Each line is the
median over frames, in milliseconds: the light and its bytes, the mixing of pixels (`relight.viewer.raster`), the panel,
OpenGL, and all of it; on a busy machine the quickest tenth says more. Then the same while the camera moves, and with
the background at work.
"""

import os
import platform
import time

import numpy as np

import relight.viewer.stage
from benchmarks.shapes import shape
from relight.viewer import view

FRAMES = 60
SIZES = (960, 720), (1280, 800), (1600, 1000)


QUICK = ["--vertices", "2000", "--frames", "3", "--sizes", "1"]


def arguments(parser):
    parser.add_argument("--vertices", type=int, default=100_000, help="of the tabletop")
    parser.add_argument("--frames", type=int, default=FRAMES, help="that a line is the median of")
    parser.add_argument(
        "--sizes", type=int, default=len(SIZES), metavar="N", help="the first N sizes of the window only"
    )


def run(options, report):
    scene, frames = shape("tabletop", options.vertices).scene, options.frames
    load = f"load {os.getloadavg()[0]:.1f} of {os.cpu_count()} cores"
    report.note(f"{len(scene.vertices):,} vertices, {len(scene.faces):,} faces; {load}")
    for size in SIZES[: options.sizes]:
        window = view(scene, "noon", off_screen=True, size=size)
        window.finish()
        window.picture()
        if size == SIZES[0]:
            lines = window.plotter.render_window.ReportCapabilities().splitlines()
            report.note(next((line for line in lines if "renderer string" in line), platform.machine()))
        for sky in (True, False):
            window.session.change(sky=sky, turning=True)
            report.note(f"{size[0]} x {size[1]}, {'with' if sky else 'without'} the sky: {measured(window, frames)}")
        window.session.change(turning=False)
        report.note(f"{size[0]} x {size[1]}, the camera moves: {measured(window, frames, 0.01)}")
        window.session.change(turning=True)
        if size == SIZES[0]:
            window.session.change(tolerance=0.003)  # the background plans and traces for seconds
            report.note(f"{size[0]} x {size[1]}, while the background works: {measured(window, frames)}")
        window.close()


def measured(window, frames, turn=0.0):
    """Rates and medians of some frames, as text. turn: of the camera in each, in heights of the window."""
    stage, glass = window._stage, window.plotter.render_window
    parts = (
        (relight.viewer.stage, "surface_colors", "light"),
        (stage, "drawn", "mixing pixels"),
        (window.panel, "draw", "panel"),
        (glass, "Render", "OpenGL"),
    )
    spent = {part: [] for *_, part in parts} | {"all": []}
    undo = []
    for owner, name, part in parts:
        plain = getattr(owner, name)
        setattr(owner, name, timed(plain, spent[part]))
        undo.append((owner, name, plain))
    for _ in range(5):
        window.tick()
    for times in spent.values():
        times.clear()
    start, cpu = time.perf_counter(), time.process_time()
    for _ in range(frames):
        before = time.perf_counter()
        window.look(window.orbit.dragged(turn, 0.0))
        window.tick()
        spent["all"].append(time.perf_counter() - before)
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    for owner, name, plain in undo:
        setattr(owner, name, plain)
    parts = ", ".join(f"{part} {1e3 * np.median(times):.1f}" for part, times in spent.items() if times)
    slowest, quick = 1e3 * max(spent["all"]), 1e3 * np.percentile(spent["all"], 10)
    rate, each = f"{frames / seconds:.0f} pictures/s", f"CPU {1e3 * cpu / frames:.0f} a picture"
    return f"{rate}; ms: {parts}, a tenth within {quick:.0f}, slowest {slowest:.0f}; {each}"


def timed(work, times):
    def run(*arguments, **options):
        start = time.perf_counter()
        try:
            return work(*arguments, **options)
        finally:
            times.append(time.perf_counter() - start)

    return run
