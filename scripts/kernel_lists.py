"""Write the lists of kernels that a first run compiles ahead (splat2mesh/base/ahead.py), from real runs.

python scripts/kernel_lists.py [FOLDER]

Both commands run on a small object, on the example garden and on the example room, each from an empty cache: some
minutes. Run it again when kernels, their types or their order change; a test names kernels that the lists lack.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from splat2mesh.base.ahead import EVERY, LIST, OBJECT, PLACE, SOME, SWITCH

ROOT = Path(__file__).resolve().parents[1]

SMALL = ("--splats", "20000", "--vertices", "6000", "--views", "12", "-q")
COARSE = ("--detail", "draft", "--vertices", "20000", "--cameras", "none")
"""Sizes that no kernel's types depend on."""

RECORD = """
import atexit, json, runpy, sys, threading, time
from numba.core import event
from numba.core.caching import NullCache
from splat2mesh.base.kernel_types import text_of

class Listener(event.Listener):
    def __init__(self):
        self.here, self.rows = threading.local(), []

    def on_start(self, _):
        self.here.stack = [*getattr(self.here, "stack", []), time.thread_time()]

    def on_end(self, event):
        seconds, kernel = time.thread_time() - self.here.stack.pop(), event.data["dispatcher"]
        if not self.here.stack and not isinstance(kernel._cache, NullCache):
            try:
                kinds = [text_of(kind) for kind in event.data["args"]]
            except ValueError as error:
                kinds = str(error)
            self.rows.append((f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}", kinds, seconds))

listener = Listener()
event.register("numba:compile", listener)
out, module, *sys.argv[1:] = sys.argv[1:]
atexit.register(lambda: json.dump(listener.rows, open(out, "w")))
sys.argv[0] = module
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""


Row = tuple[str, Any, float]
"""A kernel that compiled: module and name, the texts of its types or why there are none, seconds."""


def recorded(command: str, *words: str | Path) -> list[Row]:
    """The kernels that a command compiles from an empty cache because Python calls them, in order."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "rows.json"
        environment = os.environ | {"NUMBA_CACHE_DIR": folder, "PYTHONPATH": str(ROOT), SWITCH: "0"}
        line = [sys.executable, "-c", RECORD, str(out), command, *map(str, words)]
        subprocess.run(line, env=environment, stdout=subprocess.DEVNULL, check=True)
        return [(name, kinds, seconds) for name, kinds, seconds in json.loads(out.read_text())]


def merged(runs: dict[str, list[Row]]) -> list[tuple[str, Any, float, str]]:
    """The kernels of several runs in one order, and what asks for each: one stands behind the one before it in the
    first run that has it. runs: by the kind of scene."""
    order: list[Row] = []
    asking: dict[str, set[str]] = {}
    for scene, run in runs.items():
        place = 0
        for name, kinds, cost in run:
            asking.setdefault(json.dumps([name, kinds]), set()).add(scene)
            there = next((i for i, other in enumerate(order) if other[:2] == (name, kinds)), None)
            if there is None:
                order.insert(place, (name, kinds, cost))
                place += 1
            else:
                place = max(place, there + 1)
    scenes = {frozenset(runs): EVERY, frozenset(runs) - {OBJECT}: PLACE, frozenset({OBJECT}): OBJECT}
    return [(*row, scenes.get(frozenset(asking[json.dumps(row[:2])]), SOME)) for row in order]


def write(path: Path, rows: Sequence[tuple[str, Any, float, str]]) -> None:
    """Write a list: the texts of all types once, then a line a kernel."""
    for name, why, *_ in rows:
        if isinstance(why, str):
            print(f"left out {name}: {why}", file=sys.stderr)
    rows = [row for row in rows if not isinstance(row[1], str)]
    kinds = {json.dumps(kind): kind for _, texts, *_ in rows for kind in texts}
    places = {text: place for place, text in enumerate(kinds)}
    lines = [
        json.dumps([*name.rsplit(".", 1), [places[json.dumps(kind)] for kind in texts], round(cost, 2), asked_by])
        for name, texts, cost, asked_by in rows
    ]
    types = ",\n".join(kinds)
    path.write_text('{"types": [\n' + types + '\n],\n"kernels": [\n' + ",\n".join(lines) + "\n]}\n", encoding="utf-8")


def main(folder: str) -> None:
    """Make small scenes in a folder, run both commands on them, and write the lists."""
    meshing, lighting = {}, {}
    for kind in (OBJECT, "garden", "lounge"):
        truth, scene = Path(folder) / f"{kind}_truth", Path(folder) / kind
        words = [sys.executable, "-m", "scenes", str(truth), "--kind", kind, *SMALL]
        subprocess.run(words, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        splat = next(path for path in truth.rglob("*.ply") if path.name in ("splat.ply", "point_cloud.ply"))
        meshing[kind] = recorded("splat2mesh", splat, "-o", scene, *COARSE)
        lighting[kind] = recorded("relight", scene, "--env", "sunset")
        for name, rows in (("splat2mesh", meshing[kind]), ("relight", lighting[kind])):
            print(f"{kind}, {name}: {len(rows)} kernels, {sum(row[2] for row in rows):.1f} s", file=sys.stderr)
    write(ROOT / "splat2mesh" / LIST, merged(meshing))
    write(ROOT / "relight" / LIST, merged(lighting))


if __name__ == "__main__":
    if sys.argv[1:]:
        main(sys.argv[1])
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(temporary)
