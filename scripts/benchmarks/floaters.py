"""Floaters: the share that is found, and how many real splats are removed with them.

In generated gardens, meshed in draft, the kind of every splat is known. SCENE is a folder that splat2mesh made from a
trained place: --blobs blobs are added to the air that its eyes see, and counted. For a capture with gt_mesh.ply beside
its splat, it prints how many of the real splats that are removed lie more than 10 cm from that mesh.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.harness import ROOT
from relight.splats.floaters import floaters
from scenes.capture import FLOATER, LEAF, SKY, SOLID
from splat2mesh import convert
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.meshfile import read_mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import source_splats
from splat2mesh.splats.joining import joined
from splat2mesh.splats.splats import Splats

QUICK = ["--seeds", "1", "--splats", "6000"]
FAR_M, SKYWARD = 0.1, 8.0
"""From a true surface, and how far a way goes that meets none."""


def arguments(parser):
    parser.add_argument("folders", nargs="*", type=Path, metavar="SCENE")
    parser.add_argument("--seeds", type=int, default=6, metavar="N", help="gardens that are generated")
    parser.add_argument("--splats", type=int, default=40_000, metavar="N", help="of each")
    parser.add_argument("--blobs", type=int, default=600, metavar="N", help="blobs to add to each SCENE")


def run(options, report):
    if options.folders:
        columns = {"scene": "<12", "splats": ",d", "taken": ",d", "off_surface": ",d", "found": ".3f", "beyond": ".3f"}
        table = report.table("trained places with added blobs", **columns)
        for folder in options.folders:
            table.add(**trained(folder, options.blobs))
        return
    shares = dict.fromkeys(("floaters", "solid", "leaves", "sky"), ".4f")
    table = report.table("what is taken of generated gardens", seed="<4", **shares)
    for seed in range(1, options.seeds + 1):
        table.add(seed=seed, **generated(seed, options.splats))


def generated(seed, count):
    """Share of each kind of splat of a garden that is taken."""
    with tempfile.TemporaryDirectory() as work:
        command = [sys.executable, "-m", "scenes", work, "--kind", "garden", "--overwrite", "-q", "--env", "noon"]
        subprocess.run([*command, "--seed", str(seed), "--splats", str(count)], check=True, cwd=ROOT)
        splat = Path(work) / "point_cloud" / "iteration_30000" / "point_cloud.ply"
        kinds = np.load(Path(work) / "truth_scene.npz")["splat_region"]
        found = floaters(Splats.load(splat), convert(splat, detail="draft", cameras="none"))
    share = np.bincount(kinds[found], minlength=4) / np.maximum(np.bincount(kinds, minlength=4), 1)
    return {"floaters": share[FLOATER], "solid": share[SOLID], "leaves": share[LEAF], "sky": share[SKY]}


def trained(folder, count):
    """What is taken of a trained place, and the part of blobs in its air; `beyond`: of those past 80% of the way."""
    scene = Scene.load(folder)
    splats, paths = source_splats(scene)
    real, (blobs, share) = floaters(splats, scene), in_the_air(scene, count, splats.sh.shape[1])
    found = np.isin(np.arange(count) + len(splats), floaters(joined([splats, blobs]), scene))
    row = {"scene": folder.name, "splats": len(splats), "taken": len(real), "found": found.mean()}
    row["beyond"] = found[share > 0.8].mean()
    truth = paths[0].parent / "gt_mesh.ply"
    if truth.exists():
        mesh, means = read_mesh(truth), splats.means[real]
        away = np.linalg.norm(RayCaster(mesh.vertices, mesh.faces).closest(means).points - means, axis=1)
        row["off_surface"] = int((away > FAR_M).sum())
    return row


def in_the_air(scene, count, coefficients):
    """Splats between the eyes of a scene and what they see, and how far on that way each is, (N,)."""
    rng, back = np.random.default_rng(0), np.linalg.inv(scene.scene_from_splat)
    eyes = np.asarray(scene.capture["eyes"])[rng.integers(len(scene.capture["eyes"]), size=count)]
    ways = rng.normal(size=(count, 3)) * [1.0, 0.4, 1.0]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    met = RayCaster(scene.vertices, scene.faces).first_hits(np.hstack([eyes, ways]).astype(np.float32)).distance
    share = rng.uniform(0.05, 0.95, count)
    points = eyes + ways * (share * np.where(np.isfinite(met), met, SKYWARD))[:, None]
    scales = rng.uniform(0.01, 0.06, (count, 1)) * np.exp(0.4 * rng.normal(size=(count, 3)))
    sh = np.zeros((count, coefficients, 3), np.float32)
    sh[:, 0] = rng.uniform(-1, 1, (count, 1))
    arrays = points @ back[:3, :3].T + back[:3, 3], scales, rng.normal(size=(count, 4)), rng.uniform(0.05, 0.8, count)
    return Splats(*(np.asarray(each, np.float32) for each in arrays), sh), share
