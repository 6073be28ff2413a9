"""Compiling and importing without the cycle collector, which repeatedly scans the millions of objects that both make.

In alternating runs from an empty cache it took 9% of the seconds that `splat2mesh` compiled for (four pairs), 12% of
those of `relight` (three pairs): `scripts/bench compiling`, with and without --collector. Between two kernels it works
as usual, so cycles that hold arrays are freed as early as before.
"""

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any


@lru_cache(1)
def compile_without_collector() -> None:
    """Have Numba compile with the collector off, from now on. For a command: the collector belongs to the process."""
    from numba.core import event

    class Pause(event.Listener):
        """Off from the start of the first of the nested and neighbouring compilations to the end of the last."""

        def __init__(self) -> None:
            self.lock, self.running, self.was_on = threading.Lock(), 0, False

        def on_start(self, _event: Any) -> None:
            with self.lock:
                if self.running == 0:
                    self.was_on = gc.isenabled()
                    gc.disable()
                self.running += 1

        def on_end(self, _event: Any) -> None:
            with self.lock:
                self.running -= 1
                if self.running == 0 and self.was_on:
                    gc.enable()

    event.register("numba:compile", Pause())


@contextmanager
def import_without_collector() -> Iterator[None]:
    """Within it, import with the collector off; from then on it skips all objects made so far. For a command: modules
    stay to its end anyway. A fifth of the processor seconds of `relight`'s imports."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was_on:
            gc.enable()
