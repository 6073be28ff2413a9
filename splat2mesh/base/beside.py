"""Work in a second thread: reading and writing files, and computations that keep a single core busy.

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
    """The result of a function, begun now and fetched later; on a single core, or behind other work, computed when
    fetched.

    The function must not change shared data, and its imports must be done before. As a context, it ends with the block.
    """

    def __init__(self, work: Callable[[], Made]) -> None:
        self._work = work
        self._future: Future[Made] = _second_thread().submit(work) if all_cores() > 1 else Future()

    def result(self) -> Made:
        """The function's result; raises the function's exception."""
        if self._future.cancel():  # not begun yet: the caller need not wait for other work
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
