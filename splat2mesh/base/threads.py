"""Compiled loops on all cores, by threads of Python's own: with Numba's, each takes a second more to compile."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, wraps
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray


def cores() -> int:
    """How many threads share a loop: all cores that this process may use, or NUMBA_NUM_THREADS."""
    from numba import config

    return config.NUMBA_NUM_THREADS


def shared(kernel: Callable) -> Callable:
    """Make loop(count, *arrays) of a compiled kernel(begin, end, *arrays) that releases the GIL.

    The kernel runs over the items 0..count, in order, a part of them in each thread; so what it makes of one item must
    not depend on the others, and the bits do not on the number of threads.
    """

    @wraps(kernel)
    def loop(count: int, *arrays: Any) -> None:
        parts = max(min(cores(), count), 1)
        first, *others = pairwise(count * part // parts for part in range(parts + 1))
        pending = [_pool().submit(kernel, *span, *arrays) for span in others]
        kernel(*first, *arrays)
        for done in pending:
            done.result()

    return loop


def read_only(array: ArrayLike, dtype: DTypeLike = np.float32) -> NDArray:
    """The array as one type, for which a kernel is compiled once; copies only other dtypes and strides."""
    array = np.ascontiguousarray(array, dtype).view()
    array.flags.writeable = False
    return array


@lru_cache(1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(os.cpu_count() or 1, cores()), "splat2mesh")
