"""Cities in tiles: borders, equal bytes however the tiles are made, overhead, memory, the curve of cost, a scheduler.

Each run is a process of its own. Cities are generated; depth maps and light are those of `--detail draft`.
"""

import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from benchmarks.harness import ROOT
from splat2mesh.tiles.seams import check_seams
from splat2mesh.tiles.store import Store
from splat2mesh.tiles.tasks import Cluster, Done, Task

QUICK = ["1000", "--parts", "scheduler", "--dummies", "50"]

PARTS = ("curve", "bytes", "scheduler")

RUN = """
import json, sys
from splat2mesh.tiles.city import convert_city
from splat2mesh.tiles.tasks import engine
source, output, workers, settings = sys.argv[1], sys.argv[2], json.loads(sys.argv[3]), json.loads(sys.argv[4])
with engine(None, workers, None) as running:
    print(json.dumps(convert_city(source, output, running, detail="draft", **settings)))
"""
"""What a process of its own runs; tile_splats, which the command leaves to --memory, sets the size of the tiles."""


def arguments(parser):
    add = parser.add_argument
    add("sizes", type=float, nargs="*", default=[1e5, 1e6], metavar="SPLATS", help="cities (default: 100000 1000000)")
    add("--parts", nargs="+", choices=PARTS, default=PARTS, help="what to measure (default: all)")
    add("--tile-splats", type=int, default=60_000, metavar="N", help="of a tile and its halo (default: %(default)s)")
    add("--deaths", type=int, default=1, metavar="N", help="runs with a worker killed at random (default: %(default)s)")
    add("--dummies", type=int, default=10_000, metavar="N", help="tiles of the simulation (default: %(default)s)")
    add("--folder", type=Path, help="keep the cities here, and take those that are (default: temporary)")


def run(options, report):
    with tempfile.TemporaryDirectory(prefix="bench_city.") as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        if "curve" in options.parts:
            curve(folder, options, report)
        if "bytes" in options.parts:
            equal_bytes(folder, options, report)
    if "scheduler" in options.parts:
        scheduler(options.dummies, report)


def city(folder, splats):
    """A generated city, made where it is not there."""
    path = folder / f"city_{splats}"
    if not path.exists():
        command = [sys.executable, "-m", "scenes", path, "--kind", "city", "--splats", str(splats), "--quiet"]
        subprocess.run(command, check=True, cwd=ROOT, env=_environment())
    return path / "tiles"


def started(source, output, workers=None, **settings):
    """A process that meshes a city."""
    command = [sys.executable, "-c", RUN, source, output, json.dumps(workers), json.dumps(settings)]
    return subprocess.Popen(list(map(str, command)), cwd=ROOT, env=_environment(), stdout=subprocess.PIPE, text=True)


def convert(source, output, workers=None, killed_after=None, **settings):
    """Mesh a city; returns the report with `wall` and `cpu` in seconds. killed_after: seconds after which one of its
    workers is killed."""
    start, before = time.perf_counter(), os.times()
    process = started(source, output, workers, **settings)
    if killed_after is not None:
        threading.Timer(killed_after, _kill_a_worker, (process.pid,)).start()
    text, _ = process.communicate()
    after = os.times()
    if process.returncode:
        raise SystemExit(f"splat2mesh failed with {process.returncode}")
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return {**json.loads(text), "wall": time.perf_counter() - start, "cpu": cpu}


def _environment():
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}


def _kill_a_worker(pid):
    """Kill one process among the grandchildren of a process: those that nannies started."""
    children = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                children.setdefault(int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1]), []).append(
                    int(entry.name)
                )
            except OSError:
                pass
    pending, found = [pid], []
    while pending:
        for child in children.get(pending.pop(), []):
            pending.append(child)
            found.append(child)
    spawned = [each for each in found if b"spawn_main" in _command_line(each)]
    if spawned:
        os.kill(random.choice(spawned), 9)


def _command_line(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


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


def equal_bytes(folder, options, report):
    splats = int(min(options.sizes))
    source = city(folder, splats)
    settings = {"tile_splats": options.tile_splats}
    runs = {"plain loop": None, "1 worker": 1, "2 workers": 2}
    table = report.table(
        f"the same city of {splats:,} splats by other ways", way="<22", wall=".1f", cpu=".1f", differing=".0f"
    )
    expected, usual = None, 0.0
    for name, workers in runs.items():
        output = _fresh(folder / "way")
        found = convert(source, output, workers, **settings)
        expected = expected or checksums(output)
        usual = found["wall"]
        table.add(way=name, wall=found["wall"], cpu=found["cpu"], differing=differing(expected, checksums(output)))
    for number in range(options.deaths):
        output = _fresh(folder / "way")
        after = random.Random(number).uniform(0.3, 0.9) * usual
        found = convert(source, output, 2, killed_after=after, **settings)
        row = {"wall": found["wall"], "cpu": found["cpu"], "differing": differing(expected, checksums(output))}
        table.add(way=f"2 workers, death {number}", **row)
    output = _fresh(folder / "way")
    process = started(source, output, **settings)
    while not list(output.glob("tiles/*/mesh.json")) and process.poll() is None:
        time.sleep(0.1)
    process.kill()
    process.wait()
    found = convert(source, output, resume=True, **settings)
    row = {"wall": found["wall"], "cpu": found["cpu"], "differing": differing(expected, checksums(output))}
    table.add(way="killed and resumed", **row)


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


def nothing(tile, *_):
    """A tile that takes no time."""
    return tile


def scheduler(count, report):
    """What a scheduler of Dask takes for so many tiles with the dependencies of a city, when tiles take no time."""
    from dask.distributed import Client

    side = max(2, round(np.sqrt(count)))
    tasks = [Task(f"look {n}", nothing, (n,)) for n in range(side * side)]
    for n in range(side * side):
        x, z = divmod(n, side)
        around = [(x + i) * side + z + j for i in (-1, 0, 1) for j in (-1, 0, 1) if 0 <= x + i < side > z + j >= 0]
        tasks.append(Task(f"mesh {n}", nothing, (n,), tuple(f"look {m}" for m in around if m >= 0)))
    with Client(processes=False, n_workers=2, threads_per_worker=1, dashboard_address=":0") as client:
        start, cpu = time.perf_counter(), time.process_time()
        done = list(Cluster(client).run(tasks))
        wall, cpu = time.perf_counter() - start, time.process_time() - cpu
    assert all(isinstance(each, Done) and not each.error for each in done)
    table = report.table(
        "scheduler, client and two idle workers in one process", tiles="<10", wall=".1f", cpu=".1f", ms_a_task=".2f"
    )
    table.add(tiles=f"{side * side:,}", wall=wall, cpu=cpu, ms_a_task=1000 * cpu / len(tasks))
