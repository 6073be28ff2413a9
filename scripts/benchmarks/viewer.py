"""Does a splat file look the same in an independent viewer? PlayCanvas' HTML viewer in Chromium against our rasteriser.

Needs node with `npm install @playcanvas/splat-transform puppeteer-core`: the one reads the file and writes the viewer,
the other has a Chromium draw it, with software GL. Both are compared without view-dependent colour: the viewer's
compression of it needs a GPU. The viewer's camera looks at the splat turned by Rz(180), as it shows every file; its
compression of the rest rounds places and colours. Prints the PSNR of the screenshot, over all and where alpha is above
1/2, and, as a scale, of the screenshot mirrored; writes ours.png, viewer.png and viewer.html.
"""

import json
import os
import subprocess
import tempfile
from pathlib import Path

import imageio.v3 as imageio
import numpy as np

from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.splats.cleaning import clean
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.splats import Splats
from splat2mesh.views.viewpoints import bounds_of

VIEWER_FROM_SPLAT = np.array([-1.0, -1.0, 1.0])  # Rz(180)
FOV_DEG = 50.0
BACKWARD = np.array([0.8, 0.5, -0.7])  # from the target to the eye, viewer frame, y up
FLAGS = "--no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --allow-file-access-from-files"
PHOTOGRAPHER = f"""
const [browser, size, url, picture, wait] = process.argv.slice(1);
(async () => {{
    const args = '{FLAGS}'.split(' ');
    const chromium = await require('puppeteer-core').launch({{ executablePath: browser, headless: true, args }});
    const page = await chromium.newPage();
    await page.setViewport({{ width: +size, height: +size }});
    await page.goto(url);
    await new Promise(resolve => setTimeout(resolve, +wait));
    await page.screenshot({{ path: picture }});
    await chromium.close();
}})().catch(error => {{ console.error(error); process.exit(1); }});
"""


QUICK = ["--size", "64"]


def arguments(parser):
    parser.add_argument("splat", type=Path)
    parser.add_argument("--out", type=Path, default=None)
    parser.add_argument("--modules", type=Path, default=Path("node_modules"))
    parser.add_argument("--browser", default="/usr/bin/chromium")
    parser.add_argument("--up", choices=["+y", "-y"], default="-y", help="of the splat: from which side to look at it")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--wait", type=int, default=20000, help="milliseconds until the screenshot")


def run(options, report):
    if not (options.modules / ".bin" / "splat-transform").exists():
        raise SystemExit(
            f"{options.modules} holds no splat-transform: npm install @playcanvas/splat-transform puppeteer-core"
        )
    out = options.out or Path(tempfile.mkdtemp())
    out.mkdir(parents=True, exist_ok=True)
    splats, _ = clean(read_splats(options.splat))
    splats = Splats(splats.means, splats.scales, splats.quats_wxyz, splats.opacities, splats.sh[:, :1])
    bounds = bounds_of(splats)
    target = bounds.mean(axis=0)
    above = BACKWARD * [1, -1 if options.up == "+y" else 1, 1]
    eye = target + VIEWER_FROM_SPLAT * above * 1.3 * np.linalg.norm(np.ptp(bounds, axis=0))
    size = options.size
    shown = photograph(options, out, eye * VIEWER_FROM_SPLAT, target * VIEWER_FROM_SPLAT)
    view = View.look_at(eye, target, VIEWER_FROM_SPLAT * [0, 1, 0], FOV_DEG, size)
    rendering = rasterize(splats, view)
    ours, drawn = np.clip(rendering.color, 0, 1), rendering.alpha > 0.5
    imageio.imwrite(out / "ours.png", np.round(ours * 255).astype(np.uint8))
    report.note(f"mean ours {ours.mean():.4f}, viewer {shown.mean():.4f}; written to {out}")
    report.note(f"PSNR {psnr(ours, shown):.2f} dB, of what is drawn {psnr(ours[drawn], shown[drawn]):.2f}")
    report.note(f"mirrored {psnr(ours[drawn], shown[:, ::-1][drawn]):.2f}")


def photograph(options, out, eye, target):
    """The viewer's screenshot of the splat, (size, size, 3) in [0, 1]; eye and target in its own frame."""
    size, page = options.size, out / "viewer.html"
    camera = {"position": eye.tolist(), "target": target.tolist(), "fov": FOV_DEG}
    settings = {
        "version": 2,
        "tonemapping": "none",
        "highPrecisionRendering": False,
        "background": {"color": [0, 0, 0]},
        "postEffectSettings": {
            "sharpness": {"enabled": False, "amount": 0},
            "bloom": {"enabled": False, "intensity": 1, "blurLevel": 2},
            "grading": {"enabled": False, "brightness": 0, "contrast": 1, "saturation": 1, "tint": [1, 1, 1]},
            "vignette": {"enabled": False, "intensity": 0.5, "inner": 0.3, "outer": 0.75, "curvature": 1},
            "fringing": {"enabled": False, "intensity": 0.5},
        },
        "animTracks": [],
        "cameras": [{"initial": camera}],
        "annotations": [],
        "startMode": "default",
    }
    (out / "settings.json").write_text(json.dumps(settings))
    source, transform = str(options.splat), options.modules / ".bin" / "splat-transform"
    command = [
        str(transform),
        "-w",
        "-q",
        "-g",
        "cpu",
        "-E",
        str(out / "settings.json"),
        source,
        "-H",
        "0",
        str(page),
    ]
    subprocess.run(command, check=True, timeout=300)
    picture = out / "viewer.png"
    url = f"file://{page.resolve()}?webgl&noui&noanim&nofx&fullload"
    command = ["node", "-e", PHOTOGRAPHER, options.browser, str(size), url, str(picture), str(options.wait)]
    environment = os.environ | {"NODE_PATH": str(options.modules.resolve())}
    subprocess.run(command, check=True, timeout=600, env=environment)
    return imageio.imread(picture)[..., :3].astype(np.float64) / 255


def psnr(a, b):
    return -10 * np.log10(np.square(a - b).mean())
