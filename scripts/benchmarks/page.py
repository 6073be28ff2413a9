"""The page in Chromium: its size, its first picture, the processor time of a moved light, its picture beside ours.

`--bundle` is a folder that `relight --format live` wrote. `--splats` repeats its splats, jittered and smaller, to so
many. `first` is seconds from opening the file to the frame that shows relit splats, the least of `--opened`; `main`
is the processor seconds of the page's own thread until then. Each change is the least of several pairs: processor
milliseconds of the page's thread until the frame has been sent, and of all of Chromium, in which a software renderer
does the work of the graphics card; `drawn` is milliseconds of the clock until the card is done, the median.
`still` is a frame without a change. `--card` takes the graphics card in place of the software renderer.
PSNR is over what shows the scene, and over all, without a sky behind, beside our rasteriser's picture of the splats
that `--relit` names; to be exact, they come from the run that wrote the bundle, since another light may lead to another
estimate of the captured light.
"""

import hashlib
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from relight.live.bundle import write_bundle
from relight.live.page import PAGE, page_of
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.splats.formats.read import read_splats
from splat2mesh.splats.formats.write import write_splats
from splat2mesh.splats.splats import Splats

sys.path.insert(0, str(Path(__file__).parents[2] / "tests/support"))  # which drives the browser

QUICK = ["--times", "2", "--opened", "1", "--side", "120"]

CHANGES = {
    "still": "relight.stage.app.renderNextFrame = true",
    "sun": "relight.set({azimuth: 5 + i % 7, height: 40 + i % 5})",
    "turn": "relight.set({turn: 10 + 5 * (i % 9)})",
    "exposure": "relight.set({exposure: .1 * (i % 5)})",
}

REPEAT = """(async () => {
  const { app } = relight.stage, { gl, wgpu } = app.graphicsDevice, pixel = new Uint8Array(4), times = [];
  const frame = () => new Promise((done) => app.once("frameend", done));
  const done = async () => {
    if (!gl) return wgpu.queue.onSubmittedWorkDone();
    const bound = gl.getParameter(gl.FRAMEBUFFER_BINDING);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);  // which waits, as gl.finish() does not
    gl.bindFramebuffer(gl.FRAMEBUFFER, bound);
  };
  for (let i = FROM; i < FROM + TIMES; i++) {
    await done();
    const start = performance.now();
    CHANGE; await frame(); await done();
    times.push(performance.now() - start);
    await new Promise((next) => setTimeout(next));
  }
  return times;
})()"""

CARD = {
    None: (),
    "gl": ("--use-angle=gl-egl", "--ignore-gpu-blocklist"),
    "vulkan": ("--use-angle=vulkan", "--enable-features=Vulkan", "--disable-vulkan-surface", "--ignore-gpu-blocklist"),
}
UNPACED = ("--disable-frame-rate-limit", "--disable-gpu-vsync", "--enable-unsafe-webgpu")

SHOWN = "new Promise((done) => { let n = 0; const f = () => ++n > 4 ? done() : requestAnimationFrame(f); f(); })"

FIRST = """(() => {
  const look = () => {
    if (!window.relight?.drawn) return setTimeout(look, 2);
    window.relightDrawn = performance.now();
    relight.stage.app.once("frameend", () => { window.relightShown = performance.now(); });
  };
  look();
})()"""

BACKGROUND = np.array([0.13, 0.13, 0.14])


def arguments(parser):
    """Arguments of this subject."""
    parser.add_argument("--bundle", type=Path, help="default: that of a ball above a plate")
    parser.add_argument("--splats", type=int, nargs="*", default=[], help="numbers to repeat the splats to")
    parser.add_argument("--page", type=Path, help="another page of the same bundle instead of this version's")
    parser.add_argument("--times", type=int, default=8, help="changes of each kind")
    parser.add_argument("--opened", type=int, default=3, help="times that the page is opened")
    parser.add_argument("--side", type=int, default=480, help="pixels of the window's sides")
    parser.add_argument("--renderer", default="webgl", choices=["webgl", "webgpu"])
    parser.add_argument("--card", choices=["gl", "vulkan"], help="how Chromium reaches the graphics card")
    parser.add_argument("--more", default="", help="further words of the address, such as &cpu")
    parser.add_argument("--relit", nargs="*", default=[], metavar="LIGHT:DEGREES:FILE")
    parser.add_argument("--eyes", type=int, default=4, help="views that are compared")
    parser.add_argument("--keep", type=Path, help="folder for the pictures, ours on the left")


def run(options, report):
    """One row for each number of splats; then one for each light and view."""
    times = {f"{name}_{who}": ".0f" for name in CHANGES for who in ("main", "all", "drawn")}
    with tempfile.TemporaryDirectory() as folder:
        if options.bundle is None:
            from live_scene import live_scene

            options.bundle = Path(folder) / "live"
            options.bundle.mkdir()
            write_bundle(options.bundle, live_scene()[3])
        table = report.table("time", splats="<9", MB=".2f", first=".2f", main=".2f", **times)
        for count in options.splats or [None]:
            page, number = page_file(options, Path(folder), count)
            table.add(splats=number, MB=page.stat().st_size / 1e6, **timed_page(page, options))
        if options.relit:
            page, _ = page_file(options, Path(folder), None)
            table = report.table("psnr", light="<10", degrees="<7", eye="<4", scene=".2f", all=".2f")
            for row in compared(page, options):
                table.add(**row)


def page_file(options, folder, count):
    """The page of the bundle with so many splats, and their number."""
    meta = json.loads((options.bundle / "live.json").read_text("utf-8"))
    if options.page:
        return options.page, meta["count"]
    names = [meta[key]["file"] for key in ("transfer", "basis", "surface")]
    names += [light["file"] for light in meta["lights"]]
    names += [meta[key]["file"] for key in ("gloss", "ground") if key in meta] + (
        ["terms.bin"] if "terms" in meta else []
    )
    meta["splats"] = [each for each in meta["splats"] if each["file"].endswith("compressed.ply")]
    names.append(meta["splats"][0]["file"])
    contents = {name: (options.bundle / name).read_bytes() for name in [*names, "proxy.glb"]}
    if count:
        repeated(meta, contents, options.bundle, count, folder)
    path = folder / f"{meta['count']}.html"
    path.write_text(page_of(meta, list(contents), contents), "utf-8", "replace")
    return path, meta["count"]


def repeated(meta, contents, bundle, count, folder):
    """Repeat the splats of a bundle to a number, in place: each moved by a part of its size, and as much smaller."""
    splats, rng = read_splats(bundle / "splat.ply"), np.random.default_rng(0)
    of = np.sort(np.arange(count) % len(splats))  # in the order of the file, where neighbours are near
    copies = count / len(splats)
    means = splats.means[of] + 0.5 * splats.scales[of] * rng.standard_normal((count, 3))
    scales = splats.scales[of] / max(copies, 1.0) ** 0.5
    write_splats(
        folder / "x.compressed.ply",
        Splats(means, scales, splats.quats_wxyz[of], splats.opacities[of], splats.sh[of]),
        "compressed.ply",
    )
    entry = meta["splats"][0]
    contents[entry["file"]] = (folder / "x.compressed.ply").read_bytes()
    entry |= {"sha256": hashlib.sha256(contents[entry["file"]]).hexdigest(), "count": count}
    for key in ("transfer", "surface"):
        name, width = meta[key]["file"], meta[key]["bytes"]
        contents[name] = np.frombuffer(contents[name], np.uint8).reshape(-1, width)[of].tobytes()
    meta["count"] = count


def timed_page(page, options):
    """A row of times."""
    from browser import Browser

    url = f"file://{page.resolve()}#renderer={options.renderer}&noui&nopanel&ground=0{options.more}"
    row, opened = {}, []
    for number in range(options.opened):
        with Browser("about:blank", (options.side, options.side), CARD[options.card] + UNPACED) as browser:
            browser.call("Performance.enable", timeDomain="threadTicks")
            browser.call("Page.addScriptToEvaluateOnNewDocument", source=FIRST)
            browser.call("Page.navigate", url=url)
            browser.wait("window.relightShown", 600)
            opened.append((browser.run("relightShown") / 1e3, ticks(browser)))
            if browser.said:
                raise RuntimeError(f"the page said {browser.said}")
            if number + 1 < options.opened:
                continue
            time.sleep(3.0)  # sorted, and all that is ready later
            for name, change in CHANGES.items():
                found, drawn = [], []
                for start in range(0, options.times, 2):
                    script = REPEAT.replace("FROM", str(start)).replace("TIMES", "2").replace("CHANGE", change)
                    before = ticks(browser), processor(browser)
                    drawn += browser.run(script, 600)
                    found.append((ticks(browser) - before[0], processor(browser) - before[1]))
                row |= {f"{name}_{who}": 500 * min(each[k] for each in found) for k, who in enumerate(("main", "all"))}
                row[f"{name}_drawn"] = float(np.median(drawn))
    return row | {"first": min(each[0] for each in opened), "main": min(each[1] for each in opened)}


def ticks(browser):
    """Processor seconds of the page's thread."""
    found = {each["name"]: each["value"] for each in browser.call("Performance.getMetrics")["metrics"]}
    return found["TaskDuration"]


def processor(browser):
    """Processor seconds of Chromium and its processes."""
    parents, used = {}, {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it ended
        pid = int(path.parent.name)
        parents[pid], used[pid] = int(fields[1]), int(fields[11]) + int(fields[12])
    mine, known = {browser._process.pid}, -1
    while len(mine) != known:
        known = len(mine)
        mine |= {pid for pid, parent in parents.items() if parent in mine}
    return sum(used.get(pid, 0) for pid in mine) / os.sysconf("SC_CLK_TCK")


def compared(page, options):
    """Rows of PSNR: the page beside our pictures of relit splats, from eyes all around."""
    from browser import Browser

    text = page.read_text("utf-8")
    start = text.index(">", text.index('id="live-data"')) + 1
    end = text.index("</script>", start)
    data = json.loads(text[start:end])
    meta = data["meta"]
    names, frame = [light["name"] for light in meta["lights"]], np.array(meta["frame"]["scene_from_splat"])
    target, first = (np.array(meta["camera"][key]) for key in ("target", "position"))
    relit = [each.split(":") for each in options.relit]
    splats = {file: read_splats(Path(file)) for _, _, file in relit}
    exposures = {
        file: json.loads(Path(file).with_name("report.json").read_text("utf-8"))["exposure"] for _, _, file in relit
    }
    for eye in range(options.eyes):
        c, s = np.cos(2 * np.pi * eye / options.eyes), np.sin(2 * np.pi * eye / options.eyes)
        place = target + np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ (first - target)
        meta["camera"]["position"] = place.tolist()
        path = page.with_name(f"eye_{eye}.html") if not options.page else Path(tempfile.mkdtemp()) / PAGE
        path.write_text(text[:start] + json.dumps(data).replace("<", "\\u003c") + text[end:], "utf-8", "replace")
        url = f"file://{path.resolve()}#renderer={options.renderer}&noui&nopanel&sky=0&ground=0{options.more}"
        with Browser(url, (options.side, options.side)) as browser:
            browser.wait("window.relight && relight.drawn", 600)
            for light, degrees, file in relit:
                number = names.index(light)
                stops = float(np.log2(exposures[file] / meta["lights"][number]["exposure"]))
                show(browser, {"light": number, "turn": float(degrees), "view": "relit", "exposure": stops})
                found = browser.picture() / 255.0
                camera = browser.run("relight.stage.camera")
                expected, solid = ours(splats[file], frame, camera, options.side)
                row = {"light": light, "degrees": degrees, "eye": str(eye)}
                yield row | psnr((found - expected) ** 2, solid)
                if options.keep:
                    keep(options.keep / f"{light}-{degrees}-{eye}.png", expected, found)
            if browser.said:
                raise RuntimeError(f"the page said {browser.said}")


def show(browser, state):
    """Set the state of the page and wait until it is on the screen."""
    before = browser.run("relight.drawn")
    browser.run(f"relight.set({json.dumps(state)})")
    browser.wait(f"relight.drawn > {before}", 600)
    for _ in range(2):
        browser.run(SHOWN, 600)
        time.sleep(1.0)


def ours(splats, frame, camera, side):
    """Our picture, (H, W, 3) display values, and what shows the scene, (H, W) bool."""
    turn = np.linalg.inv(frame)
    eye, target = (turn[:3, :3] @ camera[key] + turn[:3, 3] for key in ("position", "target"))
    view = View.look_at(eye, target, turn[:3, :3] @ np.array([0.0, 1.0, 0.0]), camera["fov"], side, side)
    drawn = rasterize(splats, view)
    picture = drawn.color + (1 - drawn.alpha[..., None]) * BACKGROUND
    return np.clip(picture, 0, 1), drawn.alpha > 0.5


def psnr(error, solid):
    """Over the scene and over all."""
    return {"scene": float(-10 * np.log10(error[solid].mean())), "all": float(-10 * np.log10(error.mean()))}


def keep(path, expected, found):
    """Write two pictures side by side."""
    import imageio.v3 as iio

    path.parent.mkdir(parents=True, exist_ok=True)
    iio.imwrite(path, np.round(255 * np.concatenate([expected, found], axis=1)).astype(np.uint8))
