"""Hostile files at every reader: how many crash, hang, fill the memory, fail without a message, or load as if whole.

A process for each kind reads its inputs, with limits on time and memory; a process that crashes is counted and
replaced. Inputs are damaged copies of whole files of every kind (flips, cuts, insertions, larger numbers in
headers), files whose headers lie, and paths that are no files. They are seeded: the same seed, the same inputs.
"""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

QUICK = ["--inputs", "120"]

SECONDS, GIGABYTES, WAIT_SECONDS = 60, 4, 300
"""Limits of an input: seconds of all cores together, GB of the process; and how long is waited on a busy machine."""

MOST_READERS = 4
"""At a time: each may take its 4 GB."""

OUTCOMES = ("read", "refused", "silent", "traceback", "signal", "slow", "large")
"""read: as well it may. refused: an InputError of one line. silent: a file with a checksum loads with other content.
traceback: any other exception, which a command would end with exit code 1. slow, large: over the limits."""


def arguments(parser):
    """Arguments of this subject."""
    parser.add_argument("--inputs", type=int, default=3200, metavar="N", help="damaged files (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--kinds", nargs="+", metavar="KIND", help="only these kinds")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where inputs that got through are kept")


def run(options, report):
    """Attack every reader, several at a time."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "support"))
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(min(MOST_READERS, os.cpu_count() or 1)) as pool:
        from attacks import whole_files

        whole = whole_files(Path(folder, "whole"))
        kinds = options.kinds or list(whole)
        unknown = sorted(set(kinds) - set(whole))
        if unknown:
            sys.exit(f"no kind {', '.join(unknown)}; there are {', '.join(whole)}")
        table = report.table(
            "inputs by reader", kind="<18", inputs="d", **{name: "d" for name in OUTCOMES}, peak_gb=".2f", most_s=".1f"
        )
        each, every = -(-options.inputs // len(kinds)), []
        seeds = [options.seed * 1000 + list(whole).index(kind) for kind in kinds]
        work = [
            pool.submit(_attacked, kind, whole[kind], each, seed, Path(folder, kind), options.keep)
            for kind, seed in zip(kinds, seeds, strict=True)
        ]
        for done in work:
            row, notes = done.result()
            for note in notes:
                report.note(note)
            every.append(table.add(**row))
        sums = {name: sum(row[name] for row in every) for name in ("inputs", *OUTCOMES)}
        table.add(kind="all", **sums, **{name: max(row[name] for row in every) for name in ("peak_gb", "most_s")})


def _attacked(kind, whole, count, seed, folder, keep):
    """(row of the table, notes on inputs that got through) of one reader."""
    from attacks import attacks_of

    counts, peak, most, notes, reader = Counter(), 0.0, 0.0, [], Reader()
    for index, attack in enumerate(attacks_of(kind, whole, count, seed)):
        path = folder / str(index)
        outcome, detail, gigabytes, seconds = reader.read(kind, attack.write(path), attack.summed)
        counts[outcome] += 1
        peak, most = max(peak, gigabytes), max(most, seconds)
        if outcome not in ("read", "refused"):
            notes.append(f"  {kind} {index} {attack.label}: {outcome} {detail}")
            if keep:
                keep.mkdir(parents=True, exist_ok=True)
                with contextlib.suppress(shutil.Error):  # of pipes and devices
                    shutil.copytree(path, keep / f"{kind}-{index}", symlinks=True, dirs_exist_ok=True)
        shutil.rmtree(path, ignore_errors=True)
    reader.close()
    row = {name: counts[name] for name in OUTCOMES}
    return {"kind": kind, "inputs": sum(counts.values()), **row, "peak_gb": peak, "most_s": most}, notes


class Reader:
    """A process that reads one input after another; a new one after a crash."""

    def __init__(self):
        self._process = None

    def read(self, kind, path, summed):
        """(outcome, detail, GB at most so far in this process, seconds of all cores) of one input."""
        if self._process is None:
            self._start()
        self._process.stdin.write(json.dumps([kind, str(path), summed]) + "\n")
        self._process.stdin.flush()
        timer = _Timer(self._process.pid, WAIT_SECONDS)
        line = self._process.stdout.readline()
        timer.stop()
        if not line:
            code = self._process.wait()
            self._process = None
            if timer.fired:
                return "slow", f"killed after {WAIT_SECONDS} s", 0.0, float(WAIT_SECONDS)
            return "signal", signal.Signals(-code).name if code < 0 else f"exit {code}", 0.0, 0.0
        outcome, detail, gigabytes, seconds = json.loads(line)
        if seconds > SECONDS:
            outcome, detail = "slow", f"{seconds:.0f} s"
        if gigabytes > GIGABYTES:
            outcome, detail = "large", f"{gigabytes:.1f} GB"
        if gigabytes > 1.0:  # the peak is that of the process, so the next input gets its own
            self.close()
        return outcome, detail, gigabytes, seconds

    def _start(self):
        command = [sys.executable, str(Path(__file__).resolve().parents[2] / "tests" / "support" / "attacked.py")]
        root = str(Path(__file__).resolve().parents[2])
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=environment,
        )

    def close(self):
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


class _Timer:
    """Kills a process after a number of seconds, unless stopped earlier."""

    def __init__(self, pid, seconds):
        import threading

        self.fired = False

        def fire():
            self.fired = True
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

        self._timer = threading.Timer(seconds, fire)
        self._timer.start()

    def stop(self):
        """Let the process be."""
        self._timer.cancel()
