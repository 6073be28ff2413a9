"""Kernels compiled ahead of their need: on the first run, a second process takes those that the command needs last.

The command compiles from the first on, the process from the last, both into Numba's cache, until they meet. Lists in
the packages name the kernels with their types; `scripts/kernel_lists.py` writes them. The command compiles unlisted
kernels on first use; kernels listed in vain cost the idle core a moment. Results equal those of a second run, which
reads the same machine code.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .compiling import KERNELS, PACKAGES, cache_folder, cache_kind

LIST = "kernels.json"
"""In a package: the kernels of its command."""

EVERY, OBJECT, PLACE, SOME = "every", "object", "place", "some"

SWITCH = "SPLAT2MESH_AHEAD"
"""Environment variable: 0 switches the second process off."""

WORTH_SECONDS = 3.0
"""Seconds of missing kernels from which a second process pays off: starting it takes one."""

LOCKS = "kernels.lock"

END_SECONDS = 1.0
"""Seconds that the process has to end by itself before it is killed, so it completes a file."""

_START = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from splat2mesh.base import ahead_worker as worker; "
_START += "worker.main()"


@dataclass(frozen=True)
class Listed:
    """A kernel of a list: its module and name, the text of its arguments' types, the seconds that it compiles, and what
    needs it: EVERY scene, an OBJECT, a PLACE, or SOME scenes, for which it is not compiled ahead."""

    module: str
    name: str
    arguments: list[Any]
    seconds: float
    asked_by: str


def listed(path: Path) -> list[Listed]:
    """The kernels of a list, in the order of need. Raises OSError, ValueError and the like for a damaged file."""
    content = json.loads(path.read_text(encoding="utf-8"))
    kinds = content["types"]
    return [
        Listed(module, name, [kinds[place] for place in places], seconds, asked_by)
        for module, name, places, seconds, asked_by in content["kernels"]
    ]


@contextmanager
def compiled_ahead(*lists: Path) -> Iterator[None]:
    """Within the block, a second process compiles the listed kernels that every scene needs, if many are missing, then
    those of `expect`. For a command.

    lists: in the order of need. Does nothing, silently, on a single core, without a writable cache, or without file
    locks.
    """
    global _process
    _process = _begun(lists)
    try:
        yield
    finally:
        process, _process = _process, None
        if process is not None:
            _ended(process)


_process: "subprocess.Popen[bytes] | None" = None


def expect(asked_by: str = "") -> None:
    """Tell the second process, if any, which kernels come next, once: those of an OBJECT, of a PLACE, or none."""
    process = _process
    if process is not None and process.stdin is not None:
        try:
            process.stdin.write(f"{asked_by}\n".encode())
            process.stdin.flush()
        except OSError:  # it has ended
            pass


def _begun(lists: Sequence[Path]) -> "subprocess.Popen[bytes] | None":
    try:
        if not lists or _cores() < 2 or os.environ.get(SWITCH) == "0" or getattr(sys, "frozen", False):
            return None
        kind = cache_kind()
        if kind is None or missing_seconds(lists, kind) < WORTH_SECONDS:
            return None
        place = cache_folder(KERNELS, kind)
        arguments = [json.dumps(sys.path), str(place / LOCKS), *map(str, lists)]
        process = subprocess.Popen(
            [sys.executable, "-I", *(["-B"] if sys.dont_write_bytecode else []), "-c", _START, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the command, which then ends it
        )
    except Exception:  # it only saves time
        return None
    try:
        from .kernel_locks import compile_in_turn

        compile_in_turn(place / LOCKS)
    except BaseException as error:
        _ended(process)
        if not isinstance(error, Exception):
            raise
        return None
    return process


def _ended(process: "subprocess.Popen[bytes]") -> None:
    """End the process: it does so when its input is closed."""
    try:
        if process.stdin is not None:
            process.stdin.close()
        process.wait(END_SECONDS)
    except (OSError, subprocess.TimeoutExpired):
        pass
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def missing_seconds(lists: Sequence[Path], kind: int) -> float:
    """Seconds to compile the kernels that EVERY scene needs and Numba's cache, a `cache_kind`, lacks by its files'
    times."""
    if any(os.environ.get(name) for name in ("NUMBA_DISABLE_JIT", "NUMBA_CACHE_LOCATOR_CLASSES")):
        return 0.0
    there: dict[str, set[str]] = {}
    total = 0.0
    for kernel in (kernel for path in lists for kernel in listed(path) if kernel.asked_by == EVERY):
        if kernel.module not in there:
            there[kernel.module] = _compiled(PACKAGES / (kernel.module.replace(".", "/") + ".py"), kind)
        total += kernel.seconds * (kernel.name not in there[kernel.module])
    return total


def _compiled(source: Path, kind: int) -> set[str]:
    """The kernels of a module that this version of Python compiled since the source was written."""
    ending = f".py{sys.version_info[0]}{sys.version_info[1]}{sys.abiflags}.nbi"
    written = source.stat().st_mtime
    try:
        entries = list(os.scandir(cache_folder(source.parent, kind)))
    except FileNotFoundError:
        return set()
    return {
        entry.name[len(source.stem) + 1 :].rsplit("-", 1)[0]
        for entry in entries
        if entry.name.startswith(f"{source.stem}.") and entry.name.endswith(ending)
        if entry.stat().st_mtime >= written
    }


def _cores() -> int:
    """Cores that this process may use, without Numba, which takes a third of a second to import."""
    given = os.environ.get("NUMBA_NUM_THREADS", "")
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(allowed, int(given)) if given.isdigit() else allowed
