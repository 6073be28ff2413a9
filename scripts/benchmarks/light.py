"""Cost and benefit of bands, rays and suns: errors against the full image, and times, for meshes under lights.

Without meshes a table of objects is generated; without lights all built-in skies are used. Errors are relative L2 in
percent over 1,500 vertices against `relight.transfer.reference` with 16,384 directions, of the harmonics alone and with
suns beside them. Times are processor seconds of all threads, for all vertices of the mesh, after a warm-up: transfer
once, split once for a light, suns and product for every angle.
"""

from pathlib import Path

import numpy as np

from benchmarks.harness import relative_error, timed
from benchmarks.shapes import MADE_VERTICES, shape
from relight import Environment
from relight.light.skies import BUILTIN
from relight.light.sun_split import split
from relight.transfer.reference import reference
from relight.transfer.sunlight import sunlight
from relight.transfer.visibility import raytraced_scene

SAMPLES = 1500
DIRECTIONS = 16384
QUICK = ["--vertices", "4000", "--env", "noon", "--bands", "3", "--rays", "64", "--directions", "4096"]
PLOT = {"x": "transfer_s", "y": "suns", "by": ("mesh", "light", "bands")}


def arguments(parser):
    parser.add_argument("meshes", nargs="*", metavar="MESH", default=["tabletop"])
    parser.add_argument("--env", nargs="+", default=list(BUILTIN), metavar="FILE|NAME")
    parser.add_argument("--bands", nargs="+", type=int, default=[3, 5, 8, 10], metavar="B")
    parser.add_argument("--rays", nargs="+", type=int, default=[64, 256], metavar="N")
    parser.add_argument("--vertices", type=int, default=MADE_VERTICES, help="of generated scenes")
    parser.add_argument("--directions", type=int, default=DIRECTIONS, help="of the reference")


def run(options, report):
    lights = {Path(name).stem: Environment.load(name) for name in options.env}
    for name in options.meshes:
        measure(shape(name, options.vertices), lights, options, report)


def measure(mesh, lights, options, report):
    """A row for each light, bands and rays."""
    occluder = mesh.occluder
    raytraced_scene(occluder, 3, 1)  # compiles, and builds the tree
    count = len(occluder.origins)
    sample = np.random.default_rng(5).choice(count, min(SAMPLES, count), replace=False)
    expected = {name: reference(occluder, sample, light, options.directions) for name, light in lights.items()}
    columns = {"light": "<10", "bands": "d", "rays": "d", "plain": ".2f", "suns": ".2f", "lights": "d"}
    columns |= {"transfer_s": ".2f", "split_s": ".2f", "suns_s": ".2f", "product_s": ".3f"}
    table = report.table(f"{mesh.name}: {count:,} vertices; errors in percent, times in seconds", **columns)

    def error(radiance, light):
        """Error in percent, of displayed radiance: not below 0."""
        return 100.0 * relative_error(np.maximum(radiance, 0.0)[sample], expected[light])

    for bands in options.bands:
        for rays in options.rays:
            transfer, _, transfer_s = timed(lambda b=bands, r=rays: raytraced_scene(occluder, b, r))
            for light, environment in lights.items():
                # A new copy without cached results of other bands.
                fresh = Environment(environment.radiance, light)
                (rest, suns), _, split_s = timed(lambda e=fresh, b=bands: split(e, b))
                lit, _, suns_s = timed(lambda s=suns: sunlight(occluder, slice(None), s))
                coefficients = rest.sh(bands).astype(np.float32)
                product, _, product_s = timed(lambda t=transfer, c=coefficients: t @ c)
                table.add(
                    mesh=mesh.name,
                    light=light,
                    bands=bands,
                    rays=rays,
                    plain=error(transfer @ environment.sh(bands), light),
                    suns=error(product + lit, light),
                    lights=len(suns),
                    transfer_s=transfer_s,
                    split_s=split_s,
                    suns_s=suns_s,
                    product_s=product_s,
                )
