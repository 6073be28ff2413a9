"""The notebooks under examples/, run as notebooks from their first cell to their last."""

import os
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples").glob("*.py"))

SMALL = """
from shrunk import shrink
from splat2mesh.surface.extract import EFFORTS, Effort
shrink(setattr)
EFFORTS["draft"] = Effort(views=12, pixels=96, cells=80, depth=6, points=20_000)
"""
"""What the kernel runs first, so that every cell takes a second."""


def cells(text):
    """(kind, source) of every cell of a notebook in jupytext's percent format."""
    for part in re.split(r"^# %%", text, flags=re.MULTILINE)[1:]:
        title, _, body = part.partition("\n")
        if "[markdown]" in title:
            yield "markdown", re.sub(r"^# ?", "", body, flags=re.MULTILINE)
        else:
            yield "code", body.strip()


def test_there_is_a_notebook():
    assert NOTEBOOKS


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_cell_runs_and_pictures_are_shown(path, tmp_path, monkeypatch):
    nbclient = pytest.importorskip("nbclient", reason="needs nbclient and ipykernel")
    pytest.importorskip("ipykernel", reason="needs nbclient and ipykernel")
    text, widget = path.read_text("utf-8"), "application/vnd.jupyter.widget-view+json"
    has_view = bool(re.search(r"\bview\(", text))
    if has_view:
        pytest.importorskip("trame_pyvista", reason="the session in a cell needs the extra web")
    from nbformat import v4

    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "tests" / "support")]))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    startup = tmp_path / "ipython" / "profile_default" / "startup"
    startup.mkdir(parents=True)
    (startup / "small.py").write_text(SMALL)
    makers = {"markdown": v4.new_markdown_cell, "code": v4.new_code_cell}
    notebook = v4.new_notebook(cells=[makers[kind](source) for kind, source in cells(text)])
    nbclient.NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 3
    assert any(widget in output.get("data", {}) for output in outputs) == has_view
