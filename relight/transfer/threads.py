"""One pool of threads for whatever releases the GIL: compiled kernels and networks.

To start threads takes as long as a thousand vertices; so they stay. What runs in a thread of the pool does all its own
work by itself: a thread that waited for another could wait for ever.
"""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

MIN_SHARED = 2048
"""Vertices from which on it is worth to share them between cores."""

_here = threading.local()


def cores() -> int:
    """How many threads may run at once: 1 in a thread of the pool."""
    return 1 if getattr(_here, "pooled", False) else os.cpu_count() or 1


def in_slices(kernel: Callable, count: int, *arrays: Any) -> None:
    """Run a kernel over the vertices 0..count, a slice for each core."""
    if count < MIN_SHARED or cores() == 1:
        kernel(0, count, *arrays)
    else:
        over(kernel, pairwise(np.linspace(0, count, cores() + 1).astype(int)), *arrays)


def over(kernel: Callable, spans: Iterable[tuple[int, int]], *arrays: Any) -> None:
    """Run a kernel over each of some (begin, end) at once; the first by the thread that asks."""
    first, *others = spans
    if getattr(_here, "pooled", False):
        for span in (first, *others):
            kernel(*span, *arrays)
        return
    pending = [_pool().submit(kernel, *span, *arrays) for span in others]
    kernel(*first, *arrays)
    for done in pending:
        done.result()


def in_order(function: Callable, *columns: Iterable, workers: int | None = None) -> Iterator:
    """Yield what a function makes of each row of some columns, in their order; on so many threads, or all cores."""
    if (cores() if workers is None else workers) == 1:
        return map(function, *columns)
    return _pool().map(function, *columns)


def in_batches(function: Callable[[slice], Any], count: int, size: int) -> None:
    """Call a function for slice after slice of `size` rows, on all cores; it writes what it finds."""
    deque(in_order(function, [slice(start, start + size) for start in range(0, count, size)]), maxlen=0)


@lru_cache(1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count(), "relight", lambda: setattr(_here, "pooled", True))
