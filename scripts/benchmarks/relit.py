"""Relit splats against path-traced pictures of known scenes, with the capture light estimated and known.

The data folder holds groundtruth/NAME (point_cloud.ply, env_train.exr, test_views.npz, meta.json) and env/LIGHT.exr;
NAME_rot45 is a light turned by +45 degrees. Without a scene folder NAME among the scenes, one is made. PSNR is the mean
over the test views, over pixels with alpha above 1/2, in sRGB: as written, and with one gain for each colour. "surface"
is without the fit in views. Seconds are processor seconds of all threads.
"""

import json
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.harness import GROUND_TRUTH, timed
from benchmarks.shapes import light_of
from relight import Environment
from relight.albedo import estimate, with_known_light
from relight.light.sun_split import split
from relight.splats import Binding
from relight.transfer.bounces import Interreflection, visible_fraction, with_bounces
from relight.transfer.occluder import Occluder
from relight.transfer.raytraced import raytraced_scene
from relight.transfer.sunlight import sunlight
from relight.transfer.transport import Transport
from scenes.pictures import Pictures
from splat2mesh import convert
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import read_splats

BANDS, RAYS = 5, 256

QUICK = ["spot", "--lights", "1", "--rounds", "1"]


def arguments(parser):
    parser.add_argument("names", nargs="*", metavar="NAME", default=["spot", "tabletop"])
    parser.add_argument("--data", type=Path, default=GROUND_TRUTH)
    parser.add_argument("--scenes", type=Path, default=Path(tempfile.gettempdir()) / "bench_relit")
    parser.add_argument("--rounds", type=int, nargs="+", default=[2])
    parser.add_argument("--lights", type=int, metavar="N", help="the first N lights only")


def run(options, report):
    if not (options.data / "groundtruth").is_dir():
        raise SystemExit(f"{options.data} holds no groundtruth folder: name one with --data")
    for name in options.names:
        measure(name, options, report)


def measure(name, arguments, report):
    truth = arguments.data / "groundtruth" / name
    folder, source = arguments.scenes / name, truth / "point_cloud.ply"
    if not folder.exists():
        convert(source, up="+y").save(folder)
    scene, splats = Scene.load(folder), read_splats(source)
    meta = json.loads((truth / "meta.json").read_text())
    binding, _, bound = timed(lambda: Binding(splats, scene))
    report.note(f"{name}: {len(splats):,} splats, {len(scene.vertices):,} vertices, bound in {bound:.1f} s")
    lights = Lights(scene, meta["exposure"])
    known = Environment.load(truth / "env_train.exr")
    found = {
        "estimated": estimate(lights.occluder, lights.captured, transport=lights.transport),
        "known": with_known_light(lights.occluder, lights.captured, known, transport=lights.transport),
    }
    pictures = Pictures(truth)
    columns = {"light": "<14", "capture": "<10", "splats": "<10", "psnr": ".2f", "psnr_wb": ".2f", "cpu_s": ".1f"}
    table = report.table(**columns)
    for light in meta["lights"]["relight"][: arguments.lights]:
        found_psnr = pictures.score(splats, light)
        row = {"psnr": found_psnr.psnr, "psnr_wb": found_psnr.psnr_wb}
        table.add(scene=name, light=light, capture="-", splats="unchanged", **row)
        environment = light_of(arguments.data / "env", light)
        for way, result in found.items():
            after = lights.irradiance(environment, result.albedo)
            for rounds in (0, *arguments.rounds):
                before = result.irradiance
                relit, _, seconds = timed(lambda b=before, a=after, r=rounds: binding.relit(b, a, rounds=r))
                kind = f"{rounds} rounds" if rounds else "surface"
                found_psnr = pictures.score(relit, light)
                row = {"light": light, "capture": way, "splats": kind}
                row |= {"psnr": found_psnr.psnr, "psnr_wb": found_psnr.psnr_wb}
                table.add(scene=name, **row, cpu_s=seconds)


class Lights:
    """Light on a scene's vertices, in the unit of its captured colours."""

    def __init__(self, scene, exposure):
        self.captured = linear_from_srgb(scene.colors_srgb.astype(np.float32) / np.float32(255))
        self.occluder = Occluder(scene.vertices, scene.normals, scene.faces)
        self._transfer = raytraced_scene(self.occluder, BANDS, RAYS, 0, lambda count: None)
        self.interreflection = Interreflection(self.occluder, visible=visible_fraction(self._transfer))
        self.transport = Transport(self._transfer, self.interreflection)
        self._exposure = exposure

    def irradiance(self, environment, albedo):
        """(V, 3) of the scene in this light, at the exposure of the pictures."""
        rest, suns = split(environment, BANDS)
        direct = self._transfer @ rest.sh(BANDS).astype(np.float32)
        if len(suns):
            direct += sunlight(self.occluder, slice(None), suns, lambda count: None)
        direct = np.maximum(direct, 0) * np.float32(self._exposure)
        radiance, _ = with_bounces(direct, albedo, self.interreflection)
        return direct + self.interreflection.bounce(radiance)
