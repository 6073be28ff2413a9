"""The Python of docs/python.md runs as it stands, block after block, in a folder with a splat and a light."""

import re
from pathlib import Path

import numpy as np
import pytest
from ball_splats import solid_ball
from shrunk import shrink

import relight
from splat2mesh.splats.formats import read_splats, write_inria_ply
from splat2mesh.surface.extract import EFFORTS, Effort

ROOT = Path(__file__).parents[2]


def blocks(text):
    return re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.fixture
def shown(tmp_path, monkeypatch):
    """A folder with what the page names, a small effort, and no windows: what would be shown."""
    OpenEXR = pytest.importorskip("OpenEXR")
    pyvista = pytest.importorskip("pyvista", reason="the extra view is not installed")
    monkeypatch.chdir(tmp_path)
    shrink(monkeypatch.setattr)
    for detail in EFFORTS:
        monkeypatch.setitem(EFFORTS, detail, Effort(views=12, pixels=96, cells=80))
    write_inria_ply("garden.ply", solid_ball(1500))
    light = np.random.default_rng(0).gamma(1.0, 1.0, (16, 32, 3)).astype(np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": light}).write("stpeters.exr")
    Path("hdris").mkdir()
    Path("hdris/church.exr").write_bytes(Path("stpeters.exr").read_bytes())
    shown = []
    monkeypatch.setattr(pyvista.PolyData, "plot", lambda mesh, **how: shown.append((mesh.n_points, how["scalars"])))
    monkeypatch.setattr(relight, "view", lambda scene, env: shown.append((scene, env)))
    return shown


@pytest.mark.slow
def test_the_python_of_the_page_runs_in_order(shown, capsys):
    found = blocks((ROOT / "docs" / "python.md").read_text("utf-8"))
    assert len(found) == 3
    names: dict = {}
    for block in found:
        exec(block, names)
    assert len(read_splats("evening.ply")) == 1500
    assert shown == [(len(names["scene"].vertices), "rgb"), ("garden", "noon")]
    assert names["radiance"].shape == names["albedo"].shape == (len(names["scene"].vertices), 3)
    assert Path("garden/relit/sheet.png").is_file() and Path("garden/relit/church_270/radiance.npy").is_file()
    assert "plan" in capsys.readouterr().out.lower()
