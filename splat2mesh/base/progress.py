"""Named stages of a long computation: their seconds for the report, their progress for the terminal."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

Advance: TypeAlias = Callable[[int], Any]
"""Called with the number of steps done since the last call."""


class Stages:
    """Times the stages of one run and, when asked, shows them as progress bars on stderr.

    tell: called with lines of interest while the work goes on, where no bars are shown. seconds: dict of stage label ->
    wall-clock seconds, in the order in which the stages ran.
    """

    def __init__(self, show: bool = False, tell: Callable[[str], None] | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self._show, self._tell = show, tell
        self._bars: Any = None

    @contextmanager
    def stage(self, label: str, total: int | None = None) -> Iterator[Callable[..., Any]]:
        """Run one stage; yields `advance(count=1)`, to be called as its `total` steps are done."""
        start = time.perf_counter()
        task = self._started().add_task(label, total=total) if self._show else None
        try:
            yield lambda count=1: task is not None and self._bars.advance(task, count)
        finally:
            self.seconds[label] = self.seconds.get(label, 0.0) + time.perf_counter() - start
            if task is not None:
                self._bars.update(task, total=1, completed=1)

    def notify(self, line: str) -> None:
        """Show a line that stays."""
        if self._show:
            self._started().console.print(line, markup=False, highlight=False)
        elif self._tell is not None:
            self._tell(line)

    def close(self) -> None:
        """Restore the terminal; later stages, beside a window, show nothing."""
        self._show = False
        if self._bars is not None:
            self._bars.stop()
            self._bars = None

    def _started(self) -> Any:
        if self._bars is None:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

            columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
            self._bars = Progress(*columns, console=Console(stderr=True), transient=True)
            self._bars.start()
        return self._bars
