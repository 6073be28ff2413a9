"""Tasks over tiles: one after another in this process, or on workers of dask.distributed, with the same results.

A failed task is named, and so are the tasks that waited for it; all others are done.
"""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

from ..base.console import ONE_BLAS_THREAD, peak_mb
from ..base.errors import MOST_NAMED, InputError, UnfinishedError
from ..base.extras import needed
from ..base.progress import Stages
from ..base.version import VERSION
from ..options import TilingOptions
from .memory import keep_memory
from .store import Store

DEATHS = 25
"""Workers that may die over one task, before the task is to blame."""

CONNECT_S = 10
"""Seconds in which a scheduler must answer, and after which workers are counted."""


class Task(NamedTuple):
    """A piece of work. function and arguments can be pickled. after: names of tasks that must be done before. record:
    of its files, by which a Store knows that it is done."""

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    after: tuple[str, ...] = ()
    record: str = ""


class Done(NamedTuple):
    """The outcome of a task. result: of the function, or None. seconds, peak_mb: its cost. error: one line, or ""."""

    name: str
    result: Any
    seconds: float
    peak_mb: float
    error: str = ""


def outcome(name: str, function: Callable[..., Any], arguments: tuple[Any, ...], *before: Done) -> Done:
    """Run a task, unless one before it failed; the peak memory of its process is reset first, where the system can."""
    for done in before:
        if done.error:
            return Done(name, None, 0.0, 0.0, f"waits for {done.name}, which failed")
    with suppress(OSError), open("/proc/self/clear_refs", "w") as file:
        file.write("5")
    start, result, error = time.perf_counter(), None, ""
    try:
        result = function(*arguments)
    except MemoryError as failure:
        error = f"out of memory ({failure})" if str(failure) else "out of memory"
    except InputError as failure:
        error = str(failure)
    except Exception as failure:
        error = f"{type(failure).__name__}: {failure}"
    seconds, peak = time.perf_counter() - start, peak_mb()
    with suppress(OSError), open("/proc/self/status") as file:
        peak = next(round(int(line.split()[1]) / 1024, 1) for line in file if line.startswith("VmHWM:"))
    return Done(name, result, seconds, peak, " ".join(error.split()))


class Loop:
    """Runs tasks here, one after another."""

    def run(self, tasks: Sequence[Task]) -> Iterator[Done]:
        """Yield each outcome, in order; each task stands after those it waits for."""
        done: dict[str, Done] = {}
        for task in tasks:
            done[task.name] = outcome(*task[:3], *(done[name] for name in task.after if name in done))
            yield done[task.name]


class Cluster:
    """Runs tasks on the workers of a scheduler of dask.distributed."""

    def __init__(self, client: Any) -> None:
        self.client, self.runs = client, 0

    def run(self, tasks: Sequence[Task]) -> Iterator[Done]:
        """Yield each outcome as it arrives."""
        from dask import delayed
        from dask.distributed import as_completed

        work = delayed(outcome, pure=False, traverse=False)
        nodes: dict[str, Any] = {}
        for task in tasks:
            waits = [nodes[name] for name in task.after if name in nodes]
            # dask takes what stands before the first number for the kind of task: without, each is a kind of its own,
            # and the scheduler's time for a task grows with their number
            key = f"{task.name.replace(' ', '-')}-{id(self):x}-{self.runs}"
            nodes[task.name] = work(*task[:3], *waits, dask_key_name=key)
        self.runs += 1
        futures = self.client.compute(list(nodes.values()), optimize_graph=False)
        names = {future: name for future, name in zip(futures, nodes, strict=True)}
        for future, found in as_completed(futures, with_results=True, raise_errors=False):
            if future.status == "finished":
                yield found
            else:
                _, failure, _ = found
                yield Done(names[future], None, 0.0, 0.0, " ".join(f"{type(failure).__name__}: {failure}".split()))


@contextmanager
def tiling_engine(tiling: TilingOptions) -> Iterator[Any]:
    """The engine that runs the tasks of a city: a Loop, a Cluster of workers started here, or that of a scheduler.
    Raises InputError for a scheduler that does not answer and for workers of another version of this package."""
    scheduler, workers = tiling.scheduler, tiling.workers or 1
    if scheduler is None and tiling.workers is None:
        yield Loop()
        return
    needed("distributed", "`scheduler`: a scheduler" if scheduler else "`workers`: more than one process")
    import dask
    from dask.distributed import Client, LocalCluster

    settings: dict[str, Any] = {
        "distributed.scheduler.allowed-failures": DEATHS,
        "distributed.logging.distributed": "critical",
        "distributed.worker.profile.enabled": False,  # a thread that polls the task all the time
        # tasks take seconds: polling each process fifty times a second took 6% of a core
        "distributed.admin.tick.interval": "1s",
        "distributed.admin.system-monitor.interval": "5s",
        "distributed.worker.memory.monitor-interval": "500ms",
        # on a busy machine a worker may be silent for minutes and well; one that has died here is known to have
        "distributed.scheduler.worker-ttl": None,
        "distributed.comm.timeouts.connect": "120s",
    }
    cores = str(max(1, (os.cpu_count() or 1) // workers))  # which neighbours share
    variables = {"NUMBA_NUM_THREADS": cores, "OMP_NUM_THREADS": cores, **ONE_BLAS_THREAD}
    settings |= {f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in variables.items()}
    with dask.config.set(settings):
        if scheduler is not None:
            try:
                client = Client(scheduler, timeout=CONNECT_S)
            except (OSError, ValueError, TimeoutError) as error:
                said = (str(error) or type(error).__name__).splitlines()[0]
                raise InputError(f"`scheduler` {scheduler}: does not answer ({said})") from None
            with client:
                yield _connect(client, scheduler)
            return
        limit = 0 if tiling.memory is None else f"{tiling.memory}GiB"
        each: dict[str, Any] = {"threads_per_worker": 1, "processes": True, "memory_limit": limit}
        with (
            LocalCluster(n_workers=workers, dashboard_address=None, silence_logs=50, **each) as cluster,
            Client(cluster) as client,
        ):
            cluster.adapt(minimum=workers, maximum=workers, interval=f"{CONNECT_S}s")  # replaces those that are gone
            yield _connect(client, "the local cluster")


def _connect(client: Any, name: str) -> Cluster:
    """The Cluster of a client, whose workers are prepared, those to come too."""
    versions = client.run(_version)
    if not versions:
        raise InputError(f"{name}: it has no workers; start some with `dask worker {name}`")
    for address, version in versions.items():
        if version != VERSION:
            raise InputError(f"the worker at {address} has version {version} of splat2mesh, this is {VERSION}")
    client.register_worker_callbacks(_prepared)
    return Cluster(client)


def _version() -> str:
    """The version on a worker."""
    return VERSION


def _prepared() -> None:
    """On a worker: one thread of BLAS, as in a command, where NumPy has not loaded; freed memory stays."""
    os.environ.update(ONE_BLAS_THREAD)
    keep_memory()


class TaskSteps:
    """Runs the tasks of one step after another. took: the outcome of every task so far, its result the bytes that it
    wrote, if any."""

    def __init__(
        self,
        store: Store,
        engine: Any,  # of `tiling_engine`
        stages: Stages,
    ) -> None:
        self.store, self.engine, self.stages = store, engine, stages
        self.took: list[Done] = []

    def run(
        self, label: str, tasks: list[Task], arrived: Callable[[Done], None] = lambda done: None
    ) -> dict[str, Done]:
        """The outcome of all tasks, by name."""
        found = {}
        with self.stages.stage(label, total=len(tasks)) as advance:
            for done in self.engine.run(tasks):
                found[done.name] = done
                files = done.result.get("files") if isinstance(done.result, dict) else None
                written = None if files is None else sum(about["bytes"] for about in files.values())
                self.took.append(done._replace(result=written))
                arrived(done)
                advance()
        return found

    def need(
        self, label: str, tasks: list[Task], arrived: Callable[[Done], None] = lambda done: None, part: str = ""
    ) -> list[Any]:
        """Results of tasks that must all succeed. part: the tasks to count are those whose names begin so. Raises
        UnfinishedError, which names those that failed, once the others are done."""
        found = self.run(label, tasks, arrived)
        lost = [done for done in found.values() if done.error]
        if lost:
            counts = (sum(each.name.startswith(part) for each in some) for some in (lost, tasks))
            text = "{} of {} tiles".format(*counts) if part else f"{label}: {len(lost)} of {len(tasks)} parts"
            # Tasks that only waited for others are left out.
            failed = [f"{done.name}: {done.error}" for done in lost if not done.error.startswith("waits")]
            raise UnfinishedError(f"{text} are not done ({'; '.join(failed[:MOST_NAMED])}); run again with `resume`")
        return [found[task.name].result for task in tasks]

    def left(self, tasks: list[Task]) -> list[Task]:
        """Those that are not done: their records, or files in them, are missing or damaged. Workers share the sums."""
        checks = [Task(f"check {task.record}", self.store.committed, (task.record,)) for task in tasks]
        return [task for task, found in zip(tasks, self.need("check", checks), strict=True) if found is None]

    def costs(self) -> dict[str, Any]:
        """Costs for a report: seconds of steps; seconds, MiB of peak memory and bytes written of tasks, by name."""
        return {
            "seconds": dict(self.stages.seconds),
            "task_seconds": {each.name: round(each.seconds, 3) for each in self.took},
            "task_peak_mb": {each.name: each.peak_mb for each in self.took},
            "task_bytes": {each.name: each.result for each in self.took if each.result is not None},
            "peak_mb": max((each.peak_mb for each in self.took), default=0.0),
        }
