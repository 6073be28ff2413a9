"""Pictures of merged Gaussians against those of all: processor seconds of a picture, and PSNR where the object is.

Each generated scene has harmonics of degree 3, as of `scripts/bench scale`; two views, as texture views see it.
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.harness import timed
from benchmarks.scale import scene
from splat2mesh.render.rasterize import rasterize
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.merging import merged
from splat2mesh.surface.extract import Look, as_trained
from splat2mesh.views.viewpoints import first_views

QUICK = ["2000", "--together", "2", "--pixels", "64"]


def arguments(parser):
    parser.add_argument("sizes", type=int, nargs="*", default=[100_000, 1_000_000], metavar="SPLATS")
    parser.add_argument("--kind", default="object")
    parser.add_argument("--together", type=int, nargs="+", default=[2, 4, 7], metavar="N", help="that become one")
    parser.add_argument("--pixels", type=int, nargs="+", default=[512, 768], metavar="N", help="of the longer side")


def run(options, report):
    columns = {"splats": ",d", "together": "d", "pixels": "d", "seconds": ".3f", "db": ".1f"}
    table = report.table("seconds a picture", **columns)
    with tempfile.TemporaryDirectory() as folder:
        for size in options.sizes:
            splats = read_splats(scene(Path(folder), options.kind, size, 3)).in_spatial_order()
            shown, pixel = as_trained(splats)
            views = first_views(shown, 64, options.pixels[0], np.array([0.0, -1.0, 0.0]), 0)[:2]
            near = float(Look.around(shown, pixel, views).near[0])
            for pixels in options.pixels:
                sized, whole = [view.resized(pixels) for view in views], []
                for together in (1, *options.together):
                    drawn = shown if together == 1 else merged(shown, together)
                    found, _, cpu = timed(lambda d=drawn, v=sized, n=near: [rasterize(d, view, n) for view in v])
                    whole = whole or found
                    off = np.concatenate(
                        [(a.color - b.color)[b.alpha > 0.5] for a, b in zip(found, whole, strict=True)]
                    )
                    db = -10.0 * np.log10(max(float(np.square(off).mean()), 1e-12))
                    table.add(splats=size, together=together, pixels=pixels, seconds=cpu / len(sized), db=db)
