"""The notebooks under examples/, run from their first cell to their last in a folder away from the checkout."""

import ast
import os
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))

nbformat = pytest.importorskip("nbformat", reason="reads notebooks")

SMALL = """
from shrunk import shrink
from splat2mesh.surface.extract import EFFORTS, Effort
shrink(setattr)
EFFORTS["draft"] = Effort(views=12, pixels=96, cells=80)
"""
"""What the kernel runs first, so that every cell takes seconds."""

FEWER = 10
"""By how much the Gaussians of the notebooks are divided, for the same reason."""

everyone = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def read(path):
    return nbformat.read(path, as_version=4)


def code_of(path):
    return "\n\n".join(cell.source for cell in read(path).cells if cell.cell_type == "code")


def test_there_are_two_notebooks():
    assert [path.stem for path in NOTEBOOKS] == ["light_in_a_place", "relight_a_splat"]


@everyone
def test_a_notebook_is_valid_and_kept_without_outputs(path):
    book = read(path)
    nbformat.validate(book)
    assert all(not cell.get("outputs") and cell.get("execution_count") is None for cell in book.cells)


@everyone
def test_a_notebook_imports_what_is_public_and_what_comes_with_the_package(path):
    tree = ast.parse(code_of(path))
    modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    modules |= {name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    assert modules == {"relight", "splat2mesh", "pathlib", "numpy", "open3d", "IPython.display"}


@everyone
def test_a_notebook_shows_tens_of_thousands_of_gaussians(path):
    (count,) = re.findall(r"^COUNT = ([\d_]+)", code_of(path), re.MULTILINE)
    assert int(count) >= 50_000 and f"{int(count):,} Gaussians" in read(path).cells[0].source


@pytest.mark.slow
@everyone
def test_every_cell_runs_and_pictures_are_shown(path, tmp_path, monkeypatch):
    nbclient = pytest.importorskip("nbclient", reason="needs nbclient and ipykernel")
    pytest.importorskip("ipykernel", reason="needs nbclient and ipykernel")
    has_view = bool(re.search(r"\bview\(", code_of(path)))
    if has_view:
        pytest.importorskip("trame_pyvista", reason="the session in a cell needs the extra web")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "tests" / "support")]))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    startup = tmp_path / "ipython" / "profile_default" / "startup"
    startup.mkdir(parents=True)
    (startup / "small.py").write_text(SMALL)
    notebook = read(path)
    for cell in notebook.cells:
        cell.source = re.sub(r"^(COUNT = [\d_]+)", rf"\1 // {FEWER}", cell.source, flags=re.MULTILINE)
    nbclient.NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 3
    assert any("application/vnd.jupyter.widget-view+json" in output.get("data", {}) for output in outputs) == has_view
