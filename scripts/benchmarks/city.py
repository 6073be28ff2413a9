"""Cities in tiles: borders, equal bytes however tiles are made, overhead, memory, cost, light, a scheduler.

Each run is a separate process. Cities are generated; depth maps and light are those of `--detail draft`.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.city_light import light_error
from benchmarks.city_scheduler import simulate
from benchmarks.harness import ROOT
from benchmarks.seams import check_seams
from splat2mesh.base.console import ONE_BLAS_THREAD
from splat2mesh.tiles.store import Store

QUICK = ["1000", "--parts", "scheduler", "--dummies", "50"]

PARTS = ("curve", "light", "workers", "bytes", "scheduler")

SMALL, SMALL_TILE, SMALL_PIXELS = 24_000, 9_000, 40
"""Of the city that is made in every way: splats, those of a tile and its halo, side of the views."""

RUN = """
import sys
from pathlib import Path
sys.path.insert(0, str(Path(sys.argv[1]) / "scripts"))
from benchmarks import city_run
city_run.main(*sys.argv[2:])
"""
"""The work of a separate process; tile_splats, which the command leaves to --memory, sets the size of the tiles."""


def arguments(parser):
    add = parser.add_argument
    add("sizes", type=float, nargs="*", default=[1e5, 1e6], metavar="SPLATS", help="cities (default: 100000 1000000)")
    add("--parts", nargs="+", choices=PARTS, default=PARTS, help="what to measure (default: all)")
    add("--tile-splats", type=int, default=60_000, metavar="N", help="of a tile and its halo (default: %(default)s)")
    add(
        "--deaths", type=int, default=20, metavar="N", help="runs with a worker killed at random (default: %(default)s)"
    )
    add("--lights", nargs="+", default=["noon", "sunset"], metavar="ENV", help="(default: noon sunset)")
    add("--tiles", type=int, default=8, metavar="N", help="lit of each city, at most (default: %(default)s)")
    add("--vertices", type=int, default=500, metavar="N", help="used in all cities (default: %(default)s)")
    add("--shared", type=float, default=3e5, metavar="SPLATS", help="city that workers share (default: %(default)g)")
    add("--dummies", type=int, nargs="+", default=[100, 1000, 10_000], metavar="N", help="tiles of the simulation")
    add("--dummy-workers", type=int, default=4, metavar="N", help="its workers (default: %(default)s)")
    add("--folder", type=Path, help="folder that keeps and reuses the cities (default: temporary)")


def run(options, report):
    with tempfile.TemporaryDirectory(prefix="bench_city.") as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        if "curve" in options.parts:
            curve(folder, options, report)
        if "light" in options.parts:
            light(folder, options, report)
        if "workers" in options.parts:
            workers(folder, options, report)
        if "bytes" in options.parts:
            equal_bytes(folder, options, report)
    if "scheduler" in options.parts:
        scheduler(options, report)


def city(folder, splats):
    """A generated city, made where it is not there."""
    path = folder / f"city_{splats}"
    if not path.exists():
        command = [sys.executable, "-m", "scenes", path, "--kind", "city", "--splats", str(splats), "--quiet"]
        subprocess.run(command, check=True, cwd=ROOT, env=_environment())
    return path / "tiles"


def started(source, output, workers=None, **settings):
    """A process that meshes a city."""
    command = [sys.executable, "-c", RUN, ROOT, source, output, json.dumps(workers), json.dumps(settings)]
    return subprocess.Popen(list(map(str, command)), cwd=ROOT, env=_environment(), stdout=subprocess.PIPE, text=True)


def convert(source, output, workers=None, **settings):
    """Mesh a city; returns the report with `wall` and `cpu` in seconds."""
    start, before = time.perf_counter(), os.times()
    process = started(source, output, workers, **settings)
    text, _ = process.communicate()
    after = os.times()
    if process.returncode:
        raise SystemExit(f"splat2mesh failed with {process.returncode}")
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return {**json.loads(text), "wall": time.perf_counter() - start, "cpu": cpu}


def _environment():
    return {
        **os.environ,
        **ONE_BLAS_THREAD,
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
    }


def curve(folder, options, report):
    columns = {"splats": "<10", "tiles": ".0f", "vertices": ".0f", "wall": ".1f", "cpu": ".1f", "peak_gib": ".2f"}
    columns |= {"result_mb": ".1f", "disk_mb": ".1f", "edges": ".0f", "cracks": ".0f", "normals": ".0f"}
    table = report.table("cost of a city, plain loop; borders", **columns)
    rows = []
    for splats in map(int, options.sizes):
        source, output = city(folder, splats), folder / f"scene_{splats}"
        shutil.rmtree(output, ignore_errors=True)
        found = convert(source, output, tile_splats=options.tile_splats)
        seams = check_seams(Store(output))
        disk = sum(path.stat().st_size for path in output.rglob("*") if path.is_file())
        rows.append((splats, found["cpu"]))
        table.add(
            splats=f"{splats:,}",
            tiles=found["tiles"],
            vertices=found["vertices"],
            wall=found["wall"],
            cpu=found["cpu"],
            peak_gib=found["peak_mb"] / 1024,
            result_mb=found["bytes"] / 2**20,
            disk_mb=disk / 2**20,
            **{name: seams[name] for name in ("edges", "cracks", "normals")},
        )
    if len(rows) > 1:
        sizes, costs = np.array(rows).T
        each, fixed = np.polyfit(sizes, costs, 1)
        report.note(f"processor seconds = {fixed:.1f} + {1e6 * each:.1f} for each million splats, least squares")


def light(folder, options, report):
    """Light that tiles found against that of the untiled place around them; meshes what `curve` has not."""
    columns = {"splats": "<10", "light": "<10", "tiles": ".0f", "vertices": ".0f", "error": ".4f", "worst": ".4f"}
    table = report.table("light of tiles, tolerance .03, and of the place around them", **columns, cpu=".1f")
    for splats in map(int, options.sizes):
        output = folder / f"scene_{splats}"
        if not (output / "city.json").exists():
            convert(city(folder, splats), output, tile_splats=options.tile_splats)
        for name in options.lights:
            found = light_error(output, name, options.tiles, options.vertices)
            table.add(splats=f"{splats:,}", light=Path(name).stem, **found)


def workers(folder, options, report):
    """One city by the plain loop and by one and two workers, everything compiled before; what else ran shows in load,
    the processes that wanted a core before each way, and in cpu over wall; busy: the share of their time in which
    workers had a task, which says what the speed-up is where nothing else runs."""
    source, settings = city(folder, int(options.shared)), {"tile_splats": options.tile_splats}
    for number in (None, 1):
        convert(city(folder, SMALL), _fresh(folder / "way"), number, tile_splats=SMALL_TILE, pixels=SMALL_PIXELS)
    columns = {
        "way": "<12",
        "tiles": ".0f",
        "load": ".1f",
        "wall": ".1f",
        "tiles_wall": ".1f",
        "cpu": ".1f",
        "busy": ".2f",
    }
    table = report.table(f"a city of {int(options.shared):,} splats", **columns, peak_gib=".2f", differing=".0f")
    found, expected = {}, None
    for way, number in {"plain loop": None, "1 worker": 1, "2 workers": 2}.items():
        load, output = os.getloadavg()[0], _fresh(folder / "way")
        found[way] = convert(source, output, number, **settings)
        expected = expected or checksums(output)
        row = {name: found[way][name] for name in ("tiles", "wall", "cpu")}
        row["busy"] = sum(found[way]["task_seconds"].values()) / sum(found[way]["seconds"].values()) / (number or 1)
        row |= {"load": load, "tiles_wall": found[way]["seconds"]["tiles"], "peak_gib": found[way]["peak_mb"] / 1024}
        table.add(way=way, **row, differing=differing(expected, checksums(output)))
    plain, one, two = found.values()
    report.note(
        f"speed-up of 2 workers over 1: {one['wall'] / two['wall']:.2f}, over the plain loop "
        f"{plain['wall'] / two['wall']:.2f}; processor seconds of 1 worker over those of the plain loop: "
        f"{one['cpu'] / plain['cpu']:.2f}, wall-clock {one['wall'] / plain['wall']:.2f}"
    )


def equal_bytes(folder, options, report):
    """A small city made in every way; the killed runs share one cluster, whose first run is undisturbed."""
    source, settings = city(folder, SMALL), {"tile_splats": SMALL_TILE, "pixels": SMALL_PIXELS}
    table = report.table(
        f"a city of {SMALL:,} splats by other ways",
        way="<22",
        cpu=".1f",
        killed=".2f",
        tiles_done=".0f",
        differing=".0f",
    )
    expected = None
    for name, workers in {"plain loop": None, "1 worker": 1}.items():
        output = _fresh(folder / "way")
        found = convert(source, output, workers, **settings)
        expected = expected or checksums(output)
        table.add(way=name, cpu=found["cpu"], differing=differing(expected, checksums(output)))
    for name, signal in {"interrupted, resumed": 2, "killed, resumed": 9}.items():
        output = _fresh(folder / "way")
        process = started(source, output, **settings)
        while not list(output.glob("tiles/*/mesh.json")) and process.poll() is None:
            time.sleep(0.05)
        process.send_signal(signal)
        process.communicate()
        done = len(list(output.glob("tiles/*/mesh.json")))
        assert process.returncode and not (output / "city.json").exists()
        found = convert(source, output, resume=True, **settings)
        table.add(way=name, cpu=found["cpu"], tiles_done=done, differing=differing(expected, checksums(output)))
    process = started(source, folder / "deaths", 2, deaths=options.deaths, **settings)
    before = os.times()
    for line in process.stdout:
        found = json.loads(line)
        name = f"2 workers, death {found['number']}" if found["killed_after"] else "2 workers"
        found["differing"] = differing(expected, checksums(Path(found["output"])))
        table.add(way=name, killed=found["killed_after"], **{key: found[key] for key in ("tiles_done", "differing")})
        shutil.rmtree(found["output"])
    if process.wait():
        raise SystemExit(f"splat2mesh failed with {process.returncode}")
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    report.note(f"the runs on two workers: {cpu:.0f} processor seconds")


def _fresh(path):
    shutil.rmtree(path, ignore_errors=True)
    return path


def checksums(folder):
    """SHA-256 of each file of a result, by its name."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def differing(expected, found):
    """Files that are not in both, or not the same."""
    return sum(expected.get(name) != found.get(name) for name in expected.keys() | found.keys())


def scheduler(options, report):
    """The cost of a scheduler for cities of many tiles without work, and a model of it."""
    columns = {"tiles": "<8", "tasks": ".0f", "workers": ".0f", "wall": ".1f", "first": ".1f", "scheduler_s": ".1f"}
    columns |= {"client_s": ".1f", "ms_a_task": ".2f", "scheduler_mb": ".0f", "client_mb": ".0f"}
    table = report.table("a scheduler, its client and idle workers, a process each", **columns)
    rows = []
    for tiles in options.dummies:
        found = simulate(tiles, options.dummy_workers)
        rows.append(found)
        table.add(**found, ms_a_task=1000 * found["scheduler_s"] / found["tasks"])
    if len(rows) > 2:
        tasks = np.array([row["tasks"] for row in rows], float)
        for name, unit in {"scheduler_s": "s", "client_s": "s", "scheduler_mb": "MB"}.items():
            each, fixed = np.polyfit(tasks, [row[name] for row in rows], 1)
            report.note(f"{name} = {fixed:.1f} {unit} + {1000 * each:.2f} {unit} for each 1,000 tasks, least squares")
