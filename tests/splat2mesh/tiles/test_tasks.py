"""Tasks on one process and on workers: order, failures, deaths."""

import os
import sys
from importlib.util import find_spec
from pathlib import Path
from socket import create_connection
from urllib.request import urlopen

import numpy as np
import pytest

from splat2mesh.base.progress import Stages
from splat2mesh.tiles.tasks import Cluster, Loop, Task, engine


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
    monkeypatch.setattr("splat2mesh.tiles.tasks.PATIENCE_S", 1.0)
    with engine(None, 1, None) as running:
        assert isinstance(running, Cluster) and running.workers == 1
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


def test_the_dashboard_answers_to_this_machine_alone(monkeypatch, capfd):
    pytest.importorskip("distributed")
    monkeypatch.setattr("splat2mesh.tiles.tasks.find_spec", lambda name: name == "bokeh")
    with engine(None, 1, None) as running:
        host, port = running.dashboard.split("/")[2].split(":")
        assert host == "127.0.0.1"
        with urlopen(running.dashboard) as page:
            assert page.status == 200
        with pytest.raises(OSError, match="refused"):
            create_connection(("127.0.0.2", int(port)), timeout=5)
        for show in (False, True):
            stages = Stages(show=show)
            stages.notify(f"dashboard: {running.dashboard}")
            stages.close()
            assert (running.dashboard in capfd.readouterr().err) == show


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's malloc")
def test_a_worker_keeps_its_memory_for_what_comes_next():
    pytest.importorskip("distributed")
    with engine(None, 1, None) as running:
        assert (running.dashboard is None) == (find_spec("bokeh") is None)
        (done,) = running.run([Task("faults", faults, (3 << 20,))])
    assert done.result < 10 * (3 << 20) / os.sysconf("SC_PAGE_SIZE") / 10  # all of them without
