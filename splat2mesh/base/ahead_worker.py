"""The process of `ahead`: compiles the kernels of lists, until its input is closed."""

import importlib
import os
import queue
import signal
import sys
import threading
from pathlib import Path
from typing import Any

from .ahead import EVERY, Listed, listed
from .collecting import compile_without_collector, import_without_collector
from .kernel_locks import KernelLocks, compile_in_turn, name_of


def main() -> None:
    """Compile. Arguments: sys.path as JSON, the file of the locks, then the lists in the order of need."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    _, _, locks, *lists = sys.argv
    writing, expected = threading.Lock(), queue.SimpleQueue[str]()
    threading.Thread(target=_read_input, args=(expected, writing), daemon=True).start()
    with import_without_collector():
        from .kernels import without_blas, without_c_functions

        without_blas()
        without_c_functions()
        from numba.core.caching import Cache

    save = Cache.save_overload

    def save_whole(cache: Any, signature: Any, data: Any) -> None:
        with writing:
            save(cache, signature, data)

    Cache.save_overload = save_whole
    compile_without_collector()
    backwards = [kernel for path in lists for kernel in listed(Path(path))][::-1]
    held = compile_in_turn(Path(locks))
    compile_ahead([kernel for kernel in backwards if kernel.asked_by == EVERY], held)
    more = expected.get()
    compile_ahead([kernel for kernel in backwards if kernel.asked_by == more], held)


def compile_ahead(kernels: list[Listed], locks: KernelLocks) -> None:
    """Compile kernels in order into Numba's cache, except those that exist or that another process compiles. A kernel
    that does not compile is skipped; no list should name one."""
    for kernel in kernels:
        try:
            compile_one(dispatcher_of(kernel.module, kernel.name), kernel, locks)
        except Exception:
            continue


def dispatcher_of(module: str, name: str) -> Any:
    """The kernel of a name, without the loops around it. Raises ImportError, AttributeError."""
    from numba.core.dispatcher import Dispatcher

    found = getattr(importlib.import_module(module), name)
    while not isinstance(found, Dispatcher):
        found = found.__wrapped__
    return found


def compile_one(dispatcher: Any, kernel: Listed, locks: KernelLocks) -> None:
    """Compile a kernel for the types of a list, unless it exists or another process compiles it."""
    from .kernel_types import type_of

    signature, name = tuple(map(type_of, kernel.arguments)), name_of(dispatcher)
    if not locks.take(name, wait=False):
        return
    try:
        cache = dispatcher._cache
        key = cache._index_key(signature, dispatcher.targetctx.codegen())
        if key not in cache._cache_file._load_index():
            dispatcher.compile(signature)
    finally:
        locks.release(name)


def _read_input(expected: "queue.SimpleQueue[str]", writing: threading.Lock) -> None:
    """Pass on the expected kernels. End the process once its input is closed, but not amid a file of the cache."""
    for line in sys.stdin:
        expected.put(line.strip())
    with writing:
        os._exit(0)
