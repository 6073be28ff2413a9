"""Signals to stop: Ctrl-C, SIGTERM and a closed terminal end a command in order, and clean-up is not cut short."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

AGAIN_SECONDS = 1.0
"""Seconds within which a second signal counts as the same request, and clean-up goes on."""


class Interrupted(KeyboardInterrupt):
    """A command was interrupted; the message names the signal."""


_shields = 0  # blocks under way that must not be cut short
_waiting: list[int] = []  # signals that came meanwhile
_last = float("-inf")


@contextmanager
def stopping_in_order() -> Iterator[None]:
    """Within it, SIGINT, SIGTERM and SIGHUP raise Interrupted in the main thread. For a process that is a command's. A
    signal that the process was started to ignore, as under nohup, stays ignored. In another thread nothing changes."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before: dict[int, Any] = {}
    for number in SIGNALS:
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            before[number] = signal.signal(number, _stop)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def shielded() -> Iterator[None]:
    """Within it, signals wait; one that arrived is raised when it ends. Keep it short: clean-up, a rename. Where the
    library is used without a command, Ctrl-C is deferred in the main thread only."""
    global _shields
    main = threading.current_thread() is threading.main_thread()
    foreign = None
    if main and _shields == 0 and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        foreign = signal.signal(signal.SIGINT, _stop)
    _shields += main
    try:
        yield
    finally:
        _shields -= main
        if foreign is not None:
            signal.signal(signal.SIGINT, foreign)
        if main and _shields == 0 and _waiting:
            number = _waiting[0]
            _waiting.clear()
            raise _interrupted(number)


def _stop(number: int, frame: FrameType | None) -> None:
    global _last
    if _shields:
        _waiting.append(number)
        return
    now = time.monotonic()
    recent, _last = now - _last < AGAIN_SECONDS, now
    if not recent:
        raise _interrupted(number)


def _interrupted(number: int) -> Interrupted:
    return Interrupted("interrupted" if number == signal.SIGINT else f"stopped by {signal.Signals(number).name}")
