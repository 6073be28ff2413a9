"""Fit how far a click reaches by itself: generated scenes know what each of their vertices is a part of.

Scenes are laid out as splats, meshed, and their captured light removed, as for a session. Clicks fall on every part
that is large enough; what grows is compared with the part by intersection over union of areas. The mean over clicks,
then over scenes, chooses the reach on one half of the scenes; the other half is only scored.
"""

import json
from pathlib import Path

import numpy as np

REACHES = [round(0.03 * 2 ** (step / 3), 3) for step in range(14)]
"""Tried, .03 to .6."""

SCENES = {
    "fit": {"tabletop": (1, 2), "still-life": (1, 2), "machine": (1,), "garden": (3, 5), "courtyard": (1,)},
    "test": {"tabletop": (3, 4), "still-life": (3, 4), "machine": (2,), "garden": (8, 11), "street": (1,)},
}
"""Kinds and their seeds: odd ones under the sun of `noon`, even ones under `overcast`."""

SPLATS, VERTICES = 60_000, 40_000
"""Of each scene, and of its mesh."""

SAMPLES = 400_000
"""Points on the true surface, of which the nearest names the part of a vertex."""

CLICKS, LEAST = 4, 0.002
"""On each part that has at least this share of the area."""


def made(folder, kind, seed):
    """(GrowingSurface, truth (M,), areas (M,), points (M, 3)) of a scene, by the nodes of its surface."""
    from relight import RelightRequest
    from relight.jobs.job import Job
    from relight.splats.attachment import Surface
    from relight.splats.grown_part import GrowingSurface
    from scenes.__main__ import main as write
    from splat2mesh import mesh_files
    from splat2mesh.scene.meshfile import read_mesh
    from splat2mesh.splats.formats.ply import Ply

    out = Path(folder) / f"{kind}{seed}"
    if not out.exists():
        words = [
            f"--kind={kind}",
            f"--seed={seed}",
            f"--splats={SPLATS}",
            f"--env={'noon' if seed % 2 else 'overcast'}",
        ]
        if write([str(out), *words, "-q"]):
            raise RuntimeError(f"{out} was not written")
    if not (out / "mesh" / "scene.json").is_file():
        trained = out / "point_cloud" / "iteration_30000" / "point_cloud.ply"
        splat = trained if trained.is_file() else out / "splat.ply"
        up = "auto" if splat is trained else "-y"
        mesh_files(splat, out / "mesh", detail="draft", texture="none", up=up, vertices=VERTICES)
    job = Job(RelightRequest(str(out / "mesh"), "noon", formats=("npy",)))
    scene, look = job.known.scene, job.known.appearance
    surface = Surface(scene)
    grows = GrowingSurface(surface, scene.colors_linear if look.albedo is None else look.albedo)
    mesh, part = read_mesh(out / "truth.ply"), Ply.open(out / "truth.ply").rows("vertex")["part"]
    turn = np.array(json.loads((out / "truth.json").read_text("utf-8"))["scene_from_splat"])[:3, :3]
    places = mesh.vertices.astype(np.float64) @ turn
    return grows, surface, _parts(surface.points, places, mesh.faces, part)


def _parts(points, places, faces, part):
    """The part (M,) of points: that of the nearest of SAMPLES on the faces."""
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(0)
    a, b, c = places[faces.T]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = rng.choice(len(faces), SAMPLES, p=area / area.sum())
    share = rng.dirichlet((1, 1, 1), SAMPLES)
    sampled = np.einsum("nk,nkd->nd", share, places[faces[face]])
    return part[faces[face, 0]][cKDTree(sampled).query(points)[1]]


def scores(folder, kind, seed):
    """(R,) mean intersection over union of every reach on a scene, and the number of clicks."""
    grows, surface, part = made(folder, kind, seed)
    rng, areas, found = np.random.default_rng(seed), surface.areas * surface.used, []
    for name in np.unique(part):
        own = (part == name) & surface.used
        if areas[own].sum() < LEAST * areas.sum():
            continue
        for row in rng.choice(np.flatnonzero(own), CLICKS, p=areas[own] / areas[own].sum()):
            unions = []
            for reach in REACHES:
                grown = np.zeros(len(part), bool)
                grown[surface.node] = grows.grown(surface.points[row], reach)
                unions.append(areas[grown & own].sum() / areas[grown | own].sum())
            found.append(unions)
    return np.mean(found, axis=0), len(found)


def fit(folder, say=print):
    """The best reach on the scenes to fit; says it, and what it does on the others."""
    means = {}
    for half, kinds in SCENES.items():
        rows = []
        for kind, seed in [(kind, seed) for kind, seeds in kinds.items() for seed in seeds]:
            unions, clicks = scores(folder, kind, seed)
            say(f"{half} {kind} {seed}: {clicks} clicks, " + " ".join(f"{each:.2f}" for each in unions))
            rows.append(unions)
        means[half] = np.mean(rows, axis=0)
        say(f"{half}: " + ", ".join(f"{reach:g} {each:.3f}" for reach, each in zip(REACHES, means[half], strict=True)))
    best = int(np.argmax(means["fit"]))
    say(f"reach {REACHES[best]:g}: {means['fit'][best]:.3f} on fitted scenes, {means['test'][best]:.3f} on others")
    return REACHES[best]
