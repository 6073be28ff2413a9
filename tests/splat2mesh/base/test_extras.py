"""A package that is missing is named with the command that installs it."""

import sys
from pathlib import Path

import numpy as np
import pytest

from splat2mesh.base.errors import InputError
from splat2mesh.base.extras import EXTRAS, PACKAGES, installed, needed


def test_a_missing_package_is_one_line_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(InputError, match=r'^the network needs onnxruntime.*pip install "splat2mesh\[networks\]"$'):
        needed("onnxruntime", "the network")


def test_whether_a_package_is_there(monkeypatch):
    assert installed("numpy") and not installed("no_such_package")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    assert not installed("onnxruntime")


def test_every_extra_brings_its_package():
    tomllib = pytest.importorskip("tomllib")  # of Python 3.11
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    for package, extra in EXTRAS.items():
        assert any(line.startswith(PACKAGES.get(package, package).replace("_", "-")) for line in extras[extra])


def test_plans_leave_the_network_out_where_it_cannot_run(monkeypatch):
    from relight.planning import choice

    monkeypatch.setattr(choice, "installed", lambda package: False)
    every = choice.Choice.__new__(choice.Choice)
    every._method, every._rays = None, None
    every.measured = type("Measured", (), {"sample": type("Sample", (), {"sizes": np.array([10])})})
    assert "neural" not in every._methods(3, None)
