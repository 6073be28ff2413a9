"""Tasks on one process and on workers: order, failures, deaths."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from splat2mesh.options import TilingOptions
from splat2mesh.tiles.tasks import Cluster, Loop, Task, tiling_engine

ONE = TilingOptions(workers=1)


def add(a, b):
    return a + b


def fail(_):
    raise ValueError("broken\nin two lines")


def die_once(folder, number):
    """Kill the worker that runs this, the first time."""
    mark = Path(folder) / str(number)
    if not mark.exists():
        mark.touch()
        os._exit(1)
    return number


TASKS = [Task("a", add, (1, 2)), Task("b", fail, (0,)), Task("c", add, (3, 4), ("a",)), Task("d", add, (0, 0), ("b",))]
TASKS.append(Task("e", add, (0, 0), ("d",)))


def outcomes(running):
    return {done.name: (done.result, done.error) for done in running.run(TASKS)}


def test_a_failure_is_named_what_waits_for_it_is_left_and_the_rest_is_done():
    found = outcomes(Loop())
    assert found["a"][0] == 3 and found["c"][0] == 7
    assert found["b"] == (None, "ValueError: broken in two lines")
    assert found["d"] == (None, "waits for b, which failed") and found["e"] == (None, "waits for d, which failed")


def test_workers_say_the_same_and_one_that_dies_or_is_gone_is_replaced(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("splat2mesh.tiles.tasks.CONNECT_S", 0.5)
    with (
        pytest.importorskip("dask").config.set({"distributed.deploy.lost-worker-timeout": "1s"}),
        tiling_engine(ONE) as running,
    ):
        assert isinstance(running, Cluster)
        assert outcomes(running) == outcomes(Loop())
        tasks = [Task(f"die {n}", die_once, (str(tmp_path), n)) for n in range(1)]
        assert sorted(done.result for done in running.run(tasks)) == [0]
        running.client.retire_workers(list(running.client.scheduler_info(n_workers=-1)["workers"]))
        assert outcomes(running) == outcomes(Loop())


def faults(size):
    """Page faults of making an array of so many bytes ten times over, once it was made."""
    import resource

    def made():
        for _ in range(10):
            np.ones(size, np.uint8)
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

    made()
    return -made() + made()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's malloc")
def test_a_worker_keeps_its_memory_for_what_comes_next():
    pytest.importorskip("distributed")
    with tiling_engine(ONE) as running:
        (done,) = running.run([Task("faults", faults, (3 << 20,))])
    assert done.result < 10 * (3 << 20) / os.sysconf("SC_PAGE_SIZE") / 10  # all of them without
