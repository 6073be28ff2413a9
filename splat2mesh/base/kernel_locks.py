"""Two processes share a cache of kernels: one waits for a kernel that the other compiles, and reads it.

Each kernel is a byte of one file, locked while it is compiled and written; the system releases it when the process
ends, in whatever way. Numba alone would compile a kernel twice, and two signatures of one that are written at the
same time can take each other's place.
"""

import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

BYTES = 1 << 30
"""Places in the file, which stays empty. Two kernels of one place wait for each other needlessly."""


class KernelLocks:
    """Locks of one process, in a file that all name alike. Raises ImportError where the system has no such locks, and
    OSError where the file cannot be made."""

    def __init__(self, path: Path) -> None:
        import fcntl

        self._fcntl = fcntl
        self._file = open(path, "ab")  # for as long as the process
        self._held: Counter[int] = Counter()

    def take(self, name: str, wait: bool = True) -> bool:
        """Lock a kernel, reentrantly; False if another process holds it and this one does not wait."""
        place = zlib.crc32(name.encode()) % BYTES
        if not self._held[place]:
            try:
                self._fcntl.lockf(self._file, self._fcntl.LOCK_EX | (0 if wait else self._fcntl.LOCK_NB), 1, place)
            except OSError:  # taken; or, while it waits, a file system without locks: then each compiles by itself
                if not wait:
                    return False
        self._held[place] += 1
        return True

    def release(self, name: str) -> None:
        """Undo one `take`."""
        place = zlib.crc32(name.encode()) % BYTES
        self._held[place] -= 1
        if not self._held[place]:
            try:
                self._fcntl.lockf(self._file, self._fcntl.LOCK_UN, 1, place)
            except OSError:
                pass


def name_of(dispatcher: Any) -> str:
    """Module and name of a kernel."""
    return f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}"


def compile_in_turn(path: Path) -> KernelLocks:
    """Have this process, from now on, lock each kernel that Numba reads or compiles. Errors as of KernelLocks.

    A kernel holds its lock while it compiles those that it calls, and no kernel calls itself by way of another: so two
    processes never wait for each other.
    """
    from numba.core.caching import NullCache
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.dispatcher import Dispatcher

    locks, compile_alone = KernelLocks(path), Dispatcher.compile

    @contextmanager
    def held(name: str) -> Iterator[None]:
        locks.take(name)
        try:
            yield
        finally:
            locks.release(name)

    def compile_locked(dispatcher: Any, signature: Any) -> Any:
        if isinstance(dispatcher._cache, NullCache):
            return compile_alone(dispatcher, signature)
        with global_compiler_lock, held(name_of(dispatcher)):
            return compile_alone(dispatcher, signature)

    Dispatcher.compile = compile_locked  # type: ignore[method-assign,assignment]
    return locks
