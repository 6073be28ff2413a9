"""Scores of a mesh against the true one: F-scores and agreement of normals over the surface that the capture saw.

A folder of the truth holds sparse/0, the capture's COLMAP model, and gt_mesh.ply in the splat's frame, or truth.ply
with truth.json of `python -m scenes`. Its meta.json may name a sphere that is judged, as roi: {center, radius}.
Source: Knapitsch et al., "Tanks and Temples" (2017), with distances in shares of the true mesh's diagonal.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from splat2mesh.base.errors import InputError
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.meshfile import read_mesh
from splat2mesh.views.cameras import usable_views

DISTANCES = (0.0025, 0.005, 0.01)
"""Distance, in diagonals, within which a sample of the other surface counts as right."""

SAMPLES = 100_000
"""Samples per mesh, evenly over its area. Sparse on large ones: score the truth against itself for the ceiling."""


class Truth(NamedTuple):
    """mesh: (V, 3) vertices and (F, 3) faces in the splat's frame. centers: (C, 3) of the capture's cameras. sphere:
    (center (3,), radius) that is judged, or None for all."""

    mesh: tuple
    centers: np.ndarray
    sphere: tuple | None


def read_truth(folder):
    """The Truth of a folder. Raises InputError for a folder without one."""
    folder = Path(folder)
    made, meta = folder / "truth.json", folder / "meta.json"
    file = folder / ("truth.ply" if made.exists() else "gt_mesh.ply")
    if not file.exists():
        raise InputError(f"{folder}: expected the true mesh, gt_mesh.ply or truth.ply beside truth.json; found neither")
    mesh, turn, sphere = read_mesh(file), np.eye(3), None
    if made.exists():
        turn = np.array(json.loads(made.read_text("utf-8"))["scene_from_splat"])[:3, :3]
    elif meta.exists() and "roi" in (facts := json.loads(meta.read_text("utf-8"))):
        sphere = np.array(facts["roi"]["center"]), float(facts["roi"]["radius"])
    centers = np.stack([view.center for view in usable_views(folder / "sparse/0")])
    return Truth((mesh.vertices @ turn, mesh.faces), centers, sphere)


def score(found, true, centers=None, samples=SAMPLES, seed=0, sphere=None):
    """Compare two triangle meshes, each (vertices (V, 3), faces (F, 3)), in one frame.

    centers: (C, 3) capture camera positions; where given, only samples that two of them see count, on either mesh.
    samples: points on each mesh. sphere: (center, radius); where given, only what lies in it counts.
    Returns a dict: F at each distance, mean |cosine| of normals ("normal") and with orientation ("signed").
    """
    rng = np.random.default_rng(seed)
    sets = []
    for vertices, whole in (found, true):
        faces = whole
        if sphere is not None:
            faces = faces[_reach(np.asarray(vertices)[faces], *sphere)]
        points, normals = _samples(vertices, faces, samples, rng)
        if sphere is not None:
            inside = np.linalg.norm(points - sphere[0], axis=1) < sphere[1]
            points, normals = points[inside], normals[inside]
        if centers is not None:
            seen = _seen(vertices, whole, points, normals, centers) >= 2
            points, normals = points[seen], normals[seen]
        sets.append((points, normals))
    (points, normals), (true_points, true_normals) = sets
    diagonal = np.linalg.norm(np.ptp(true_points, axis=0))
    to_true, nearest_true = cKDTree(true_points).query(points, workers=-1)
    to_found, nearest_found = cKDTree(points).query(true_points, workers=-1)
    result = {}
    for distance in DISTANCES:
        precision, recall = (to_true < distance * diagonal).mean(), (to_found < distance * diagonal).mean()
        result[f"F@{distance}"] = float(2 * precision * recall / max(precision + recall, 1e-12))
    forth = (normals * true_normals[nearest_true]).sum(axis=1)
    back = (true_normals * normals[nearest_found]).sum(axis=1)
    result["normal"] = float((np.abs(forth).mean() + np.abs(back).mean()) / 2)
    result["signed"] = float((forth.mean() + back.mean()) / 2)
    return result


def _reach(corners, center, radius):
    """Which triangles, (F, 3, 3), may reach into a sphere."""
    middle = corners.mean(axis=1)
    extent = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    return np.linalg.norm(middle - center, axis=1) - extent < radius


def _samples(vertices, faces, count, rng):
    """Points spread evenly over the area, and the normals of their faces."""
    a, b, c = (np.asarray(vertices, np.float64)[faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    area = np.linalg.norm(normals, axis=1)
    pick = rng.choice(len(faces), count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = a[pick] + u * (b[pick] - a[pick]) + v * (c[pick] - a[pick])
    return points, normals[pick] / np.maximum(area[pick], 1e-300)[:, None]


def _seen(vertices, faces, points, normals, centers):
    """The number of cameras that see each point, occluded by the mesh itself."""
    caster = RayCaster(vertices, faces)
    offset = 2e-3 * np.linalg.norm(np.ptp(points, axis=0))
    count = np.zeros(len(points), int)
    for center in centers:
        towards = center - points  # not unit: what hides a point lies at less than 1 of it, before the camera
        side = np.sign((towards * normals).sum(axis=1, keepdims=True))
        rays = np.concatenate([points + offset * side * normals, towards], axis=1)
        count += ~caster.occluded(rays, far=1.0)
    return count
