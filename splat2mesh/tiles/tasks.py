"""Tasks over tiles: one after another in this process, or on workers of dask.distributed, with the same results.

A failed task is named, and so are the tasks that waited for it; all others are done.
"""

import os
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any, NamedTuple

from ..base.console import ONE_BLAS_THREAD, peak_mb
from ..base.errors import MOST_NAMED, InputError, UnfinishedError
from ..base.extras import needed
from ..base.progress import Stages
from ..base.version import VERSION
from ..options import TilingOptions
from .store import Store

DEATHS = 25
"""Workers that may die over one task, before the task is to blame."""

CONNECT_S = 10
"""Seconds in which a scheduler must answer, and after which workers are counted."""

DASHBOARD = "127.0.0.1:8787"
"""Where Dask's dashboard answers, which needs bokeh; another port where that one is taken. To this machine alone: it
asks nobody who they are."""


class Task(NamedTuple):
    """A piece of work. function and arguments can be pickled. after: names of tasks that must be done before."""

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    after: tuple[str, ...] = ()


class Done(NamedTuple):
    """The outcome of a task. result: of the function, or None. seconds, peak_mb: its cost. error: one line, or ""."""

    name: str
    result: Any
    seconds: float
    peak_mb: float
    error: str = ""


def costs(took: Iterable[Done]) -> dict[str, Any]:
    """Costs of tasks for a report: seconds, MiB of peak memory and bytes written, by name."""
    done = {each.name: each for each in took}
    results = {name: each.result for name, each in done.items() if isinstance(each.result, dict)}
    files = {name: result["files"].values() for name, result in results.items() if "files" in result}
    return {
        "task_seconds": {name: round(each.seconds, 3) for name, each in done.items()},
        "task_peak_mb": {name: each.peak_mb for name, each in done.items()},
        "task_bytes": {name: sum(about["bytes"] for about in each) for name, each in files.items()},
        "peak_mb": max((each.peak_mb for each in done.values()), default=0.0),
    }


def measured(name: str, function: Callable[..., Any], arguments: tuple[Any, ...], *_: Any) -> Done:
    """Run a task; the peak memory of its process is reset first, where the system can."""
    reset = _reset_peak()
    start = time.perf_counter()
    try:
        result, error = function(*arguments), ""
    except MemoryError as failure:
        result, error = None, f"out of memory ({failure})" if str(failure) else "out of memory"
    except InputError as failure:
        result, error = None, str(failure)
    except Exception as failure:
        if os.environ.get("SPLAT2MESH_TRACEBACK"):
            traceback.print_exc(file=sys.stderr)
        result, error = None, f"{type(failure).__name__}: {failure}"
    return Done(name, result, time.perf_counter() - start, _peak_mb(reset), " ".join(error.split()))


class Loop:
    """Runs tasks here, one after another."""

    def run(self, tasks: Sequence[Task]) -> Iterator[Done]:
        """Yield each outcome, in order; each task stands after those it waits for."""
        failed: set[str] = set()
        for task in tasks:
            lost = [name for name in task.after if name in failed]
            if lost:
                done = Done(task.name, None, 0.0, 0.0, f"waits for {lost[0]}, which failed")
            else:
                done = measured(task.name, task.function, task.arguments)
            if done.error:
                failed.add(task.name)
            yield done


class Cluster:
    """Runs tasks on the workers of a scheduler of dask.distributed."""

    def __init__(self, client: Any) -> None:
        self.client, self.runs = client, 0

    def run(self, tasks: Sequence[Task]) -> Iterator[Done]:
        """Yield each outcome as it arrives."""
        from dask import delayed
        from dask.distributed import as_completed

        work = delayed(guarded, pure=False, traverse=False)
        nodes: dict[str, Any] = {}
        for task in tasks:
            waits = [nodes[name] for name in task.after if name in nodes]
            # dask takes what stands before the first number for the kind of task: without, each is a kind of its own,
            # and the scheduler's time for a task grows with their number
            key = f"{task.name.replace(' ', '-')}-{id(self):x}-{self.runs}"
            nodes[task.name] = work(task.name, task.function, task.arguments, *waits, dask_key_name=key)
        self.runs += 1
        futures = self.client.compute(list(nodes.values()), optimize_graph=False)
        names = {future: name for future, name in zip(futures, nodes, strict=True)}
        for future, found in as_completed(futures, with_results=True, raise_errors=False):
            if future.status == "finished":
                yield found
            else:
                _, failure, _ = found
                yield Done(names[future], None, 0.0, 0.0, " ".join(f"{type(failure).__name__}: {failure}".split()))


def guarded(name: str, function: Callable[..., Any], arguments: tuple[Any, ...], *before: Done) -> Done:
    """On a worker: run a task unless one before it failed."""
    for done in before:
        if done.error:
            return Done(name, None, 0.0, 0.0, f"waits for {done.name}, which failed")
    return measured(name, function, arguments)


@contextmanager
def tiling_engine(tiling: TilingOptions, stages: Stages) -> Iterator[Any]:
    """The engine that runs the tasks of a city: a Loop, a Cluster of workers started here, or that of a scheduler.

    stages: prints the address of its dashboard, if any. Raises InputError for a scheduler that does not answer and for
    workers of another version of this package.
    """
    scheduler, workers, memory_gb = tiling.scheduler, tiling.workers, tiling.memory
    if scheduler is None and workers is None:
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
    if workers is not None:
        threads = str(max(1, (os.cpu_count() or 1) // workers))
        variables = {name: threads for name in _THREADS} | ONE_BLAS_THREAD
        settings |= {f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in variables.items()}
    with dask.config.set(settings):
        if scheduler is not None:
            try:
                client = Client(scheduler, timeout=CONNECT_S)
            except (OSError, ValueError, TimeoutError) as error:
                raise InputError(f"`scheduler` {scheduler}: does not answer ({_first_line(error)})") from None
            with client:
                yield _connect(client, scheduler)
            return
        assert workers is not None
        limit = f"{memory_gb}GiB" if memory_gb is not None else 0
        shown = find_spec("bokeh") is not None
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Port ", UserWarning)  # another run has it: any other port will do
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                memory_limit=limit,
                dashboard_address=DASHBOARD if shown else None,
                silence_logs=50,
            )
        with cluster, _keep_workers(cluster, workers), Client(cluster) as client:
            if shown:
                stages.notify(f"dashboard: {client.dashboard_link}")
            yield _connect(client, "the local cluster")


_THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS")
"""Variables that make the libraries of a worker share the cores with its neighbours."""


@contextmanager
def _keep_workers(cluster: Any, workers: int) -> Iterator[None]:
    """Start another worker where one is gone: its own nanny restarts it sooner, where it can."""
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(CONNECT_S):
            cluster.scale(workers)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        ended.set()
        watcher.join()


def _connect(client: Any, name: str) -> Cluster:
    versions = client.run(_version)
    if not versions:
        raise InputError(f"{name}: it has no workers; start some with `dask worker {name}`")
    for address, version in versions.items():
        if version != VERSION:
            raise InputError(f"the worker at {address} has version {version} of splat2mesh, this is {VERSION}")
    from .workers import Prepared

    client.register_plugin(Prepared())
    return Cluster(client)


def _version() -> str:
    """The version on a worker."""
    try:
        from splat2mesh.base.version import VERSION as here
    except ImportError:
        return "none"
    return here


def _reset_peak() -> bool:
    try:
        with open("/proc/self/clear_refs", "w") as file:
            file.write("5")
        return True
    except OSError:
        return False


def _peak_mb(since_reset: bool) -> float:
    if since_reset:
        with open("/proc/self/status") as file:
            for line in file:
                if line.startswith("VmHWM:"):
                    return round(int(line.split()[1]) / 1024, 1)
    return peak_mb()


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]


class TaskSteps:
    """Runs the tasks of one step after another. took: the outcome of every task so far, by its name."""

    def __init__(
        self,
        store: Store,
        engine: Any,  # of `tiling_engine`
        stages: Stages,
    ) -> None:
        self.store, self.engine, self.stages = store, engine, stages
        self.took: dict[str, Done] = {}

    def run(
        self, label: str, tasks: list[Task], arrived: Callable[[Done], None] = lambda done: None
    ) -> dict[str, Done]:
        """The outcome of all tasks, by name."""
        found = {}
        with self.stages.stage(label, total=len(tasks)) as advance:
            for done in self.engine.run(tasks):
                found[done.name] = done
                arrived(done)
                advance()
        self.took |= found
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

    def committed(self, records: list[str]) -> list[dict[str, Any] | None]:
        """Records whose files are all present and whole, None for others: checksums, which workers can share."""
        return self.need("check", [Task(f"check {name}", self.store.committed, (name,)) for name in records])
