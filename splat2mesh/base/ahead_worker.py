"""The process of `ahead`: compiles the kernels of lists, until its input is closed."""

import importlib
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

from .ahead import Listed, listed
from .collecting import compile_without_collector, import_without_collector
from .kernel_locks import KernelLocks, compile_in_turn, name_of


def main() -> None:
    """Compile. Arguments: sys.path as JSON, the file of the locks, then the lists in the order of need."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    _, _, locks, *lists = sys.argv
    writing = threading.Lock()
    threading.Thread(target=_end_with_input, args=(writing,), daemon=True).start()
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
    wanted = [kernel for path in lists for kernel in listed(Path(path))]
    compile_ahead(in_order(wanted), compile_in_turn(Path(locks)))


def in_order(kernels: list[Listed]) -> list[Listed]:
    """Kernels as they are compiled ahead: first what most runs ask for, and of that the last."""
    return sorted(kernels[::-1], key=lambda kernel: -kernel.runs)


def compile_ahead(kernels: list[Listed], locks: KernelLocks) -> None:
    """Compile kernels in their order into Numba's cache, but those that are there, and that another process compiles.

    A kernel that does not compile, as no list should name, is left out.
    """
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
    """Compile a kernel for the types of a list, unless it is there or another process is at it."""
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


def _end_with_input(writing: threading.Lock) -> None:
    """End the process as soon as nobody holds the other end of its input, but not amid a file of the cache."""
    sys.stdin.buffer.read()
    with writing:
        os._exit(0)
