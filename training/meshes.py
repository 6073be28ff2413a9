"""Training meshes: generated ones of many kinds, sizes and poses, and those of a folder.

A kind is a function of a generator and an edge length that returns vertices (V, 3) float64 and faces (F, 3), like
`scenes.shapes`, of about unit size. Solids may overlap: vertices buried in another see no light, as in real models.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from scenes import shapes
from scenes.kinds import BOWL, COLUMN, VASE, build
from splat2mesh.base.errors import InputError
from splat2mesh.scene.meshfile import read_mesh

FEWEST, MOST = 700, 7000
"""Vertices of a generated mesh, spread evenly in their logarithm: coarse ones shade as fine ones do."""

SUFFIXES = (".obj", ".ply", ".stl", ".glb")


class TrainingMesh(NamedTuple):
    """name: kind and seed, or file. vertices, normals: (V, 3) float32. faces: (F, 3) int32."""

    name: str
    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray


def generated(count, seed=0):
    """Yield `count` meshes, the kinds in turn; mesh i depends on its own number and the seed alone.

    Turned at random, of size 0.01 to 100, up to ten sizes away from the origin.
    """
    names = sorted(KINDS)
    for number in range(count):
        yield generate(names[number % len(names)], seed * 1_000_003 + number)


def generate(kind, seed):
    """The TrainingMesh of one of KINDS and a seed. Raises InputError for an unknown kind."""
    if kind not in KINDS:
        raise InputError(f"mesh kind {kind!r}: expected one of {', '.join(sorted(KINDS))}")
    pose = np.random.default_rng([seed, 1])
    target = FEWEST * (MOST / FEWEST) ** pose.random()
    edge = 0.08
    for _ in range(3):  # the seed decides the shape, the edge only its tessellation
        vertices, faces = KINDS[kind](np.random.default_rng([seed, 0]), edge)
        edge *= np.clip(np.sqrt(len(vertices) / target), 0.3, 3.0)
    size = 10.0 ** pose.uniform(-2.0, 2.0)
    vertices = size * (vertices @ random_rotation(pose).T + pose.uniform(-10.0, 10.0, 3))
    normals = shapes.vertex_normals(vertices, faces)
    return TrainingMesh(
        f"{kind} {seed}", vertices.astype(np.float32), normals.astype(np.float32), faces.astype(np.int32)
    )


def from_folder(folder):
    """Yield the meshes of a folder, in the order of their names. Raises InputError where there are none."""
    files = sorted(path for path in Path(folder).rglob("*") if path.suffix.lower() in SUFFIXES)
    if not files:
        raise InputError(f"{folder}: expected mesh files ({', '.join(SUFFIXES)}), found none")
    for file in files:
        mesh = read_mesh(file)
        yield TrainingMesh(file.stem, mesh.vertices, mesh.normals, mesh.faces)


def random_rotation(rng):
    """A rotation matrix (3, 3), uniform over all."""
    matrix, upper = np.linalg.qr(rng.normal(size=(3, 3)))
    matrix *= np.sign(np.diag(upper))
    matrix[:, 0] *= np.linalg.det(matrix)
    return matrix


def _blob(rng, edge):
    return _stretched(shapes.blob(0.5, rng.uniform(0.1, 0.9), rng, edge), rng, 0.3)


def _box(rng, edge):
    size = rng.uniform(0.15, 1.0, 3)
    return shapes.rounded_box(size, rng.uniform(0.05, 0.45) * size.min(), edge)


def _torus(rng, edge):
    ring = rng.uniform(0.25, 0.4)
    return _stretched(shapes.torus(ring, rng.uniform(0.2, 0.9) * ring, edge), rng, 0.3)


def _vessel(rng, edge):
    """Something turned on a lathe: a vase, a bowl or a column, each stop moved a little."""
    profile = np.array([VASE, BOWL, COLUMN][rng.integers(3)], np.float64)
    profile[1:-1] *= rng.uniform(0.85, 1.15, (len(profile) - 2, 2))
    profile[:, 1] *= rng.uniform(0.6, 1.6)
    return _stretched(shapes.turned(profile, edge), rng, 0.2)


def _knot(rng, edge):
    """A tube of changing width along a closed curve of three random harmonics."""
    harmonics = rng.normal(size=(2, 3, 3)) / np.array([1.0, 1.6, 2.4])[:, None]
    around = max(8, round(2 * np.pi * 0.1 / edge))
    along = max(24, round(5.0 / edge))
    t = np.linspace(0.0, 2 * np.pi, along, endpoint=False)
    waves = np.stack([np.cos(np.outer(t, [1, 2, 3])), np.sin(np.outer(t, [1, 2, 3]))])
    center = np.einsum("sth,shc->tc", waves, harmonics)
    center *= 0.5 / np.abs(center).max()
    tangent = np.roll(center, -1, axis=0) - np.roll(center, 1, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.zeros_like(center)
    side[0] = np.cross(tangent[0], [0.36, 0.48, 0.8])
    for i in range(1, along):  # transported with the least rotation; the seam takes the rest
        side[i] = side[i - 1] - (side[i - 1] @ tangent[i]) * tangent[i]
        side[i] /= np.linalg.norm(side[i])
    angle = np.linspace(0.0, 2 * np.pi, around, endpoint=False)
    width = rng.uniform(0.04, 0.14) * (1.0 + 0.4 * np.sin(rng.integers(1, 6) * t + rng.uniform(0, 6)))
    ring = np.cos(angle)[:, None, None] * side + np.sin(angle)[:, None, None] * np.cross(tangent, side)
    points = (center + width[:, None] * ring).transpose(1, 0, 2)
    index = np.arange(along * around).reshape(along, around)
    shift = np.argmin(np.linalg.norm(points[0] - points[-1, 0], axis=1))
    index = np.concatenate([index, np.roll(index[:1], -shift, axis=1)])
    index = np.concatenate([index, index[:, :1]], axis=1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))])
    return _outward(points.reshape(-1, 3), faces)


def _figure(rng, edge):
    """A body with a head and limbs, standing on +y: overlapping solids, the same left and right."""
    body = rng.uniform(0.2, 0.35, 3) * [1.0, 1.3, 1.0]
    parts = [_ellipsoid(body, (0, 0, 0), rng, edge)]
    head = rng.uniform(0.35, 0.8) * body.min() * rng.uniform(0.8, 1.25, 3)
    parts.append(_ellipsoid(head, (0, body[1] + 0.6 * head[1], rng.uniform(-0.2, 0.5) * body[2]), rng, edge))
    for _ in range(rng.integers(1, 4)):
        limb = np.array([rng.uniform(0.15, 0.3) * body[0], rng.uniform(0.5, 1.1) * body[1], 0.0])
        limb[2] = limb[0] * rng.uniform(0.8, 1.3)
        place = body * [rng.uniform(0.5, 1.0), rng.uniform(-1.1, 0.6), rng.uniform(-0.7, 0.7)]
        lean = rng.uniform(-50, 50)
        for side in (-1, 1):
            points, faces = _ellipsoid(limb, (0, 0, 0), rng, edge)
            sin, cos = np.sin(np.radians(side * lean)), np.cos(np.radians(lean))
            points = points @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
            parts.append((points + place * [side, 1, 1], faces))
    return _together(parts)


def _pile(rng, edge):
    """Three to nine solids about one place, touching, overlapping or apart."""
    parts = []
    for _ in range(rng.integers(3, 10)):
        points, faces = [_blob, _box, _torus, _vessel][rng.integers(4)](rng, edge)
        points = rng.uniform(0.3, 1.0) * points @ random_rotation(rng).T + rng.normal(0.0, 0.35, 3)
        parts.append((points, faces))
    return _together(parts)


def _terrain(rng, edge):
    """An open sheet of hills, seen from above and, black or lit, from below."""
    axis = np.linspace(-0.5, 0.5, max(12, round(1.0 / edge)))
    x, z = (grid.ravel() for grid in np.meshgrid(axis, axis, indexing="ij"))
    wave = rng.normal(0.0, 1.0, (2, 8)) * np.geomspace(4.0, 25.0, 8)
    height = np.sin(np.stack([x, z], axis=1) @ wave + rng.uniform(0, 6, 8)) @ (0.35 / np.geomspace(4.0, 25.0, 8))
    points = np.stack([x, rng.uniform(0.3, 2.0) * height, z], axis=1)
    index = np.arange(len(axis) ** 2).reshape(len(axis), -1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    return points, np.concatenate([np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))])


def _statue(rng, edge):
    """A vessel or a blob in a space that is warped at several scales: thin walls bend as one, and none folds over."""
    points, faces = _vessel(rng, edge) if rng.random() < 0.5 else _blob(rng, edge)
    for frequency in (4.0, 9.0, 20.0):
        waves, phases = rng.normal(0.0, frequency, (3, 3)), rng.uniform(0.0, 2 * np.pi, 3)
        points = points + (0.12 / frequency) * np.sin(points @ waves + phases)
    return points, faces


def _tabletop(rng, edge):
    return _scene("tabletop", rng, edge)


KINDS = {
    "blob": _blob,
    "box": _box,
    "figure": _figure,
    "knot": _knot,
    "pile": _pile,
    "statue": _statue,
    "tabletop": _tabletop,
    "terrain": _terrain,
    "torus": _torus,
    "vessel": _vessel,
}


def _scene(kind, rng, edge):
    truth = build(kind, int(rng.integers(2**31)), int(max(1000, 12.0 / edge**2)))
    return truth.vertices.astype(np.float64) / 2.8, truth.faces.astype(np.int64)


def _ellipsoid(half, center, rng, edge):
    points, faces = shapes.blob(1.0, 0.2, rng, edge / np.mean(half))
    return points * half + np.asarray(center), faces


def _stretched(solid, rng, amount):
    """A solid scaled along its three axes, each by up to `amount` of itself either way."""
    points, faces = solid
    return points * rng.uniform(1.0 - amount, 1.0 + amount, 3), faces


def _together(parts):
    starts = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
    faces = [faces + start for (_, faces), start in zip(parts, starts, strict=True)]
    return np.concatenate([points for points, _ in parts]), np.concatenate(faces)


def _outward(points, faces):
    """A closed mesh, wound so that its volume is positive."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    return points, faces if (np.cross(a, b) * c).sum() > 0.0 else faces[:, ::-1]
