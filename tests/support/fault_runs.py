"""Whole commands with a fault at each of their file operations, and whether anything is lost, half or left behind.

A library that is preloaded (`faults.c`) counts the operations of the C library on files of one folder, and lets one of
them fail. A server that has both commands loaded runs them in copies of itself, in a fraction of a second each.
"""

import errno
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent

NONE, ONCE, GONE, FULL, KILL, SIGNAL = range(6)  # as in faults.c

FAULTS = {
    "error": (ONCE, errno.EIO),  # one operation fails
    "gone": (GONE, 0),  # it and all later ones fail, clean-up too
    "full": (FULL, 0),  # it and all later ones that take space fail
    "kill": (KILL, 0),
    "term": (SIGNAL, signal.SIGTERM),
    "ctrl-c": (SIGNAL, signal.SIGINT),
}

VARYING = ("seconds", "peak_mb", "warnings", "plan", "rays_traced")
"""Of report.json: differ from run to run. A plan predicts seconds, from the speed of rays; rays are
traced where none were kept."""


class Case(NamedTuple):
    """A command in a folder: its words, and the outputs that appear whole or not at all."""

    command: str
    arguments: tuple
    outputs: tuple


class Outcome(NamedTuple):
    """What came of a run with a fault. fault: of FAULTS. code: None where it hung. wrong: what must not be."""

    fault: str
    at: int
    code: int | None
    said: str
    wrong: tuple


def built(folder):
    """The path of the library, compiled into a folder; None where there is no compiler, or no system it is made for."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not sys.platform.startswith("linux"):
        return None
    library = Path(folder) / "faults.so"
    options = ["-shared", "-fPIC", "-O1", "-o", str(library), str(HERE / "faults.c"), "-ldl"]
    done = subprocess.run([compiler, *options], capture_output=True, check=False)
    return library if done.returncode == 0 else None


class Server:
    """Runs commands; `folder` takes what they say. To be closed."""

    def __init__(self, library, folder):
        self._folder, self._runs = Path(folder), 0
        more = {
            "LD_PRELOAD": str(library),
            "FAULTS": str(library),
            "PYTHONPATH": os.pathsep.join([str(ROOT), str(HERE)]),
        }
        # Copies of a process have none of its threads: so it must have none.
        more |= dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        self._process = subprocess.Popen(
            [sys.executable, str(HERE / "fault_server.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | more,
            cwd=folder,
        )

    def warm(self, case, folder):
        """Run a case in the server itself, so that copies of it have at hand what is loaded and compiled."""
        self._ask([{"command": case.command, "arguments": case.arguments, "folder": str(folder)}], [])

    def run(self, case, folder, fault=None, at=0, names=None):
        """(exit code, what it said) of a case in a folder; fault: of FAULTS. names: where operations are listed."""
        return self.at_once([(case, folder, 0.0)], fault, at, names)[0]

    def at_once(self, cases, fault=None, at=0, names=None):
        """The same of several (case, folder, seconds to wait) begun at once."""
        kind, detail = FAULTS[fault] if fault else (NONE, 0)
        runs = []
        for case, folder, wait in cases:
            self._runs += 1
            said = str(self._folder / f"said-{self._runs % 8}")
            how = {"at": at, "kind": kind, "detail": detail, "said": said, "names": names and str(names), "wait": wait}
            runs.append({"command": case.command, "arguments": case.arguments, "folder": str(folder), **how})
        return self._ask([], runs)

    def _ask(self, warm, runs):
        self._process.stdin.write(json.dumps({"warm": warm, "runs": runs}) + "\n")
        self._process.stdin.flush()
        return [tuple(each) for each in json.loads(self._process.stdout.readline())]

    def close(self):
        """End it."""
        self._process.kill()
        self._process.wait()


def state_of(folder):
    """{path: digest} of all files of a folder, and of folders ""; what differs from run to run is left out."""
    found = {}
    for path in sorted(Path(folder).rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.name.startswith(("plan-", "sample-")):  # with times
            found[name] = "timed"
        elif path.is_symlink() or not path.is_file():
            found[name] = "folder" if path.is_dir() else "link"
        else:
            content = path.read_bytes()
            found[name] = hashlib.sha256(_lasting(content) if path.name == "report.json" else content).hexdigest()
    return found


def _lasting(content):
    """A report without what varies; as it is where it is half."""
    try:
        report = json.loads(content)
    except ValueError:
        return content
    return json.dumps({key: report[key] for key in report if key not in VARYING}).encode()


def part_of(state, name):
    """The state of what has a name, and of what is below it; empty where it is not there."""
    return {path: digest for path, digest in state.items() if path == name or path.startswith(f"{name}/")}


class Trial:
    """A case in copies of a folder, `template`; `after` is the state that a whole run leaves."""

    def __init__(self, server, case, template, place):
        """Runs it once without a fault. place: where copies are made. Raises RuntimeError where that fails."""
        self._server, self.case, self._template, self._place = server, case, Path(template), Path(place)
        self.before = state_of(template)
        server.warm(case, self._copy())
        folder, names = self._copy(), self._place / "names"
        code, said = server.run(case, folder, names=names)
        if code != 0:
            raise RuntimeError(f"{case}: exit code {code} without a fault: {said}")
        self.operations = names.read_text().splitlines()
        self.after = state_of(folder)

    def outcome(self, fault, at):
        """The Outcome of a run whose operation `at` has a fault, and of another after it."""
        folder = self._copy()
        code, said = self._server.run(self.case, folder, fault, at)
        found = state_of(folder)
        wrong = [*self._wrong_end(fault, code, said, found), *self._wrong_state(found, fault)]
        code_after, said_after = self._server.run(self.case, folder)
        if code_after != 0:
            wrong.append(f"the next run ends with {code_after}: {said_after[-200:]}")
        else:
            left = state_of(folder)
            odd = {name for name in {*left, *self.after} if left.get(name) != self.after.get(name)}
            odd -= {name for name in odd if name not in left and "/cache/" in name}  # what was not needed any more
            wrong += [f"after the next run {name} is {'left' if name in left else 'missing'}" for name in sorted(odd)]
        return Outcome(fault, at, code, said, tuple(wrong))

    def _wrong_end(self, fault, code, said, found):
        """What is wrong with an exit code and what was said."""
        allowed = {"kill": (-9,), "term": (130, 0), "ctrl-c": (130, 0)}.get(fault, (0, 1, 2))
        if code not in allowed:
            yield f"exit code {code}"
        if "Traceback" in said:
            yield "a traceback"
        errors = sum(line.startswith("error: ") for line in said.splitlines())
        if errors != (code in (1, 2, 130)):
            yield f"{errors} lines of error at exit code {code}"
        if code == 0:
            for name in self.case.outputs:
                if part_of(found, name) != part_of(self.after, name):
                    yield f"done, and {name} is not what it should be"

    def _wrong_state(self, found, fault):
        """What is wrong with what a run left."""
        for name in self.case.outputs:
            now, old, new = (part_of(state, name) for state in (found, self.before, self.after))
            if now not in (old, new):
                yield f"{name} is lost" if not now else f"{name} is half"
        made = {
            name for state in (self.before, self.after) for each in self.case.outputs for name in part_of(state, each)
        }
        for name, digest in self.before.items():
            if name not in made and found.get(name) != digest and not name.endswith("/cache"):
                yield f"{name} was {'changed' if name in found else 'lost'}"

    def _copy(self):
        folder = self._place / "run"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(self._template, folder, symlinks=True)
        return folder
