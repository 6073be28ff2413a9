"""Every benchmark can be imported and lists its arguments and its smallest run; the harness measures correctly."""

import importlib
import json
import sys
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))

from benchmarks import harness


@pytest.mark.parametrize("name", harness.subjects())
def test_a_subject_has_its_arguments_and_a_smallest_run(name):
    module = importlib.import_module(f"benchmarks.{name}")
    parser = harness.parser_of(name, module)
    options = parser.parse_args([*module.QUICK, "--quick"])
    assert options.quick and callable(module.run) and module.__doc__


def test_tables_are_kept_as_json(tmp_path, capsys):
    report = harness.Report()
    table = report.table("errors", name="<6", error=".2f")
    table.add(name="a", error=np.float32(0.5))
    table.add(name="b")
    report.note("done")
    report.write(tmp_path / "found.json", "try")
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["tables"] == [{"title": "errors", "rows": [{"name": "a", "error": 0.5}, {"name": "b"}]}]
    assert found["notes"] == ["done"]
    assert "0.50" in capsys.readouterr().out


def test_time_is_wall_and_processor_time():
    slept = harness.timed(lambda: time.sleep(0.05))
    assert slept.wall >= 0.05 > slept.cpu


def test_relative_errors():
    assert harness.relative_error([3, 4], [0, 5], of=[0, 10]) == pytest.approx(np.sqrt(10) / 10)
    assert harness.growth([1, 10], [2, 200]) == pytest.approx(2)
    assert harness.growth([1], [2]) is None
