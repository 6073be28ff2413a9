"""Scenes whose captured colours are known to the last ray: what made them is handed to the estimate."""

from functools import cache

import numpy as np
import open3d as o3d

from relight import Environment
from relight.albedo import CaptureEvidence
from relight.light.projections import texel_directions
from relight.transfer.bounces import Interreflection, visible_fraction, with_bounces
from relight.transfer.occluder import Occluder
from relight.transfer.transport import Transport
from relight.transfer.visibility import raytraced_scene
from splat2mesh.scene.measured import CapturedSky
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

BANDS, RAYS = 5, 32
"""Of the test scenes: what made the captured colours is what is handed to the estimate, so that noise cancels."""

TOP_LEFT = np.array([-0.6, 0.7, 0.39])
TOP_LEFT /= np.linalg.norm(TOP_LEFT)

SKY = texel_directions(64, 128)
PLACE = {"from": "both", "eyes": [[0.3, 0.5, 0.6], [-0.5, 0.6, -0.4], [0.6, 0.4, -0.5]]}


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


def given(scene, **known):
    """What `estimate` takes of a scene: its Transport, and what is known of its capture."""
    return {"transport": Transport(scene[1], scene[2]), "evidence": CaptureEvidence(**known)}


def sheet(cells, place):
    """A grid of triangles over [0, 1]^2, both (V, 3) and (F, 3): place maps (V,), (V,) to points."""
    u, v = (g.ravel() for g in np.meshgrid(*[np.linspace(0, 1, cells + 1)] * 2, indexing="ij"))
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1, 1)
    faces = (first + np.array([0, 1, cells + 2, 0, cells + 2, cells + 1])).reshape(-1, 3)
    return np.stack(place(u, v), axis=1), faces


def yard():
    """Ground, its underside, and three pillars on it: a Scene of white, and what `captured_scenes.lit` makes of it."""
    parts = [
        sheet(48, lambda u, v: (2 * u - 1, 0 * u, 2 * v - 1)),
        sheet(8, lambda u, v: (2 * v - 1, 0 * u - 0.05, 2 * u - 1)),
    ]
    for x, z in ((0.1, 0.1), (-0.5, 0.3), (0.5, -0.1)):
        turn = lambda u, x=x, z=z: (x + 0.12 * np.sin(2 * np.pi * u), z + 0.12 * np.cos(2 * np.pi * u))  # noqa: E731
        parts.append(sheet(20, lambda u, v, turn=turn: (turn(u)[0], 0.5 - 0.5 * v, turn(u)[1])))
    vertices, faces, start = [], [], 0
    for points, corners in parts:
        vertices.append(points)
        faces.append(corners + start)
        start += len(points)
    vertices, faces = np.concatenate(vertices), np.concatenate(faces)
    flat = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], flat)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    arrays = vertices.astype(np.float32), normals.astype(np.float32), faces.astype(np.int32)
    scene = Scene([Mesh(*arrays, np.full(vertices.shape, 200, np.uint8))], capture=dict(PLACE))
    return scene, lit(*arrays)


def clipped_picture(light):
    """The CapturedSky of a light whose every direction above the horizon was photographed and clips at 1."""
    seen = light.lookup(SKY.reshape(-1, 3)).reshape(64, 128, 3)
    above = SKY[..., 1:2] > 0.0
    clipped = above & (seen >= 0.95)
    bound = (above & ~clipped).astype(np.float32)
    return CapturedSky((bound * seen).astype(np.float32), bound, clipped.astype(np.float32))
