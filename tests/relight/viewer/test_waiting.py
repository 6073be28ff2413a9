"""A first look stands where the session will be, and nobody without the token sees it."""

import io
import os
import shutil
import subprocess
import sys
import time
import urllib.error
import urllib.request
from base64 import b64decode
from contextlib import contextmanager

import numpy as np
import pytest
from ball_splats import solid_ball
from PIL import Image

from relight import api
from relight.request import RelightRequest
from relight.viewer.waiting import _PAGE, FIRST_LOOK, Served, first_look
from splat2mesh.base.progress import Stages
from splat2mesh.options import ConvertOptions
from splat2mesh.splats.formats import write_inria_ply

PICTURE = np.arange(8 * 12 * 3, dtype=np.uint8).reshape(8, 12, 3)


def fetched(url):
    """The answer of a server that may not be there yet."""
    for _ in range(300):
        try:
            return urllib.request.urlopen(url, timeout=10)
        except urllib.error.HTTPError:
            raise
        except OSError:
            time.sleep(0.1)
    raise AssertionError(f"{url}: no answer")


def test_a_browser_sees_it_until_the_session_is_ready():
    place, told = Served.at(0), []
    with first_look(PICTURE, place, told.append):
        (url,) = told
        with fetched(url) as answer:
            page = answer.read().decode()
            assert answer.headers[FIRST_LOOK] == "1"
        packed = page.split("base64,")[1].split('"')[0]
        np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(b64decode(packed)))), PICTURE)
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(url.split("?")[0] + "?secret=guess", timeout=10)
    with pytest.raises(OSError):
        urllib.request.urlopen(url, timeout=10)
    assert FIRST_LOOK in _PAGE.format(line="", picture="", header=FIRST_LOOK)


def test_a_window_shows_it(tmp_path):
    Image.fromarray(PICTURE).save(tmp_path / "first.png")
    command = [sys.executable, "-m", "relight.viewer.waiting", str(tmp_path / "first.png")]
    environment = {**os.environ, "PYVISTA_OFF_SCREEN": "true"}
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, env=environment) as process:
        assert process.wait(120) == 0, process.stderr.read()


def test_where_it_cannot_be_shown_the_session_comes_without(monkeypatch):
    monkeypatch.setattr(sys, "executable", shutil.which("false") or pytest.skip("no program that fails"))
    with first_look(PICTURE):
        pass


def test_a_picture_of_a_session_needs_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_inria_ply("ball.ply", solid_ball(2000))
    stages = Stages()
    request = RelightRequest("ball.ply", "noon", meshing=ConvertOptions(up="-y", stand="outside", vertices=500))
    api._session(request, stages, None)
    assert "first look" not in stages.seconds and stages.seconds


def test_a_session_of_a_splat_begins_with_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_inria_ply("ball.ply", solid_ball(4000))
    request = RelightRequest("ball.ply", "noon", meshing=ConvertOptions(up="-y", stand="outside", vertices=500))
    seen = []

    @contextmanager
    def shown(picture):
        assert not (tmp_path / "ball" / "scene.json").exists()
        seen.append(picture)
        yield
        assert (tmp_path / "ball" / "scene.json").exists()

    for _ in range(2):  # the second time there is a scene
        assert api._session(request, Stages(), shown) is not None
    (picture,) = seen
    assert picture.dtype == np.uint8 and np.ptp(picture) > 50
