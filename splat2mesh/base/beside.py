"""Work that a second thread does beside the first: reading and writing files, and what keeps a single core busy.

There is one such thread, so never more than two pieces of work hold their arrays at once. Loops of `threads` may be
used in either: both share the pool.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import lru_cache
from types import TracebackType
from typing import Generic, TypeVar

from .threads import all_cores

Made = TypeVar("Made")


class Beside(Generic[Made]):
    """What a function makes, begun now and asked for later; on a single core, and behind other work, made when asked.

    The function must not change what others use, and must import what a package of its own holds before. As a context,
    it is over when that ends.
    """

    def __init__(self, work: Callable[[], Made]) -> None:
        self._work = work
        self._future: Future[Made] = _second_thread().submit(work) if all_cores() > 1 else Future()

    def result(self) -> Made:
        """What it made; raises what it raised."""
        if self._future.cancel():  # not begun yet: who asks need not wait for other work
            self._future = Future()
            try:
                self._future.set_result(self._work())
            except BaseException as error:
                self._future.set_exception(error)
        return self._future.result()

    def __enter__(self) -> "Beside[Made]":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._future.cancel():
            wait([self._future])


@lru_cache(1)
def _second_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "beside")
