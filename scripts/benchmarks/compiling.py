"""Processor seconds that a command spends on compiling its kernels, from an empty cache, kernel by kernel.

The command runs in a separate process, so a scene folder that it writes must be new; functions compiled within a
kernel, such as Numba's own, have separate rows.
Beside other work, seconds vary by a fifth: alternate several runs.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

QUICK = ["relight", "--version"]
"""Compiles nothing."""

TRACE = """
import atexit, json, runpy, sys, threading, time
from numba.core import event

class Listener(event.Listener):
    def __init__(self):
        self.here, self.rows = threading.local(), []

    def on_start(self, _):
        self.here.stack = [*getattr(self.here, "stack", []), [time.thread_time(), 0.0]]

    def on_end(self, event):
        begun, within = self.here.stack.pop()
        seconds = time.thread_time() - begun
        if self.here.stack:
            self.here.stack[-1][1] += seconds
        kernel = event.data["dispatcher"].py_func
        self.rows.append((f"{kernel.__module__}.{kernel.__name__}", seconds - within))

listener = Listener()
event.register("numba:compile", listener)
out, module, *sys.argv[1:] = sys.argv[1:]
atexit.register(lambda: json.dump([listener.rows, time.process_time()], open(out, "w")))
sys.argv[0] = module
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""


def arguments(parser):
    parser.add_argument("command", nargs="?", choices=["splat2mesh", "relight"], default="relight")
    parser.add_argument("words", nargs="*", metavar="ARGUMENT", help="of the command; after -- where it is an option")
    parser.add_argument("--version", dest="words", action="store_const", const=["--version"], help="of the command")
    parser.add_argument("--rows", type=int, default=30, help="kernels that are listed, the slowest first")


def run(options, report):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "rows.json"
        command = [sys.executable, "-c", TRACE, str(out), options.command, *options.words]
        subprocess.run(command, env=os.environ | {"NUMBA_CACHE_DIR": folder}, stdout=subprocess.DEVNULL, check=True)
        rows, seconds = json.loads(out.read_text())
    spent: dict[str, list[float]] = {}
    for name, own in rows:
        spent.setdefault(name, []).append(own)
    table = report.table(f"{options.command} {' '.join(options.words)}", kernel="<48", times="d", seconds=".2f")
    for name, own in sorted(spent.items(), key=lambda item: -sum(item[1]))[: options.rows]:
        table.add(kernel=name, times=len(own), seconds=sum(own))
    total = sum(own for _, own in rows)
    report.note(f"{total:.1f} of {seconds:.1f} processor s compile {len(rows)} functions")
