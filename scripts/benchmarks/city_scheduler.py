"""A scheduler of dask.distributed with the tasks of a city of many tiles without work.

Scheduler, workers and client are three processes, so each shows its own processor time and memory.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil

from splat2mesh.tiles.tasks import Cluster, Done, Task

WORKERS = """
import asyncio, sys
import dask
from distributed import Worker

dask.config.set({"distributed.worker.profile.enabled": False})  # no profile of the workers

async def main(address, count):
    workers = [await Worker(address, nthreads=1, dashboard=False, silence_logs=50) for _ in range(count)]
    await asyncio.gather(*(worker.finished() for worker in workers))

asyncio.run(main(sys.argv[1], int(sys.argv[2])))
"""

SCHEDULER = """
import asyncio
from distributed import Scheduler

async def main():
    async with Scheduler(host="127.0.0.1", port=0, dashboard=False) as scheduler:
        print(scheduler.address, flush=True)
        await scheduler.finished()

asyncio.run(main())
"""


def nothing(tile, *_):
    """A tile that takes no time; its record is as long as a real one."""
    return {"tile": tile, "files": {f"{tile}/{n}": {"bytes": tile, "sha256": "0" * 64} for n in range(4)}}


def tasks_of(side):
    """The tasks of side x side tiles, each of which needs the depth maps of those around it."""
    tasks, looked = [], set()
    for n in range(side * side):
        x, z = divmod(n, side)
        around = [
            (x + i) * side + z + j for i in (-1, 0, 1) for j in (-1, 0, 1) if 0 <= x + i < side and 0 <= z + j < side
        ]
        for other in around:
            if other not in looked:
                looked.add(other)
                tasks.append(Task(f"look {other}", nothing, (other,)))
        tasks.append(Task(f"mesh {n}", nothing, (n,), tuple(f"look {other}" for other in around)))
    return tasks


def simulate(tiles, workers):
    """The cost of a scheduler for about `tiles` tiles on `workers` workers: a dict of figures, seconds and MB."""
    from dask.distributed import Client

    side = max(2, round(np.sqrt(tiles)))
    known = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}  # where they find `nothing`
    scheduler = subprocess.Popen([sys.executable, "-c", SCHEDULER], stdout=subprocess.PIPE, text=True, env=known)
    others = None
    try:
        address = scheduler.stdout.readline().strip()
        others = subprocess.Popen([sys.executable, "-c", WORKERS, address, str(workers)], env=known)
        with Client(address) as client:
            client.wait_for_workers(workers, timeout=300)
            seen = psutil.Process(scheduler.pid)
            rest, before = seen.memory_info().rss, _seconds(seen)
            start, own = time.perf_counter(), time.process_time()
            done, first = [], None
            for each in Cluster(client).run(tasks_of(side)):
                first = first or time.perf_counter() - start
                done.append(each)
            wall, own = time.perf_counter() - start, time.process_time() - own
            assert len(done) == 2 * side * side and all(isinstance(each, Done) and not each.error for each in done)
            figures = {"tiles": side * side, "tasks": len(done), "workers": workers, "wall": wall, "first": first}
            figures |= {"scheduler_s": _seconds(seen) - before, "client_s": own}
            figures |= {"scheduler_mb": (seen.memory_info().rss - rest) / 2**20}
            return figures | {"client_mb": psutil.Process().memory_info().rss / 2**20}
    finally:
        for process in (others, scheduler):
            if process is not None:
                process.kill()
                process.wait()


def _seconds(process):
    times = process.cpu_times()
    return times.user + times.system
