"""What the tests of hard cases share: small meshes, a light with a sun, and all that comes out of them."""

import numpy as np
import open3d as o3d
from scipy.spatial.transform import Rotation

from relight import Environment, Relighter
from relight.light.environment import Suns
from relight.transfer.sunlight import sunlight
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

EVERY = slice(None)
EVERYTHING = ["shadows", "sun", "bounces"]
EPS32 = float(np.finfo(np.float32).eps)
WHITE = np.sqrt(0.25 / np.pi)  # first coefficient of the transfer of a vertex that sees all its sky


def arrays(shape):
    shape.compute_vertex_normals()
    normals = np.asarray(shape.vertex_normals, np.float32)
    return np.asarray(shape.vertices, np.float64), normals, np.asarray(shape.triangles, np.int32)


def joined(*parts):
    offsets = np.cumsum([0] + [len(vertices) for vertices, _, _ in parts[:-1]])
    vertices, normals, faces = zip(*parts, strict=True)
    faces = [part + offset for part, offset in zip(faces, offsets, strict=True)]
    return np.concatenate(vertices), np.concatenate(normals).astype(np.float32), np.concatenate(faces)


def sheet(lines, height=0.0, up=1.0):
    """A horizontal grid over the square of these coordinates."""
    x, z = (a.ravel() for a in np.meshgrid(lines, lines, indexing="ij"))
    index = np.arange(len(x)).reshape(len(lines), -1)
    a, b, c, d = (index[s, t].ravel() for s in (slice(-1), slice(1, None)) for t in (slice(-1), slice(1, None)))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
    return np.stack([x, np.full(len(x), height), z], axis=1), np.tile(np.float32([0, up, 0]), (len(x), 1)), faces


def scene(vertices, normals, faces):
    vertices = np.asarray(vertices, np.float32)
    colors = np.random.default_rng(0).integers(0, 256, vertices.shape).astype(np.uint8)
    return Scene([Mesh(vertices, np.asarray(normals, np.float32), np.asarray(faces, np.int32), colors)])


def ten_bands(lit, *options, **more):
    """A Relighter of ten bands, whatever the default."""
    return Relighter(lit, *options, bands=10, **more)


def knobbed_torus():
    mesh = o3d.geometry.TriangleMesh.create_torus(1.0, 0.5, 24, 16)
    return arrays(mesh + o3d.geometry.TriangleMesh.create_sphere(0.4, 8))


def rough_light():
    """Noise with a sun in it: every effect has something to do."""
    image = np.random.default_rng(1).gamma(1.0, 1.0, (16, 32, 3)).astype(np.float32)
    image[5, 7] = 5000.0
    return Environment(image).rotated(33.0)


def error(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


def everything(lit, albedo):
    """Transfer, sunlight, bounces of noise and full shading of a scene, (V, C), side by side."""
    relighter = ten_bands(lit, rays=16, effects=EVERYTHING)
    shading = relighter.shading(rough_light(), albedo)
    assert shading.sun_count > 4 and len(shading.bounces) > 2
    occluder, matrix = relighter.occluder, relighter.interreflection()
    suns = Suns(Rotation.random(9, random_state=2).as_matrix()[:, 0], np.random.default_rng(3).random((9, 3)))
    noise = np.sin(1e4 * lit.vertices[:, [0, 1, 2, 0]] + 1e3 * lit.normals[:, [1, 2, 0, 0]])
    parts = relighter.transfer, sunlight(occluder, EVERY, suns), matrix.bounce(albedo), matrix.bounce(noise)
    return np.hstack([*parts, shading.radiance])
