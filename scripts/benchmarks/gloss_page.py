"""Glossy tables on the page beside pictures that Mitsuba path-traces: PSNR over glossy pixels.

A table of `scenes.ceramics`, CASE being SEED:LIGHT, is meshed, its light estimated, and the page shows it in Chromium
under a new light. Mitsuba traces the same table with its principled BSDF. PSNR is of display values, with one gain for
each colour in linear light: over pixels that show glossy surfaces, and over the whole table. "matt" is the page without
gloss, "splat" the relit splat, "trained" the same Gaussians with harmonics trained under the new light, which bounds
them all. It needs Chromium, and an LLVM for Mitsuba as `scripts/bench bounces --help` says.
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.gloss import EFFECTS, Table, _balanced
from relight.jobs.writer import Writer
from relight.live.page import PAGE
from scenes.cameras import FLIP
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.color import srgb_from_linear

sys.path.insert(0, str(Path(__file__).parents[2] / "tests/support"))  # which drives the browser

QUICK = ["2:studio", "--splats", "2000", "--vertices", "2500", "--eyes", "1", "--samples", "4", "--side", "64"]

FIELD_DEG, TARGET, REACH = 40.0, np.array([0.0, 0.15, 0.0]), 3.6

FRAMES = "new Promise((done) => { let n = 0; const f = () => ++n > 4 ? done() : requestAnimationFrame(f); f(); })"

METHODS = "matt", "page", "splat", "trained"


def arguments(parser):
    """Arguments of this subject."""
    parser.add_argument("cases", nargs="*", default=["310:studio", "311:noon"], metavar="CASE")
    parser.add_argument("--splats", type=int, default=12_000)
    parser.add_argument("--vertices", type=int, default=12_000)
    parser.add_argument("--relit", nargs="*", default=["sunset"], metavar="LIGHT")
    parser.add_argument("--eyes", type=int, default=2, help="pictures that are compared")
    parser.add_argument("--side", type=int, default=240, help="pixels of their sides")
    parser.add_argument("--samples", type=int, default=256, help="paths of a pixel")
    parser.add_argument("--keep", type=Path, help="folder for the pictures: traced, then the methods")


def run(options, report):
    """Each case: one row for each new light."""
    columns = {f"{name}_{where}": ".2f" for where in ("glossy", "all") for name in METHODS}
    table = report.table("psnr", case="<12", light="<8", **columns)
    with tempfile.TemporaryDirectory() as folder:
        for case in options.cases:
            known = Table(case, options, Path(folder) / case.replace(":", "-"))
            for number, name in enumerate(known.names, start=1):
                table.add(case=case, light=name, **compared(known, number, options, f"{case}-{name}".replace(":", "-")))


def compared(known, number, options, name):
    """PSNR of every method under one of the new lights."""
    light, shown = known.lights[number], {method: [] for method in METHODS}
    job = known.job(light, f"{EFFECTS},gloss", "web")
    writer = Writer(job)
    shaded = next(iter(job.shaded()))
    relit = writer.relit_splats(shaded)
    with tempfile.TemporaryDirectory() as folder:
        writer.write(shaded, Path(folder) / "out")
        page = (Path(folder) / "out" / PAGE).read_text("utf-8")
    truth, glossy, solid = [], [], []
    for view, eye in eyes_of(options):
        traced, hit = path_traced(known.truth, light, eye, options)
        truth.append(traced)
        solid.append(hit)
        glossy.append(known._glossy(view))
        for method, picture in pages(page, np.asarray(job.known.scene.scene_from_splat, np.float64), eye, options):
            shown[method].append(picture)
        for method, splats in (("splat", relit), ("trained", known.splats[number])):
            shown[method].append(np.clip(rasterize(splats, view).color, 0.0, 1.0))
    truth, solid = np.stack(truth), np.stack(solid)
    glossy, row = np.stack(glossy) & solid, {}
    for method, pictures in shown.items():
        picture = np.stack(pictures)
        gained = np.zeros_like(truth)  # black around the table
        gained[solid] = _balanced(picture[solid], truth[solid])
        error = (gained - truth) ** 2
        row[f"{method}_glossy"] = float(-10 * np.log10(error[glossy].mean()))
        row[f"{method}_all"] = float(-10 * np.log10(error[solid].mean()))
        shown[method] = gained
    if options.keep:
        import imageio.v3 as iio

        options.keep.mkdir(parents=True, exist_ok=True)
        rows = [np.concatenate([np.concatenate(list(each)) for each in (truth, *shown.values())], axis=1)]
        iio.imwrite(options.keep / f"{name}.png", np.round(255 * np.concatenate(rows)).astype(np.uint8))
    return row


def eyes_of(options):
    """A View in the frame of the splat and its eye in that of the table, from all around."""
    for turn in 2 * np.pi * (np.arange(options.eyes) + 0.3) / options.eyes:
        eye = TARGET + REACH * np.array([0.8 * np.sin(turn), 0.6, 0.8 * np.cos(turn)])
        yield View.look_at(eye * FLIP, TARGET * FLIP, np.array([0.0, 1.0, 0.0]) * FLIP, FIELD_DEG, options.side), eye


def pages(page, frame, eye, options):
    """The page as Chromium shows it from an eye, with gloss and without: ("page" or "matt", display (H, W, 3)).

    page: its text. frame: (4, 4) scene_from_splat.
    """
    from browser import Browser

    places = {"position": eye, "target": TARGET}
    camera = {key: (frame @ np.append(at * FLIP, 1.0))[:3].tolist() for key, at in places.items()}
    start = page.index(">", page.index('id="live-data"')) + 1
    end = page.index("</script>", start)
    data = json.loads(page[start:end])
    data["meta"]["camera"] = camera | {"fov": FIELD_DEG}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / PAGE
        path.write_text(page[:start] + json.dumps(data).replace("<", "\\u003c") + page[end:], "utf-8", "replace")
        with Browser(f"file://{path}#renderer=webgl&noui&nopanel&sky=0", (options.side, options.side)) as shown:
            shown.wait("window.relight && relight.drawn")
            for method in ("page", "matt"):
                before = shown.run(f"{'0' if method == 'page' else 'relight.bundle.gloss = null; 0'}; relight.drawn")
                shown.run("relight.set({})")
                shown.wait(f"relight.drawn > {before}")
                shown.run(FRAMES)
                yield method, shown.picture() / 255.0


def path_traced(truth, light, eye, options):
    """(H, W, 3) display values before any gain, at most 1, and (H, W) bool, what shows the table."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    parts = {}
    for part in range(int(truth.part.max()) + 1):
        faces = truth.faces[truth.part[truth.faces[:, 0]] == part]
        rows, corners = np.unique(faces, return_inverse=True)
        metal = bool(truth.metal[rows[0]])
        color = (truth.reflectance if metal else truth.albedo_linear)[rows]
        bsdf = {"type": "principled", "base_color": {"type": "mesh_attribute", "name": "vertex_color"}}
        bsdf |= {"roughness": float(np.sqrt(truth.alpha[rows[0]])), "metallic": float(metal)}
        if not metal:
            bsdf["specular"] = float(truth.reflectance[rows[0]].mean()) / 0.08  # reflectance .08 at most, in this model
        if not truth.reflectance[rows[0]].any():
            bsdf = {"type": "diffuse", "reflectance": bsdf["base_color"]}
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict(bsdf)
        mesh = mi.Mesh(f"part{part}", len(rows), len(faces), has_vertex_normals=True, props=properties)
        mesh.add_attribute("vertex_color", 3, np.ascontiguousarray(color, np.float32).ravel())
        held = mi.traverse(mesh)
        held["vertex_positions"] = np.ascontiguousarray(truth.vertices[rows], np.float32).ravel()
        held["vertex_normals"] = np.ascontiguousarray(truth.normals[rows], np.float32).ravel()
        held["faces"] = corners.astype(np.uint32).ravel()
        held.update()
        parts[f"part{part}"] = mesh
    film = {"type": "hdrfilm", "width": options.side, "height": options.side, "rfilter": {"type": "box"}}
    pose = mi.ScalarTransform4f().look_at(eye.tolist(), TARGET.tolist(), [0, 1, 0])
    sensor = {"type": "perspective", "fov": FIELD_DEG, "to_world": pose, "film": film | {"pixel_format": "rgba"}}
    sensor["sampler"] = {"type": "independent", "sample_count": options.samples}
    lit = {"type": "envmap", "bitmap": mi.Bitmap(np.array(light.radiance))}
    scene = mi.load_dict({"type": "scene", "light": lit, "sensor": sensor, **parts})
    image = np.array(mi.render(scene, integrator=mi.load_dict({"type": "path", "max_depth": 8, "hide_emitters": True})))
    exposure = 0.8 / max(float(np.percentile(image[image[..., 3] > 0.99][:, :3].max(axis=1), 98.0)), 1e-9)
    return srgb_from_linear(np.clip(exposure * image[..., :3], 0.0, 1.0)), image[..., 3] > 0.99
