"""A page that plays frames of splats shows each as our rasteriser draws it, from one file or from files beside it."""

import re
from dataclasses import replace
from threading import Thread

import numpy as np
import pytest
from browser import Browser, chromium
from live_scene import TILT, scene_and_splats

from relight import Environment
from relight.live import played
from relight.live.played import Played, write_player
from relight.live.serve import server_of
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View

NO_WINDOW = "#renderer=webgl&noui&nopanel&sky=0&frame=0"
SIZE = 240

in_browser = pytest.mark.skipif(chromium() is None, reason="chromium is not installed")


def frames():
    """The ball and its plate, then the ball moved and darker, then all brighter with a splat less, then as at first."""
    splats = scene_and_splats()[1]
    ball = splats.means[:, 1] < -0.06  # y down, the scene .25 lower
    moved, dark = splats.means.copy(), splats.sh.copy()
    moved[ball] += np.float32([0.6, 0.0, 0.0])
    dark[ball, 0] -= 0.8
    fewer = replace(splats, sh=splats.sh + np.float32(0.5)).take(np.arange(len(splats)) != 7)
    return [splats, replace(splats, means=moved, sh=dark), fewer, splats]


def about(sky=None):
    return Played(scene_and_splats()[0], sky, 0.7, 5.0, "frames, relit")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("played")
    assert write_player(path, frames(), about()) == ["relit.html"]
    return path


def shown(page, number):
    """The picture of a frame, (H, W, 3) in 0..1."""
    page.run(f"relight.set({{ frame: {number} }})")
    page.wait(f"relight.shown === {number} && relight.settled && !relight.app.renderNextFrame")
    page.run("new Promise((done) => setTimeout(done, 300))")
    return page.picture() / 255.0


def drawn(splats, camera):
    """Our picture of splats by a camera of the page."""
    turn = np.linalg.inv(TILT)
    eye, target = (turn[:3, :3] @ camera[key] + turn[:3, 3] for key in ("position", "target"))
    found = rasterize(splats, View.look_at(eye, target, turn[:3, 1], camera["fov"], SIZE, SIZE))
    return np.clip(found.color + (1 - found.alpha[..., None]) * [0.13, 0.13, 0.14], 0, 1)


def check_pictures(page):
    camera = page.run("relight.camera")
    for number, splats in enumerate(frames()):
        assert -10 * np.log10(np.mean((shown(page, number) - drawn(splats, camera)) ** 2)) > 37


@in_browser
def test_each_frame_is_our_picture_of_its_splats(folder):
    with Browser(f"file://{folder}/relit.html{NO_WINDOW}", (SIZE, SIZE)) as page:
        page.wait("window.relight?.entities?.size === 4")
        check_pictures(page)
        assert page.said == []


@in_browser
def test_frames_beside_the_page_are_fetched_ahead_and_let_go(tmp_path, monkeypatch):
    monkeypatch.setattr(played, "MOST_PACKED", 1000)
    names = write_player(tmp_path, frames(), about())
    assert names[:3] == ["web/index.html", "web/frames.json", "web/0000.compressed.ply"]
    with server_of(tmp_path, 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        with Browser(f"{server.url}{NO_WINDOW}", (SIZE, SIZE)) as page:
            page.wait("window.relight?.entities?.size > 0")
            page.run("relight.ahead = 2")
            check_pictures(page)
            page.wait("relight.entities.size <= 3")
        server.shutdown()


@in_browser
def test_it_plays_stops_and_steps(folder):
    with Browser(f"file://{folder}/relit.html#renderer=webgl&noui", (SIZE, SIZE)) as page:
        page.wait("window.relight?.drawn > 4", 60)  # once around
        for _ in range(2):
            before = page.run("relight.playing")
            for name in ("keyDown", "keyUp"):
                page.call("Input.dispatchKeyEvent", type=name, key=" ", code="Space")
            assert page.run("relight.playing") is not before
        page.run("relight.set({ frame: 3 })")
        for key, number in ((".", 0), (",", 3)):  # past the last comes the first
            page.call("Input.dispatchKeyEvent", type="keyDown", key=key)
            page.wait(f"relight.shown === {number} && relight.settled")
        assert page.run("document.querySelector('#relight output').textContent") == "4/4"
        page.run("document.getElementById('r-play').click()")
        drawn_before = page.run("relight.drawn")
        page.wait(f"relight.drawn > {drawn_before + 1}")
        assert page.said == []


@in_browser
def test_the_light_is_the_sky_behind(tmp_path):
    write_player(tmp_path, frames()[:2], about(Environment.load("noon").rotated(40.0)))
    with Browser(f"file://{tmp_path}/relit.html{NO_WINDOW.replace('sky=0', 'sky=1')}", (SIZE, SIZE)) as page:
        page.wait("window.relight?.entities?.size === 2")
        first = shown(page, 0)
        page.run("relight.set({ sky: false })")
        assert np.abs(first - shown(page, 0))[:20].mean() > 0.05
        assert page.run("relight.turn") == 40.0


def test_what_rests_takes_next_to_nothing(tmp_path):
    sizes = []
    for name, count in (("one", 1), ("nine", 9)):
        (tmp_path / name).mkdir()
        write_player(tmp_path / name, frames()[:1] * count, about())
        sizes.append((tmp_path / name / "relit.html").stat().st_size)
    assert sizes[1] - sizes[0] < 8 * 500
    text = (tmp_path / "nine" / "relit.html").read_text("utf-8")
    assert re.findall(r'"differs": (\w+)', text) == ["false"] + 8 * ["true"]


def test_a_page_replaces_one_of_the_other_form(folder, tmp_path, monkeypatch):
    write_player(tmp_path, frames(), about())
    assert (tmp_path / "relit.html").read_bytes() == (folder / "relit.html").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(played, "MOST_UNPACKED", 1000)
        write_player(tmp_path, frames(), about())
    assert [each.name for each in tmp_path.iterdir()] == ["web"]
    write_player(tmp_path, frames(), about())
    assert [each.name for each in tmp_path.iterdir()] == ["relit.html"]
