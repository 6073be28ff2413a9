"""Scenes whose captured colours are known to the last ray: what made them is handed to the estimate."""

from functools import cache

import numpy as np
import open3d as o3d

from relight import Environment
from relight.light.projections import texel_directions
from relight.transfer.bounces import Interreflection, visible_fraction, with_bounces
from relight.transfer.occluder import Occluder
from relight.transfer.raytraced import raytraced_scene

BANDS, RAYS = 5, 32
"""Of the test scenes: what made the captured colours is what is handed to the estimate, so that noise cancels."""

TOP_LEFT = np.array([-0.6, 0.7, 0.39])
TOP_LEFT /= np.linalg.norm(TOP_LEFT)


def lamp_light(color=(1.0, 0.8, 0.6), size=32):
    """A soft lamp from the top left over a dim surrounding: smooth enough for five bands."""
    cosine = texel_directions(size, 2 * size) @ TOP_LEFT
    image = 0.3 + 4.0 * np.exp(6.0 * (cosine - 1.0))[..., None] * np.asarray(color)
    return Environment(image, "lamp")


@cache
def objects():
    """A ball and a torus on a slab: (Occluder, transfer, Interreflection, visible)."""
    parts = [
        o3d.geometry.TriangleMesh.create_sphere(0.45, 24).translate((0.5, 0.55, 0.1)),
        o3d.geometry.TriangleMesh.create_torus(0.35, 0.14, 36, 18).translate((-0.5, 0.45, 0.0)),
        o3d.geometry.TriangleMesh.create_box(2.2, 0.2, 1.6).subdivide_midpoint(4).translate((-1.1, -0.1, -0.8)),
    ]
    vertices, normals, faces, start = [], [], [], 0
    for part in parts:
        part.compute_vertex_normals()
        vertices.append(np.asarray(part.vertices, np.float32))
        normals.append(np.asarray(part.vertex_normals, np.float32))
        faces.append(np.asarray(part.triangles, np.int32) + start)
        start += len(vertices[-1])
    return lit(np.concatenate(vertices), np.concatenate(normals), np.concatenate(faces))


def lit(vertices, normals, faces):
    occluder = Occluder(vertices, normals, faces)
    transfer = raytraced_scene(occluder, BANDS, RAYS)
    visible = visible_fraction(transfer)
    return occluder, transfer, Interreflection(occluder, RAYS, visible=visible), visible


def patchy(occluder, count=12, seed=2):
    """(V, 3) albedo: one colour for each cell of a random mosaic."""
    rng = np.random.default_rng(seed)
    sites = occluder.origins[rng.choice(len(occluder.origins), count)]
    nearest = np.linalg.norm(occluder.origins[:, None] - sites, axis=2).argmin(axis=1)
    return rng.uniform(0.1, 0.8, (count, 3)).astype(np.float32)[nearest]


def photographed(scene, albedo, environment):
    _, transfer, interreflection, _ = scene
    direct = np.maximum(transfer @ environment.sh(BANDS).astype(np.float32), 0)
    return with_bounces(direct, albedo, interreflection, tolerance=1e-6)[0]


def given(scene):
    return {"transfer": scene[1], "interreflection": scene[2]}
