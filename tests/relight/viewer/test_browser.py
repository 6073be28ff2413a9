"""The session in a notebook's cell and in a browser: a widget comes back; who lacks the token is not let in."""

import asyncio
import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest

pytest.importorskip("pyvista")
pytest.importorskip("trame_pyvista", reason="the extra web is not installed")

from viewer_scenes import ball_on_plate

from relight.viewer.waiting import Served
from splat2mesh.base.errors import InputError

ROOT = Path(__file__).parents[3]

CELL = """
from viewer_scenes import ball_on_plate
from relight import view
view(ball_on_plate(), "noon", method="analytic", tolerance=0.1, size=(160, 120))
"""


@pytest.fixture
def importable(monkeypatch):
    """This checkout and the tests' support, for processes of their own."""
    paths = [str(ROOT), str(ROOT / "tests" / "support"), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))


@pytest.mark.slow
def test_a_cell_shows_a_widget(importable):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    pytest.importorskip("ipywidgets")
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(CELL)])
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    (result,) = (each for each in notebook.cells[0].outputs if each["output_type"] == "execute_result")
    assert "application/vnd.jupyter.widget-view+json" in result["data"] and "iframe" in result["data"]["text/plain"]


@pytest.fixture
def served(importable, tmp_path):
    """A running `relight ball --serve`: the process, and its address."""
    ball_on_plate().save(tmp_path / "ball")
    command = [sys.executable, "-m", "relight", "ball", "--serve", "--method", "analytic", "--tolerance", "10%"]
    command += ["--albedo", "captured"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    lines = []
    for line in process.stderr:
        lines.append(line)
        if line.startswith("open http://"):
            break
    assert lines and lines[-1].startswith("open http://127.0.0.1:"), "".join(lines)
    yield process, lines[-1].split()[1]
    process.kill()
    process.wait()


async def greeting(port, secret):
    """What the server answers to a browser that says this secret: a message of wslink."""
    import aiohttp
    import msgpack
    from wslink import chunking

    hello = {"wslink": "1.0", "id": "system:c0:0", "method": "wslink.hello", "args": [{"secret": secret}]}
    hello["kwargs"] = {}
    async with aiohttp.ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/ws") as socket:
        for chunk in chunking.generate_chunks(msgpack.packb(hello), 2**20):
            await socket.send_bytes(chunk)
        whole = chunking.UnChunker()
        while True:
            message = await asyncio.wait_for(socket.receive(), 60)
            found = whole.process_chunk(message.data)
            if found is not None:
                return str(found)


@pytest.mark.slow
def test_a_session_is_served_to_who_has_its_token_until_it_is_interrupted(served):
    process, url = served
    port, (token,) = urlsplit(url).port, parse_qs(urlsplit(url).query)["secret"]
    assert len(token) >= 20
    with urllib.request.urlopen(url, timeout=60) as page:
        assert page.status == 200 and b"<html" in page.read().lower()
    assert "clientID" in asyncio.run(greeting(port, token))
    for wrong in ("wslink-secret", "", token[:-1]):
        assert "Authentication failed" in asyncio.run(greeting(port, wrong))
    with pytest.raises(InputError, match=f"port {port} cannot be used"):
        Served.at(port)
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 130
