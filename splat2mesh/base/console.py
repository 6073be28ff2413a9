"""Common parts of both command lines: one-line errors, exit codes, warnings and results on the right streams."""

import os
import sys
import traceback
import unicodedata
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from .compiling import allow_read_only_install
from .errors import DataWarning, InputError, UnfinishedError, with_options
from .interrupts import stopping_in_order
from .strictjson import text_of

EXIT_DONE, EXIT_FAILED, EXIT_BAD_INPUT = 0, 1, 2
EXIT_INTERRUPTED = 130  # 128 and the number of SIGINT, as shells have it

ONE_BLAS_THREAD = {"OPENBLAS_NUM_THREADS": "1"}
"""Overrides the user's setting: sums of matrix products, and so the bytes of results, depend on the number of
threads."""


_JOINERS = "\u200c\u200d"
"""They show nothing and belong to words of Persian and Indian scripts, and to emoji."""

_owns_process = False  # whether this process runs a command, not a program that uses the library


@dataclass(frozen=True)
class Display:
    """The output of a command. json : one JSON object on stdout. quiet : neither progress nor summary. verbose : times
    of stages, tracebacks."""

    json: bool = False
    quiet: bool = False
    verbose: bool = False

    @property
    def progress(self) -> bool:
        """Whether progress bars belong on stderr: only on a terminal, and only without --quiet."""
        return sys.stderr.isatty() and not self.quiet

    @property
    def tell(self) -> Callable[[str], None] | None:
        """Prints a line while the work goes on; None with --quiet."""
        return None if self.quiet else notify


def run(
    command: Callable[[], tuple[list[str], Any]],
    display: Display | None = None,
    names: Mapping[str, str] | None = None,
) -> int:
    """Run a command and return the process's exit code. command: returns (summary lines, result that can be JSON). The
    result goes to stdout, everything else to stderr. names: setting -> option, as messages show them: `up` as --up."""
    global _owns_process
    _owns_process = True
    display, names = display or Display(), names or {}
    os.environ.update(ONE_BLAS_THREAD)
    with warnings.catch_warnings():
        shown: set[str] = set()

        def show(message: Any, *_: Any, **__: Any) -> None:
            text = f"warning: {with_options(str(message), names)}"
            if text not in shown:  # once is enough
                shown.add(text)
                print(printable(text), file=sys.stderr)

        warnings.showwarning = show
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", DataWarning)
        try:
            with stopping_in_order():
                allow_read_only_install()
                lines, result = command()
        except InputError as error:
            return _fail(with_options(str(error), names), EXIT_BAD_INPUT, display)
        except UnfinishedError as error:
            return _fail(with_options(str(error), names), EXIT_FAILED, display)
        except KeyboardInterrupt as error:
            return _fail(str(error) or "interrupted", EXIT_INTERRUPTED, display)
        except Exception as error:
            return _fail(_failed(error), EXIT_FAILED, display)
    try:
        if display.json:
            print(text_of(result))
        elif not display.quiet:
            print("\n".join(map(printable, lines)))
        sys.stdout.flush()
    except BrokenPipeError:  # the reader closed the pipe
        _drop_stdout()
    except OSError as error:  # the results are written, but could not be reported
        _drop_stdout()
        return _fail(f"cannot write to the standard output: {error.strerror}", EXIT_FAILED, display)
    return EXIT_DONE


def open_streams() -> None:
    """Open /dev/null for standard streams that the parent closed (`>&-`). Otherwise printing fails, and the next opened
    file takes the number of a stream, so prints of native libraries and child processes would go into it."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is not None:  # Python sets None for what was closed as it started
            continue
        null = os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
        if null <= number:
            os.set_inheritable(null, True)  # for child processes, as those of a shell
        setattr(sys, name, open(null, mode, encoding="utf-8"))


def _drop_stdout() -> None:
    """Redirect pending output to nowhere, or Python fails on it as it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def owns_process() -> bool:
    """Whether this process runs a command, not a program that uses the library."""
    return _owns_process


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Within a command, keep the output of native libraries off stderr; elsewhere stderr is the host's. They print to
    the file descriptor, which all threads of a process share: so only a process that is a command's."""
    if not _owns_process:
        yield
        return
    stderr, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(null)


@contextmanager
def recorded_warnings() -> Iterator[list[str]]:
    """Yield a list to which the text of every warning is added within the block, besides being shown."""
    messages: list[str] = []
    show = warnings.showwarning

    def record(message: Any, *details: Any, **more: Any) -> None:
        messages.append(str(message))
        show(message, *details, **more)

    warnings.showwarning = record
    try:
        yield messages
    finally:
        warnings.showwarning = show


def notify(message: str) -> None:
    """Print a line on stderr while the work goes on."""
    print(printable(message), file=sys.stderr, flush=True)


def printable(text: str) -> str:
    """One line of text, safe for a terminal: control and bidirectional characters are escaped.

    Names and comments of files are untrusted, and an escape sequence can retitle a window or hide a line. Bytes of a
    name that are no text, which no stream could encode, are escaped too.
    """
    whole = "".join(letter if _is_plain(letter) else letter.encode("unicode_escape").decode() for letter in text)
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    return whole.encode(encoding, "backslashreplace").decode(encoding)


def _is_plain(letter: str) -> bool:
    return letter.isprintable() or unicodedata.category(letter) == "Zs" or letter in _JOINERS


def _failed(error: Exception) -> str:
    """The message on failed work: for a full or broken disk, the file and the system's message."""
    more = "(run again with -v for the traceback)"
    if isinstance(error, OSError) and error.strerror:
        where = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, (str, bytes)) else ""
        return f"{where}{error.strerror} {more}"
    return f"{type(error).__name__}: {error} {more}" if str(error) else f"{type(error).__name__} {more}"


def peak_mb() -> float:
    """Largest resident size of this process so far, in MiB."""
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / 2**20 if sys.platform == "darwin" else peak / 2**10, 1)


def _fail(message: str, code: int, display: Display) -> int:
    if display.verbose:
        traceback.print_exc()
    print("error: " + printable(" ".join(message.split())), file=sys.stderr)
    return code
