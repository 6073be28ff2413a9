"""Heavy work in a separate process, so neither the interpreter's lock nor a busy core stops the window.

The process (`worker_command`) reads pickled messages from stdin, of which the newest wish counts, and writes to stdout.
A thread would not do: tracing holds the interpreter's lock for up to half a second. The process has a lower priority,
so drawing comes first on a busy machine.
"""

import os
import pickle
import queue
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from numpy.typing import NDArray

from splat2mesh.base.compiling import allow_read_only_install
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.progress import Stages

from .lighting import FinishedShading, LightWish, SessionLight, SessionLighting, SessionScene, keys

NICENESS = 5
"""Added to the priority of the process: drawing comes first, but idle cores are used in full."""

REST_SECONDS = 0.2
"""Seconds without motion before a request for a new angle or smooth edges, long enough for the user to have stopped,
and between two reports of progress."""


class Superseded(Exception):
    """A newer wish has made the step in progress pointless."""


def in_words(error: BaseException) -> str:
    """An error as one line for the window."""
    return str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"


class ReportedStages(Stages):
    """The stages of an answer, each advance of which is reported and may end the answer.

    report(label, fraction): called now and then, fraction in 0..1 or None where the length is unknown.
    check(): called at every advance; may raise `Superseded`.
    """

    def __init__(self, report: Callable[..., None], check: Callable[[], None]) -> None:
        super().__init__()
        self._report, self._check, self._last = report, check, 0.0

    @contextmanager
    def stage(self, label: str, total: int | None = None) -> Iterator[Callable[..., None]]:
        """Run one stage; yields `advance(count=1)`, as `Stages.stage` does."""
        done = 0
        self._report(label, 0.0 if total else None)

        def advance(count: int = 1) -> None:
            nonlocal done
            done += count
            self._check()
            if total and time.perf_counter() - self._last > REST_SECONDS:
                self._last = time.perf_counter()
                self._report(label, min(done / total, 1.0))

        with super().stage(label, total):
            yield advance


def worker_command() -> list[str]:
    """The command that starts the process: this interpreter, with the same module path.

    `python -m` and `python -c` search the current folder first, and would run a queue.py there. Isolated mode does not;
    the current folder comes last, and only if its absolute path was given or it holds this package.
    """
    package = str(Path(__file__).resolve().parents[2])
    here = os.getcwd()
    paths = [path for path in dict.fromkeys([*sys.path, package]) if os.path.isabs(path)]
    paths.sort(key=lambda path: os.path.realpath(path) == os.path.realpath(here))
    start = "import sys; sys.path[:] = sys.argv[1:]; from relight.viewer.worker import main; main()"
    return [sys.executable, "-I", "-c", start, *paths]


class ProcessWorker:
    """The worker process of one session."""

    def __init__(self, asked: SessionScene) -> None:
        # The window handles Ctrl-C in the terminal: it ends this process.
        self._process = subprocess.Popen(
            worker_command(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        self._answers: queue.SimpleQueue[tuple] = queue.SimpleQueue()
        assert self._process.stdin is not None and self._process.stdout is not None  # both are pipes
        threading.Thread(target=self._read, args=(self._process.stdout,), daemon=True).start()
        self._pen, self._paper = ThreadPoolExecutor(1), self._process.stdin
        self._pen.submit(self._write, asked)

    def submit(self, wish: LightWish) -> None:
        """Request the newest wish; unfinished work of an older one is dropped."""
        self._pen.submit(self._write, wish)

    def poll(self) -> list[tuple]:
        """Messages since the last call, without waiting: a list of tuples.

        ("progress", label, fraction or None), ("result", kind, key, payload), ("done", wish), ("failed", wish, text),
        ("ended", text): the process is gone, and no more will come.
        """
        messages = []
        while not self._answers.empty():
            messages.append(self._answers.get())
        return messages

    def close(self) -> None:
        """End the process, whatever it is doing."""
        self._process.kill()
        self._process.wait()

    def _read(self, stream: IO[bytes]) -> None:
        try:
            while True:
                self._answers.put(pickle.load(stream))
        except (EOFError, OSError, pickle.UnpicklingError, ValueError):
            self._answers.put(("ended", f"the worker process ended (code {self._process.poll()})"))

    def _write(self, message: Any) -> None:
        with suppress(OSError, ValueError):  # the process is gone: the reader says so
            pickle.dump(message, self._paper, pickle.HIGHEST_PROTOCOL)
            self._paper.flush()


class Answers:
    """The wishes of a session and what its worker answered.

    wish: what the present state needs from the worker. available: the effects that there are. progress: (label,
    fraction or None) of the work under way, or None. message: the text to show, or "".
    """

    def __init__(self, worker: ProcessWorker, wish: LightWish, available: frozenset[str]) -> None:
        self._worker, self.wish, self.available, self.message = worker, wish, available, ""
        self.progress: tuple[str, float | None] | None = None
        self._found: dict[str, tuple[Any, Any]] = {}  # newest results by kind
        self._asked: LightWish | None = None
        self._answered: tuple[LightWish, str] | None = None
        self._ended = ""

    @property
    def complete(self) -> bool:
        """Whether the worker has answered the wish, without failure."""
        return self._answered == (self.wish, "")

    @property
    def failure(self) -> str:
        """Why the worker cannot answer, or ""."""
        answered = self._answered
        return answered[1] if answered is not None and answered[0] == self._asked else self._ended

    @property
    def light(self) -> SessionLight | None:
        """The SessionLight loaded last, or None. It may be that of the state before."""
        found: SessionLight | None = self.newest("light")[1]
        return found

    @property
    def light_name(self) -> str | None:
        """Name of the environment that is shown, or None before the first."""
        return self.newest("light")[0]

    @property
    def lit(self) -> FinishedShading | None:
        """The FinishedShading of the wish, or None until it arrives."""
        return self.current("shading")

    @property
    def error(self) -> float | None:
        """Relative L2 error of what is shown, on sampled vertices, or None while it is unknown."""
        return self.current("error")

    @property
    def called_for(self) -> frozenset[str]:
        """The effects that the plan calls for at this tolerance; all while it is unknown."""
        key, lit = self.newest("shading")
        return lit.effects if lit is not None and key[:4] == keys(self.wish)["shading"][:4] else self.available

    def ask(self) -> None:
        """Ask the worker for what is wished, once."""
        if self.wish != self._asked:
            # An older answer to the same wish does not apply to the new one.
            self._asked, self._answered = self.wish, None
            self._worker.submit(self.wish)

    def poll(self) -> bool:
        """Collect what the worker says, without waiting; return whether there are results."""
        messages = self._worker.poll()
        for message in messages:
            self._take(message)
        return any(kind != "progress" for kind, *_ in messages)

    def close(self) -> None:
        """End the worker."""
        self._worker.close()

    def _take(self, message: tuple) -> None:
        match message:
            case "progress", label, fraction:
                self.progress = label, fraction
            case "result", kind, key, payload:
                self._found[kind] = key, payload
                self._answered = None  # messages after an answer belong to another wish
                if kind == "light" and payload.warning:
                    self.message = payload.warning
            case "done", wish:
                self._answered, self.progress = (wish, ""), None
            case "failed", wish, text:
                self._answered = wish, text
                if wish == self._asked:
                    self.message, self.progress = text, None
            case "ended", text:
                self.message, self.progress = text + ": only spherical harmonics from here on", None
                self._ended = text

    def current(self, kind: str) -> Any:
        """The payload of a kind if it belongs to the wish, else None."""
        key, payload = self.newest(kind)
        return payload if key is not None and key == keys(self.wish)[kind] else None

    def newest(self, kind: str) -> tuple[Any, Any]:
        """(key, payload) of the newest of a kind; None for both before the first."""
        return self._found.get(kind, (None, None))

    @property
    def bounced(self) -> NDArray | None:
        """Bounced light per coefficient for the present albedo, (3, V, K'), or None; of a coarser level if need be."""
        key, payload = self.newest("bounced")
        return payload if key is not None and key[1:] == keys(self.wish)["bounced"][1:] else None


def answers(lighting: SessionLighting, wish: LightWish) -> Iterator[tuple]:
    """Yield the messages that answer one wish."""
    try:
        for answer in lighting.answers(wish):
            yield ("result", *answer)
    except Superseded:
        return
    except Exception as error:  # the window stays open and shows the error
        yield "failed", wish, in_words(error)
    else:
        yield "done", wish


def main() -> None:
    """Answer the wishes of the parent process until it goes away."""
    messages_in, messages_out = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # prints of libraries must not land between the messages
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)  # the command has reported it
        allow_read_only_install()
    asked: SessionScene = pickle.load(messages_in)
    newest: list[Any] = [None]  # LightWish
    arrived = threading.Event()

    def listen() -> None:
        try:
            while True:
                newest[0] = pickle.load(messages_in)
                arrived.set()
        except (EOFError, OSError):
            os._exit(0)  # the window is gone; nothing waits for the result

    def send(*message: Any) -> None:
        pickle.dump(message, messages_out, pickle.HIGHEST_PROTOCOL)
        messages_out.flush()

    def check() -> None:
        if arrived.is_set() and lighting.step is not None:
            kind, key = lighting.step
            if keys(newest[0])[kind] != key:
                raise Superseded

    steps = ReportedStages(lambda *progress: send("progress", *progress), check)
    lighting = SessionLighting(asked, steps)
    threading.Thread(target=listen, daemon=True).start()
    while True:
        arrived.wait()
        arrived.clear()
        wish = newest[0]
        for message in answers(lighting, wish):
            send(*message)
            if arrived.is_set():
                break
