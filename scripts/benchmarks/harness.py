"""The parts of every benchmark: time, relative error, scenes, tables that print as they grow, JSON, a plot.

A subject is a module of this folder with

    QUICK          arguments of its smallest run, a list of strings
    arguments()    adds its own arguments to a parser
    run()          measures, with the parsed options and a Report
    PLOT           optional: keywords of `draw`, for --plot

`scripts/bench SUBJECT --json FILE --plot FILE` come with all of them.
"""

import argparse
import importlib
import json
import math
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
GROUND_TRUTH = ROOT.parent / "shared" / "data"
"""Folder with groundtruth/NAME and env/LIGHT.exr beside the checkout, for subjects that need path-traced scenes."""


class Timing(NamedTuple):
    """A result and its cost. cpu, in seconds of all threads, is steady beside other work; wall is the wait."""

    result: Any
    wall: float
    cpu: float


def timed(work: Callable[[], Any]) -> Timing:
    """Call once."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return Timing(result, time.perf_counter() - wall, time.process_time() - cpu)


def medians(works: dict[str, Callable[[], Any]], repeats: int) -> dict[str, Timing]:
    """Medians of several calls, the works alternating, so a busy moment hits all alike; results are the last ones."""
    runs = {name: [] for name in works}
    for _ in range(repeats):
        for name, work in works.items():
            runs[name].append(timed(work))
    return {
        name: Timing(of[-1].result, *(float(np.median([run[k] for run in of])) for k in (1, 2)))
        for name, of in runs.items()
    }


def relative_error(found, expected, of=None) -> float:
    """L2 norm of the difference over that of the expected array, or of another one."""
    scale = np.linalg.norm(expected if of is None else of)
    return float(np.linalg.norm(np.subtract(found, expected)) / max(scale, 1e-30))


def geometric_mean(values) -> float:
    """Geometric mean of positive numbers."""
    return float(np.exp(np.mean(np.log(values))))


class Table:
    """Rows that print as they are added, each value by the format of its column ("<12" text, ".3f" a number)."""

    def __init__(self, title: str, columns: dict[str, str]):
        self.title, self.columns, self.rows = title, columns, []
        self._width = {
            name: max(len(name), int(spec[1:]) if spec.startswith("<") else 7) for name, spec in columns.items()
        }
        if title:
            print(f"\n{title}")
        print(self._line({name: name for name in columns}, plain=True), flush=True)

    def add(self, **row: Any) -> dict:
        """Print a row and keep it; a column without a value stays blank. Returns the row."""
        self.rows.append(row)
        print(self._line(row), flush=True)
        return row

    def _line(self, row, plain=False):
        cells = []
        for name, spec in self.columns.items():
            value, left = row.get(name), spec.startswith("<")
            text = "" if value is None else str(value) if plain or left else format(value, spec)
            cells.append(text.ljust(self._width[name]) if left else text.rjust(self._width[name]))
        return "  ".join(cells).rstrip()


class Report:
    """The results of a run: tables and single lines, printed as they come and kept for JSON and plots."""

    def __init__(self):
        self.tables: list[Table] = []
        self.notes: list[str] = []

    def table(self, title: str = "", /, **columns: str) -> Table:
        """Begin a table; columns by name with their formats."""
        self.tables.append(Table(title, columns))
        return self.tables[-1]

    def note(self, line: str) -> None:
        """Print and keep a line."""
        self.notes.append(line)
        print(line, flush=True)

    def write(self, path: Path, subject: str) -> None:
        """All of it as JSON."""
        tables = [{"title": table.title, "rows": table.rows} for table in self.tables]
        machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
        found = {"subject": subject, "machine": machine, "notes": self.notes, "tables": tables}
        path.write_text(json.dumps(found, indent=1, default=float) + "\n", encoding="utf-8")


def draw(report: Report, path: Path, x: str, y: str, by: tuple[str, ...]) -> None:
    """One plot of all rows that have columns x and y: a line for each combination of the columns `by`, log scales."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    lines: dict[str, list] = {}
    for row in (row for table in report.tables for row in table.rows):
        if row.get(x) and row.get(y):
            lines.setdefault(", ".join(str(row.get(key, "")) for key in by), []).append((row[x], row[y]))
    figure, axes = pyplot.subplots(figsize=(8, 5), layout="constrained")
    for label, points in lines.items():
        axes.plot(*zip(*sorted(points), strict=True), "o-", label=label, lw=1, ms=4)
    axes.set(xlabel=x, ylabel=y, xscale="log", yscale="log")
    axes.legend(fontsize=7)
    figure.savefig(path, dpi=110)


def subjects() -> dict[str, str]:
    """Name -> first line of every subject, without importing any."""
    import ast

    found = {}
    for path in sorted(Path(__file__).parent.glob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        if any(isinstance(node, ast.FunctionDef) and node.name == "arguments" for node in tree.body):
            found[path.stem] = (ast.get_docstring(tree) or "").splitlines()[0]
    return found


def parser_of(name: str, module: ModuleType) -> argparse.ArgumentParser:
    """The parser of a subject, with what all have in common."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(f"scripts/bench {name}", description=module.__doc__, formatter_class=form)
    module.arguments(parser)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures as JSON")
    if hasattr(module, "PLOT"):
        parser.add_argument("--plot", type=Path, metavar="FILE", help="draw them as PNG")
    parser.add_argument("--quick", action="store_true", help=f"the smallest run: {' '.join(module.QUICK)}")
    return parser


def measure(name: str, arguments: list[str]) -> None:
    """Run one subject."""
    module = importlib.import_module(f"benchmarks.{name}")
    parser = parser_of(name, module)
    options = parser.parse_args(arguments)
    if options.quick:
        options = parser.parse_args([*module.QUICK, *arguments])
    report = Report()
    module.run(options, report)
    if options.json:
        report.write(options.json, name)
    if getattr(options, "plot", None):
        draw(report, options.plot, **module.PLOT)


def growth(sizes, costs) -> float | None:
    """p of cost ~ size^p between the last two: 1 is linear; None where it means nothing."""
    if len(costs) < 2 or min(costs[-2:]) <= 0 or sizes[-1] == sizes[-2]:
        return None
    return math.log(costs[-1] / costs[-2]) / math.log(sizes[-1] / sizes[-2])
