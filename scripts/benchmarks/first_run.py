"""The first run of `splat2mesh`, then of `relight`, which compiles their kernels.

Each run has an empty cache of kernels. Clock and memory want a quiet machine: the load is printed.
Memory is the largest sum over the command and what it started, read ten times a second. --warm runs each command once
more with its cache full.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from .harness import ROOT

QUICK = ["--warm", "--repeats", "1"]
"""On the example room."""


def arguments(parser):
    parser.add_argument("splat", nargs="?", type=Path, default=ROOT / "examples" / "lounge.sog")
    parser.add_argument("--env", default="sunset", help="light of relight")
    parser.add_argument("--meshing", default="", help="further words for splat2mesh, in one")
    parser.add_argument("--repeats", type=int, default=2, help="runs of each command")
    parser.add_argument("--warm", action="store_true", help="also run with the cache full")


def run(options, report):
    table = report.table(
        f"{options.splat.name}, load {os.getloadavg()[0]:.1f}",
        command="<12", cache="<6", clock="7.1f", cpu="7.1f", mb="7.0f", load="7.1f",
    )  # fmt: skip
    states = ["empty", "full"] if options.warm else ["empty"]
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(options.repeats):
            scene, cache = Path(folder) / "scene", Path(folder) / "cache"
            commands = {
                "splat2mesh": [options.splat, "-o", scene, "--overwrite", *options.meshing.split()],
                "relight": [scene, "--env", options.env],
            }
            for command, words in commands.items():
                shutil.rmtree(cache, ignore_errors=True)
                for state in states:
                    for left in (scene / "relit", scene / "cache"):
                        shutil.rmtree(left, ignore_errors=True)
                    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
                    clock, cpu, mb = measured([sys.executable, "-m", command, *map(str, words)], environment)
                    load = os.getloadavg()[0]
                    table.add(command=command, cache=state, clock=clock, cpu=cpu, mb=mb, load=load)


def measured(line, environment):
    """Run a command: seconds of the clock, processor seconds of it and of what it started, and their memory in MB."""
    before, start = os.times(), time.perf_counter()
    with subprocess.Popen(line, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL) as process:
        most = [0.0]

        def watch():
            while process.poll() is None:
                most[0] = max(most[0], family_mb(process.pid))
                time.sleep(0.1)

        watcher = threading.Thread(target=watch)
        watcher.start()
        process.wait()
        watcher.join()
    clock, after = time.perf_counter() - start, os.times()
    if process.returncode:
        raise SystemExit(f"{' '.join(line)} failed")
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return clock, cpu, most[0]


def family_mb(pid):
    """Memory of a process and of all that it started, in MB; pages that they share count once each time. Linux."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20 + sum(family_mb(int(child)) for child in children)
