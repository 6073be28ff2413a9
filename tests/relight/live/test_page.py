import base64
import gzip
import json
import re
import urllib.request
from threading import Thread

import numpy as np
import OpenEXR
import pytest
from browser import Browser, chromium
from live_scene import TILT, live_scene

from relight.cli import main
from relight.live.page import write_page
from relight.live.serve import server_of
from splat2mesh.base.errors import InputError
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View

NO_WINDOW = "#renderer=webgl&noui&nopanel&sky=0"

FRAMES = "() => new Promise((done) => { let n = 0; const f = () => ++n > 4 ? done() : requestAnimationFrame(f); f(); })"

in_browser = pytest.mark.skipif(chromium() is None, reason="chromium is not installed")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("page")
    assert write_page(path, live_scene()[3]) == ["relit.html"]
    return path


@pytest.fixture(scope="module")
def page(folder):
    with Browser(f"file://{folder}/relit.html{NO_WINDOW}", (320, 240)) as browser:
        browser.wait("window.relight && relight.drawn")
        yield browser


def shown(page, **state):
    """The picture, (H, W, 3) in 0..1, after a change of the page's state."""
    before = page.run("relight.drawn")
    page.run(f"relight.set({json.dumps(state)})")
    page.wait(f"relight.drawn > {before}")
    page.run(f"({FRAMES})()")
    return page.picture() / 255.0


@in_browser
def test_the_page_opens_from_a_file_and_says_nothing(page):
    assert page.said == []
    assert page.run("relight.lights.map(({ name }) => name)") == ["overcast", "noon", "capture"]


@in_browser
@pytest.mark.parametrize("size", [(640, 360), (300, 520)])
def test_an_object_fills_the_window_and_the_key_f_comes_back_to_that(folder, size):
    with Browser(f"file://{folder}/relit.html{NO_WINDOW}", size) as browser:
        browser.wait("window.relight && relight.drawn")
        start = shown(browser, view="captured")
        assert 0.8 < filled(start) < 0.98
        middle = {"x": size[0] / 2, "y": size[1] / 2}
        browser.call("Input.dispatchMouseEvent", type="mouseWheel", deltaX=0, deltaY=-600, **middle)
        browser.run("new Promise((done) => setTimeout(done, 1500))")
        assert np.abs(shown(browser) - start).mean() > 0.02
        for name in ("keyDown", "keyUp"):
            browser.call("Input.dispatchKeyEvent", type=name, key="f", code="KeyF")
        browser.run("new Promise((done) => setTimeout(done, 3000))")
        assert 0.8 < filled(shown(browser, view="captured")) < 0.98


def filled(picture):
    """The larger share of the window's sides that is not background, whose outermost pixels are free."""
    shown_at = np.abs(picture - [0.13, 0.13, 0.14]).max(axis=2) > 0.05
    spans = [np.flatnonzero(shown_at.any(axis=axis)) for axis in (0, 1)]
    assert all(0 < span[0] and span[-1] < size - 1 for span, size in zip(spans, shown_at.shape[::-1], strict=True))
    return max(np.ptp(span) / size for span, size in zip(spans, shown_at.shape[::-1], strict=True))


@in_browser
def test_where_nothing_changes_the_splat_is_as_captured(page):
    captured = shown(page, view="captured")
    assert captured.std() > 0.05
    albedo = shown(page, view="albedo")  # all white on the capture day: albedo is what was captured
    assert -10 * np.log10(np.mean((captured - albedo) ** 2)) > 38


@in_browser
def test_as_captured_the_page_is_our_picture_of_the_splat(folder):
    """The viewer as published widens what is small on screen by a fourth of what training does."""
    packed = re.search(r'data-file="viewer" data-gzip>([^<]*)<', (folder / "relit.html").read_text("utf-8"))[1]
    text = gzip.decompress(base64.b64decode(packed)).decode()
    assert [text.count(each) for each in ("cov[0][0] + 1.2;", "cov[1][1] + 1.2;", "aRaw + 1.2;", "cRaw + 1.2;")] == [
        2,
        2,
        1,
        1,
    ]
    assert not any(each in text for each in ("cov[0][0] + 0.3;", "cov[1][1] + 0.3;", "aRaw + 0.3;", "cRaw + 0.3;"))
    with Browser(f"file://{folder}/relit.html{NO_WINDOW}", (240, 240)) as browser:
        browser.wait("window.relight && relight.drawn")
        found = shown(browser, view="captured")
        camera = browser.run("relight.stage.camera")
    frame, splats = TILT, live_scene()[3].splats
    turn = np.linalg.inv(frame)
    eye, target = (turn[:3, :3] @ camera[key] + turn[:3, 3] for key in ("position", "target"))
    drawn = rasterize(splats, View.look_at(eye, target, turn[:3, 1], camera["fov"], 240, 240))
    expected = np.clip(drawn.color + (1 - drawn.alpha[..., None]) * [0.13, 0.13, 0.14], 0, 1)
    assert -10 * np.log10(np.mean((found - expected) ** 2)) > 38


@in_browser
@pytest.mark.parametrize(("angle", "side"), [(90.0, 1), (270.0, -1)])
def test_one_lit_texel_lights_the_side_it_is_on(page, angle, side):
    """A lamp at +z, turned to +x or -x: the camera looks from +z, and +x is to the right."""
    page.run("""(() => {
      const image = new Float32Array(64 * 128 * 3);
      image.fill(40, (28 * 128 + 64) * 3, (28 * 128 + 64) * 3 + 3);
      const rest = relight.live.project(image);
      relight.lights.push({ name: "texel", image, suns: [], mean: 1, exposure: 20, rest, whole: rest.subarray(0, 48) });
    })()""")
    number = page.run("relight.lights.length - 1")
    ball = shown(page, light=number, turn=angle, view="relit")
    rows, columns = np.nonzero(np.abs(shown(page, view="captured") - 0.13).max(axis=2) > 0.05)
    top = rows < np.percentile(rows, 30)  # the ball stands above the plate
    middle = np.median(columns[top])
    light = ball.sum(axis=2)
    right = light[rows[top & (columns > middle)], columns[top & (columns > middle)]].mean()
    left = light[rows[top & (columns < middle)], columns[top & (columns < middle)]].mean()
    assert (right - left) * side > 0.15


@in_browser
def test_keys_and_dragging_turn_the_light(page):
    shown(page, light=0, turn=0, view="relit")
    for name in ("keyDown", "keyUp"):
        page.call(
            "Input.dispatchKeyEvent", type=name, key="]", code="BracketRight", text="]" if name == "keyDown" else ""
        )
    assert page.run("relight.state.turn") == 5
    for name, x in (("mousePressed", 100), ("mouseMoved", 180), ("mouseReleased", 180)):
        page.call(
            "Input.dispatchMouseEvent", type=name, x=x, y=120, button="left", buttons=1, clickCount=1, modifiers=8
        )
    assert page.run("relight.state.turn") == 45


@in_browser
def test_a_part_is_painted_and_lit_apart(folder):
    """Its light is off at the end: the ball is as captured there, and all else is not."""
    with Browser(f"file://{folder}/relit.html{NO_WINDOW}", (320, 240)) as page:
        page.wait("window.relight && relight.drawn")
        captured, relit = shown(page, view="captured"), shown(page, light=1, view="relit", exposure=1.5)
        page.run("document.getElementById('r-new').click()")
        for name, x in (("mousePressed", 170), ("mouseMoved", 186), ("mouseReleased", 186)):
            page.call("Input.dispatchMouseEvent", type=name, x=x, y=60, button="left", buttons=1, clickCount=1)
        painted = shown(page)
        page.run("document.getElementById('r-paint').click()")
        off = shown(page, parts=[{"on": on, "ev": 0, "color": "#ffffff"} for on in (True, False)])
        rows = page.run("Array.from(relight.bundle.parts.members)")[::2]
        mask = bytes(page.run("Array.from(relight.partFiles()['part1.npy'])"))
        assert not page.said
    assert 20 < sum(rows) < 1500
    (tmp := folder / "part1.npy").write_bytes(mask)
    assert np.array_equal(np.load(tmp)[live_scene()[3].order], np.array(rows) == 1)
    under = np.s_[50:70, 168:188]
    assert (painted - relit)[under].mean(axis=(0, 1)) @ [1, -1, -1] > 0.05  # marked
    assert np.abs(off - captured)[under].mean() < np.abs(relit - captured)[under].mean() / 2
    assert np.abs(off - relit)[150:].mean() < 0.01


@in_browser
@pytest.mark.parametrize(("light", "display"), [(0, "none"), (1, "grid")])
def test_a_light_without_a_sun_has_no_sun_to_move(page, light, display):
    """Overcast has none, noon has one."""
    shown(page, light=light, view="relit")
    assert page.run("relight.suns().length") == (display == "grid")
    for key in ("sun", "azimuth", "height"):
        label = f"document.getElementById('r-{key}').parentElement"
        assert page.run(f"getComputedStyle({label}).display") == display


@in_browser
def test_a_warmer_captured_light_leaves_a_cooler_scene(page):
    """One step of tint: red over blue of the captured light doubles, so that of the relit scene halves."""
    changes = []
    for tint in (0, 1):
        shown(page, light=0, turn=0, view="relit", exposure=-3, tint=tint)  # dark: nothing runs into white
        lit = (
            "Array.from(relight.ratio).filter((_, i) => (relight.bundle.surface[8 * Math.floor(i / 3) + 7] & 3) === 1)"
        )
        changes.append(np.array(page.run(lit)).reshape(-1, 3))
    shown(page, tint=0, exposure=0)
    factor = np.median(changes[1] / np.maximum(changes[0], 1e-9), axis=0)
    assert factor[2] / factor[0] == pytest.approx(2.0, rel=1e-3)
    assert factor @ [0.2126, 0.7152, 0.0722] == pytest.approx(1.0, rel=1e-3)


@in_browser
def test_before_and_after_stand_side_by_side(page):
    before, after = shown(page, view="captured"), shown(page, light=1, view="relit", exposure=1.5)
    both = shown(page, compare=True, line=0.5)
    both = shown(page)
    shown(page, compare=False, exposure=0)
    apart = np.abs(before - after).mean()
    assert apart > 0.02
    assert np.abs(both - before)[:, :150].mean() < apart / 5
    assert np.abs(both - after)[:, 170:].mean() < apart / 5


@in_browser
def test_the_sky_is_the_environment_and_turns_with_it(page):
    shown(page, light=1, view="relit", turn=0)
    first, turned = shown(page, sky=True), shown(page, turn=180)
    plain = shown(page, sky=False)
    assert np.abs(first - plain)[:20].mean() > 0.05
    assert np.abs(first - turned)[:20].mean() > 1e-3


@in_browser
def test_a_dropped_exr_lights_the_page_and_others_are_refused(page, tmp_path):
    """Packed by PIZ, as most published lights are. What is not twice as wide as high is no lat-long picture."""
    for name, size in (("sky", (64, 32)), ("cross", (48, 64))):
        picture = np.zeros((size[1], size[0], 3), np.float32)
        picture[size[1] // 4] = [3.0, 2.0, 1.0]
        header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"RGB": picture}).write(str(tmp_path / f"{name}.exr"))
        content = base64.b64encode((tmp_path / f"{name}.exr").read_bytes()).decode()
        page.run(f"""(() => {{
          const data = new DataTransfer(), bytes = Uint8Array.from(atob("{content}"), (c) => c.charCodeAt(0));
          data.items.add(new File([bytes], "{name}.exr"));
          document.dispatchEvent(new DragEvent("drop", {{ bubbles: true, dataTransfer: data }}));
        }})()""")
        if name == "sky":
            page.wait("relight.lights.at(-1).name === 'sky' && relight.state.light === relight.lights.length - 1")
            assert page.run("document.getElementById('relight-message').textContent") == ""
    page.wait("document.getElementById('relight-message').textContent")
    said = page.run("document.getElementById('relight-message').textContent")
    assert said == "cross.exr: a picture of 48 x 64: expected a lat-long light, twice as wide as high"
    assert page.run("relight.lights.at(-1).name") == "sky"
    page.run("relight.notify('')")


@in_browser
def test_the_address_keeps_what_is_shown(folder):
    with Browser(f"file://{folder}/relit.html{NO_WINDOW}", (320, 240)) as browser:
        browser.wait("window.relight && relight.drawn")
        shown(browser, light=1)
        shown(browser, turn=30, exposure=0.5, sun=1.25, view="albedo")
        browser.wait("location.hash.includes('turn=30')")
        kept = browser.run("location.hash")
        assert "noui" in kept and "tint" not in kept  # what is as it began is left out
        browser.call("Page.reload")
        browser.wait("window.relight && relight.drawn && relight.state.turn === 30")
        state = browser.run("relight.state")
    assert [state[key] for key in ("light", "exposure", "sun", "view", "tint")] == [1, 0.5, 1.25, "albedo", 0]


@in_browser
def test_the_strip_shows_the_sky_turned_and_where_the_camera_looks(page):
    """Two texels are bright to the south, +z: in the middle, and further left once turned east."""
    page.run("""(() => {
      const image = new Float32Array(64 * 128 * 3);
      image.fill(1, (20 * 128 + 63) * 3, (20 * 128 + 65) * 3);
      const rest = relight.live.project(image);
      relight.lights.push({ name: "south", image, suns: [], mean: 1, exposure: 1, rest, whole: rest.subarray(0, 48) });
    })()""")
    number = page.run("relight.lights.length - 1")
    brightest = """(() => {
      const { width, height } = document.getElementById("r-strip"), row = Math.floor(height * 20.5 / 64);
      const { data } = document.getElementById("r-strip").getContext("2d").getImageData(0, row, width, 1);
      const found = Array.from({ length: width }, (_, x) => x).filter((x) => data[4 * x] > 250);
      return found.reduce((sum, x) => sum + x + 0.5, 0) / found.length / width;
    })()"""
    for turn, place in ((0, 0.5), (90, 0.25)):
        shown(page, light=number, turn=turn, view="relit", exposure=3)
        assert page.run(brightest) == pytest.approx(place, abs=0.02)  # a texel is 0.008, the camera's line may join
    shown(page, light=0, turn=0, exposure=0)


@in_browser
def test_a_broken_hdr_is_reported_on_the_page(page):
    page.run("""(() => {
      const data = new DataTransfer();
      data.items.add(new File(["nothing"], "x.hdr"));
      dispatchEvent(new DragEvent("drop", { dataTransfer: data, cancelable: true }));
    })()""")
    page.wait("document.getElementById('relight-message').style.display === 'block'")
    assert "x.hdr: not a Radiance .hdr" in page.run("document.getElementById('relight-message').textContent")


@in_browser
def test_a_page_with_another_splat_says_so_and_shows_none(folder, tmp_path):
    text = (folder / "relit.html").read_text("utf-8")
    (tmp_path / "x.html").write_text(re.sub(r'"sha256": "\w', '"sha256": "x', text), "utf-8")
    with Browser(f"file://{tmp_path}/x.html{NO_WINDOW}", (320, 240)) as browser:
        browser.wait("document.getElementById('relight-message')?.style.display === 'block'")
        assert "is not the splat of this bundle" in browser.run(
            "document.getElementById('relight-message').textContent"
        )


@in_browser
def test_a_folder_is_served_to_this_machine_and_shows(tmp_path):
    names = write_page(tmp_path, live_scene()[3], most=100)
    assert "web/index.html" in names and "web/transfer.bin" in names
    with server_of(tmp_path, 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        with Browser(f"{server.url}{NO_WINDOW}", (320, 240)) as browser:
            browser.wait("window.relight && relight.drawn")
            assert browser.picture().std() > 10
        server.shutdown()


def test_the_server_gives_the_folder_alone(tmp_path):
    write_page(tmp_path, live_scene()[3], most=100)
    (tmp_path / "secret.txt").write_text("x")
    with server_of(tmp_path / "web", 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        assert server.server_address[0] == "127.0.0.1"
        assert json.load(urllib.request.urlopen(f"{server.url}live.json"))["format"] == "relight-live"
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(f"{server.url}../secret.txt")
        server.shutdown()


def test_a_page_in_one_file_is_served_and_no_other_result(folder, tmp_path):
    (tmp_path / "relit.html").write_bytes((folder / "relit.html").read_bytes())
    (tmp_path / "secret.txt").write_text("x")
    with server_of(tmp_path, 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        for path in ("", "relit.html"):
            assert urllib.request.urlopen(server.url + path).read() == (folder / "relit.html").read_bytes()
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(f"{server.url}secret.txt")
        server.shutdown()


def test_a_folder_without_a_page_is_refused(tmp_path, capsys):
    assert main([str(tmp_path), "--serve"]) == 2
    assert "holds no page to serve" in capsys.readouterr().err
    write_page(tmp_path, live_scene()[3], most=100)
    with pytest.raises(InputError, match="cannot use the port"):
        server_of(tmp_path, 70000)


def test_the_same_scene_gives_the_same_page(folder, tmp_path):
    write_page(tmp_path, live_scene()[3])
    assert (tmp_path / "relit.html").read_bytes() == (folder / "relit.html").read_bytes()
