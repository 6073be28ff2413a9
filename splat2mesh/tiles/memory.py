"""The memory that a process on tiles needs, and how it allocates it. Only glibc allocates differently."""

import ctypes
import math
import os
from collections.abc import Callable

from ..base.errors import InputError
from ..base.inputs import MIB

BASE_GB = 0.5
"""Peak of a process on tiles before it has any: the memory of its libraries."""

MAPPED, KEPT, ARENAS = 32 * MIB, 256 * MIB, 1
"""How glibc allocates memory on a worker: blocks of less bytes than the first, the most it takes, come from the heap;
of the heap as many bytes as the second stay when they are free; and all threads share one heap.

A task runs in a thread, and the nanny of dask sets MALLOC_TRIM_THRESHOLD_ to 64 kB: so every array would be mapped and
its pages filled with zeros again. That took 17 of 59 processor seconds of a city of 100,000 splats, and takes 2 so, at
the same peak of memory."""

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8  # of mallopt in malloc.h of glibc


def check_memory(memory_gb: float, least_gb: float) -> None:
    """Raise InputError for a memory, GiB of a process, that is less than what must fit."""
    if memory_gb < least_gb:
        raise InputError(f"`memory` {memory_gb:g}: a process needs {math.ceil(10 * least_gb) / 10:g} GiB at least")


def give_back() -> None:
    """Return free memory within the heap to the system. Freed maps, of thousands, leave holes that no large array fits
    into."""
    _allocator("malloc_trim")(0)


def keep_memory() -> None:
    """Let this process keep freed memory for later arrays."""
    for name, value in ((_M_MMAP_THRESHOLD, MAPPED), (_M_TRIM_THRESHOLD, KEPT), (_M_ARENA_MAX, ARENAS)):
        _allocator("mallopt")(name, value)


def _allocator(name: str) -> Callable[..., object]:
    """A function of glibc; elsewhere one that does nothing."""
    return getattr(ctypes.CDLL(None), name, lambda *_: None) if os.name == "posix" else lambda *_: None
