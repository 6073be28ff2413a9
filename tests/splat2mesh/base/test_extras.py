"""A package that is missing is named with the command that installs it."""

import ast
import re
import sys
from pathlib import Path

import pytest

from splat2mesh.base.errors import InputError
from splat2mesh.base.extras import EXTRAS, installed, needed


@pytest.mark.parametrize(
    "package,command", [("onnxruntime", "pip install onnxruntime"), ("coacd", r'pip install "splat2mesh\[proxy\]"')]
)
def test_a_missing_package_is_one_line_with_its_command(package, command, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf"^the network needs {package}.*: {command}$"):
        needed(package, "the network")


def test_whether_a_package_is_there(monkeypatch):
    assert installed("numpy") and not installed("no_such_package")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    assert not installed("onnxruntime")


ROOT = Path(__file__).parents[3]


@pytest.fixture
def project():
    tomllib = pytest.importorskip("tomllib")  # of Python 3.11
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def names(requirements):
    """Names of packages as Python imports them."""
    imported = {
        "backports.zstd": "backports",
        "pillow": "PIL",
        "open3d-cpu": "open3d",
        "trame-pyvista": "trame_pyvista",
        "usd-core": "pxr",
    }
    found = {re.match(r"[\w.-]+", line)[0] for line in requirements}
    return {imported.get(name, name.replace("-", "_")) for name in found}


def test_every_extra_brings_its_package(project):
    for package, extra in EXTRAS.items():
        assert package in names(project["optional-dependencies"][extra])


def test_what_needs_no_extra_comes_with_the_packages_and_training_alone_brings_torch(project):
    """`--view` and `--method neural-gash` run after `scripts/setup`."""
    assert {"pyvista", "onnxruntime"} <= names(project["dependencies"])
    extras = project["optional-dependencies"]
    assert [extra for extra, lines in extras.items() if "torch" in names(lines)] == ["train"]
    pinned = names((ROOT / "constraints.txt").read_text().splitlines()[1:])
    assert {"pyvista", "vtk", "onnxruntime", "torch"} <= pinned


def test_every_import_is_of_a_dependency_or_of_an_extra_that_users_have(project):
    extras = project["optional-dependencies"]
    users = [line for extra, lines in extras.items() if extra not in ("dev", "train", "docs") for line in lines]
    known = names([*project["dependencies"], *users]) | set(sys.stdlib_module_names) | {"relight", "splat2mesh"}
    # Of Python 3.14, of pyvista, of trame-pyvista, of distributed, of a notebook and of a caller who has a mesh of it.
    beside = {"compression", "vtkmodules", "trame", "dask", "IPython", "trimesh"}
    found = {}
    for path in (path for package in ("splat2mesh", "relight") for path in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            modules = [each.name for each in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and not node.level:
                modules = [node.module]
            found |= {module.partition(".")[0]: path.relative_to(ROOT).as_posix() for module in modules}
    assert {name: path for name, path in found.items() if name not in known | beside} == {}
