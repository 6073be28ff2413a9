"""Loops on all cores, by one pool of Python threads, for code that releases the GIL: compiled kernels, networks.

Threads stay: starting them takes as long as a thousand vertices. Numba's threads cost each loop a second of compiling.
Work in a thread of the pool starts no other: a thread that waited for another could wait for ever.
"""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial, wraps
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

ROWS_AT_ONCE = 2**16
"""Rows of arrays that are worked on at once: enough to hide a call of NumPy, and little memory."""

_here = threading.local()


def all_cores() -> int:
    """The number of cores that this process may use, or NUMBA_NUM_THREADS."""
    from numba import config

    return config.NUMBA_NUM_THREADS


def cores() -> int:
    """The number of threads that may run at once: 1 in a thread of the pool."""
    return 1 if _pooled() else all_cores()


def shared(kernel: Callable) -> Callable:
    """Make loop(count, *arrays) of a compiled kernel(begin, end, *arrays) that releases the GIL.

    The kernel runs over the items 0..count, in order, a part of them in each thread; so the result of an item must not
    depend on the others, and the bits do not depend on the number of threads.
    """
    return wraps(kernel)(partial(in_slices, kernel))


def in_slices(kernel: Callable, count: int, *arrays: Any) -> None:
    """Run a kernel over the vertices 0..count, a slice for each core."""
    over(kernel, _spans(count), *arrays)


def over(kernel: Callable, spans: Iterable[tuple[int, int]], *arrays: Any) -> None:
    """Run a kernel over each of some (begin, end) at once; the first by the thread that asks."""
    first, *others = spans
    if _pooled():
        for span in (first, *others):
            kernel(*span, *arrays)
        return
    pending = [_pool().submit(kernel, *span, *arrays) for span in others]
    kernel(*first, *arrays)
    for done in pending:
        done.result()


def in_order(function: Callable, *columns: Iterable, workers: int | None = None) -> Iterator:
    """Yield a function's result for each row of some columns, in order; on so many threads, or all cores."""
    if (cores() if workers is None else workers) == 1:
        return map(function, *columns)
    return _pool().map(function, *columns)


def in_batches(function: Callable[[slice], Any], count: int, size: int = 1 << 14) -> None:
    """Call a function for slice after slice of `size` rows, on all cores; it writes what it finds."""
    deque(in_order(function, [slice(start, start + size) for start in range(0, count, size)]), maxlen=0)


def read_only(array: ArrayLike, dtype: DTypeLike = np.float32) -> NDArray:
    """The array as one type, for which a kernel is compiled once; copies only other dtypes and strides."""
    array = np.ascontiguousarray(array, dtype).view()
    array.flags.writeable = False
    return array


def _spans(count: int) -> Iterator[tuple[int, int]]:
    parts = max(min(cores(), count), 1)
    return pairwise(count * part // parts for part in range(parts + 1))


def _pooled() -> bool:
    return bool(getattr(_here, "pooled", False))


@lru_cache(1)
def _pool() -> ThreadPoolExecutor:
    size = max(os.cpu_count() or 1, all_cores())
    return ThreadPoolExecutor(size, "splat2mesh", lambda: setattr(_here, "pooled", True))
