"""A room with a polished floor: its mesh, and splats with a mirror world below it."""

import numpy as np
from scipy.spatial.transform import Rotation

from splat2mesh.scene.color import srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats

HIGH, WIDE, DEEP = 2.6, 5.0, 4.0
OWN, DIM = np.array([0.02, 0.05, 0.01]), 0.3
EYES = [[x, y, z] for x in (-1.5, 0.2, 1.4) for y in (1.0, 1.5) for z in (-1.2, 0.9)]


def grid(origin, along, across, color, step=0.1):
    """Points, normals and linear colours of a rectangle; its normal is along x across, its colour of the points."""
    counts = [max(int(np.linalg.norm(each) / step), 1) + 1 for each in (along, across)]
    u, v = np.meshgrid(*(np.linspace(0.0, 1.0, count) for count in counts), indexing="ij")
    points = np.asarray(origin) + u[..., None] * np.asarray(along) + v[..., None] * np.asarray(across)
    normal = np.cross(along, across)
    number = np.arange(u.size).reshape(counts)
    a, b, c, d = (each.ravel() for each in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    points = points.reshape(-1, 3)
    normals = np.broadcast_to(normal / np.linalg.norm(normal), points.shape)
    return points, normals, color(points), faces


def plain(*color):
    return lambda points: np.broadcast_to(np.asarray(color, float), points.shape)


def lamps(points):
    """A dark ceiling with bright lamps in one half."""
    bright = (points[:, 0] > 0.0) & (np.sin(7.0 * points[:, 0]) > 0.5) & (np.sin(9.0 * points[:, 2]) > 0.0)
    return np.where(bright[:, None], 0.9, 0.15) * np.ones(3)


def walls():
    """The rectangles of a room that stand above its floor: each wall of its own colour, a ceiling, and a box."""
    x, z = WIDE / 2, DEEP / 2
    yield grid((-x, 0, -z), (0, 0, DEEP), (0, HIGH, 0), plain(0.1, 0.1, 0.1))
    yield grid((x, 0, z), (0, 0, -DEEP), (0, HIGH, 0), plain(0.7, 0.6, 0.5))
    yield grid((x, 0, -z), (-WIDE, 0, 0), (0, HIGH, 0), plain(0.3, 0.3, 0.45))
    yield grid((-x, 0, z), (WIDE, 0, 0), (0, HIGH, 0), plain(0.5, 0.15, 0.1))
    yield grid((-x, HIGH, -z), (WIDE, 0, 0), (0, 0, DEEP), lamps)
    yield grid((-1.0, 0.0, 0.2), (0.8, 0, 0), (0, 0.9, 0), plain(0.8, 0.8, 0.2))


def floor(polished):
    """The floor, or its part that is not polished."""
    start = 1.0 if polished else -WIDE / 2
    color = plain(0.2, 0.2, 0.2)
    return grid((start, 0, DEEP / 2), (WIDE / 2 - start, 0, 0), (0, 0, -DEEP), color)


def splats_of(points, normals, colors, size=0.06, opacity=0.99):
    """Flat Gaussians on points: their second axis is the normal."""
    count = len(points)
    across = np.cross(normals, np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    frames = np.stack([across, normals, np.cross(across, normals)], axis=2)
    quats = np.roll(Rotation.from_matrix(frames).as_quat(), 1, axis=1)
    sh = ((srgb_from_linear(np.clip(colors, 0, 1).astype(np.float32)) - 0.5) / SH_C0)[:, None]
    scales = np.tile([size, 0.004, size], (count, 1))
    return Splats(points, scales, quats, np.full(count, opacity), sh)


def joined(*parts):
    names = ("means", "scales", "quats_wxyz", "opacities", "sh")
    return Splats(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def scene_of(surfaces, capture=None):
    start, meshes = 0, []
    for points, normals, colors, faces in surfaces:
        meshes.append((points, normals, colors, faces + start))
        start += len(points)
    points, normals, colors, faces = (np.concatenate([each[i] for each in meshes]) for i in range(4))
    shown = np.rint(srgb_from_linear(colors.astype(np.float32)) * 255).astype(np.uint8)
    mesh = Mesh(points.astype(np.float32), normals.astype(np.float32), faces.astype(np.int32), shown)
    return Scene([mesh], capture={"from": "inside", "eyes": EYES} if capture is None else capture)


def image(points, normals, colors):
    """A mirror world: images of surfaces, as bright as a polished floor shows them."""
    flip = np.array([1.0, -1.0, 1.0])
    return splats_of(points * flip, normals * flip, OWN + DIM * colors, 0.08)


def room(below=image, polished=True):
    """The Scene of a room and its Splats, with what `below` makes of the surfaces beneath a polished floor."""
    standing = list(walls())
    surfaces = [*standing, floor(polished)]
    parts = [splats_of(*each[:3]) for each in surfaces]
    parts += [] if below is None else [below(*each[:3]) for each in standing]
    return scene_of(surfaces), joined(*parts)
