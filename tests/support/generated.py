"""What the tests of the surface share: small generated scenes as splats, and what their rays meet."""

from functools import cache

import numpy as np
import open3d as o3d

from relight import Environment
from scenes import bake, build, capture_views, exposure, seen_faces, splats_from
from scenes.cameras import FLIP
from splat2mesh.surface.extract import dilated, training_pixel

UP = np.array([0.0, -1.0, 0.0])
"""Of a splat's frame."""


@cache
def scene(kind, count=20_000, seed=1):
    """A small scene: its SceneTruth, the faces (F,) bool that its capture saw, and its bare Splats."""
    truth, seen, radiance = _lit(kind, seed)
    return truth, seen, splats_from(truth, radiance * exposure(radiance), count, seed, seen)


@cache
def _lit(kind, seed):
    """What a scene of any number of splats is drawn from."""
    truth = build(kind, seed, 12_000)
    return truth, seen_faces(truth, capture_views(truth, 48, 128)), bake(truth, Environment.load("noon"))


def dilated_splats(kind, count=20_000):
    """The splats of `scene` as training saw them."""
    splats = scene(kind, count)[2]
    return dilated(splats, training_pixel(splats))


def caster(truth):
    tracer = o3d.t.geometry.RaycastingScene()
    tracer.add_triangles(truth.vertices, truth.faces.astype(np.uint32))
    return tracer


def seen_points(truth, seen, count=20_000, seed=0):
    """Points spread evenly over the faces that the capture saw, and their normals, in the scene frame: (N, 3) each."""
    rng = np.random.default_rng(seed)
    a, b, c = (truth.vertices[truth.faces[seen][:, corner]].astype(float) for corner in range(3))
    normals = np.cross(b - a, c - a)
    area = np.linalg.norm(normals, axis=1)
    face = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return a[face] + u * (b[face] - a[face]) + v * (c[face] - a[face]), (normals / area[:, None])[face]


def times_seen(truth, points, normals, views, near):
    """How many of the views (in the splat's frame) see each point from the front, unobstructed: (N,) int."""
    tracer, times = caster(truth), np.zeros(len(points), int)
    for view in views:
        pixels, depth = view.project(points * FLIP)
        to_eye = view.center * FLIP - points
        frontal = (to_eye * normals).sum(axis=1) > 0.1 * np.linalg.norm(to_eye, axis=1)
        inside = (pixels >= 0).all(axis=1) & (pixels < [view.width, view.height]).all(axis=1) & (depth > near)
        rows = np.flatnonzero(inside & frontal)
        rays = np.hstack([points[rows] + 1e-3 * normals[rows], to_eye[rows]]).astype(np.float32)
        times[rows] += ~tracer.test_occlusions(o3d.core.Tensor(rays), tfar=0.999).numpy()
    return times
