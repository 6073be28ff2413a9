"""Scenes with a known answer under other lights, trained and generated, for benchmarks of relit splats.

Trained ones lie in groundtruth/NAME of a data folder (point_cloud.ply, env_train.exr, test_views.npz, meta.json), with
path-traced pictures. Generated ones are places of `scenes`, made where they are missing: their truth is the same splats
in the true colours.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.harness import ROOT
from benchmarks.shapes import light_of
from relight import Environment
from scenes.capture import SKY
from scenes.pictures import Pictures
from scenes.sky import capture_sky
from splat2mesh import convert
from splat2mesh.render.rasterize import rasterize
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.splats import Splats
from splat2mesh.views.cameras import usable_views

VIEWS, WIDTH = 8, 160
"""Number of a generated place's capture views to compare, and their width in pixels."""


class Truth(NamedTuple):
    """name. source: path of the splat file. folder: of its mesh. captured_in: Environment of the capture. lights: name
    -> Environment. pictures: of the truth under each, as of Pictures."""

    name: str
    source: Path
    folder: Path
    captured_in: Environment
    lights: dict
    pictures: object


def trained(name, data, scenes):
    """The Truth of a trained scene of a data folder, with its mesh among the scenes, made where it is missing."""
    truth, folder = data / "groundtruth" / name, scenes / name
    if not folder.exists():
        convert(truth / "point_cloud.ply", up="+y", texture="none").save(folder)
    names = json.loads((truth / "meta.json").read_text())["lights"]["relight"]
    lights = {light: light_of(data / "env", light) for light in names}
    captured_in = Environment.load(truth / "env_train.exr")
    return Truth(name, truth / "point_cloud.ply", folder, captured_in, lights, Pictures(truth))


def generated(kind, seed, sky, names, scenes, splats=50_000, data=None, detail="normal"):
    """The Truth of a generated place, made where it is missing.

    sky, names: lights of its capture and beyond, each a built-in sky, `cloudy`, or NAME.exr in the data's env.
    """
    name = f"{kind}{seed}-{sky}-{splats // 1000}k"
    made, folder = scenes / f"{name}.made", scenes / name
    if not (made / "truth.json").exists():
        words = ["--kind", kind, "--seed", str(seed), "--env", str(_sky(sky, data)), "--splats", str(splats)]
        words += [word for each in names for word in ("--relit", str(_sky(each, data)))]
        subprocess.run([sys.executable, "-m", "scenes", made, "-q", *words], check=True, cwd=ROOT)
    source = made / "point_cloud" / "iteration_30000" / "point_cloud.ply"
    if not folder.exists():
        convert(source, detail=detail, texture="none").save(folder)
    lights = {each: capture_sky(_sky(each, data)) for each in names}
    return Truth(name, source, folder, capture_sky(_sky(sky, data)), lights, TruePictures(made, source))


def _sky(name, data):
    """A built-in name as it is, others as a file of the data folder."""
    path = None if data is None else data / "env" / f"{name}.exr"
    return name if path is None or not path.exists() else path


class TruePictures:
    """Pictures of the splats of a generated place in their true colours, and how near others come to them.

    views: those compared. Pixels count where what is no sky covers more than half.
    """

    def __init__(self, made, source):
        self._made, self._splats = made, read_splats(source)
        views = usable_views(made / "cameras.json")
        self.views = [view.resized(WIDTH) for view in views[1 :: max(1, len(views) // VIEWS)][:VIEWS]]
        solid = self._splats.take(np.load(made / "truth_scene.npz")["splat_region"] != SKY)
        self._inside = [rasterize(solid, view).alpha > 0.5 for view in self.views]

    def colors(self, splats):
        """sRGB (P, 3) of every view that splats show, clipped, where the place is."""
        pairs = zip(self.views, self._inside, strict=True)
        return [np.clip(rasterize(splats, view).color[inside], 0, 1) for view, inside in pairs]

    def pixels(self, splats, light):
        """As for Pictures."""
        s = self._splats
        true = Splats(
            s.means, s.scales, s.quats_wxyz, s.opacities, np.load(self._made / f"truth_{light}.npz")["splat_sh"]
        )
        return [linear_from_srgb(each) for each in self.colors(splats)], self.colors(true)


def clipped(colors, least=254.5):
    """Percentage of pixels, a list of (P, 3) sRGB, whose brightest channel is at least `least`, 0 to 255."""
    return 100.0 * float(np.mean(np.concatenate(colors).max(axis=1) >= least / 255.0))
