"""The kinds of scene: solids placed in the scene frame (y up), with their albedo."""

from dataclasses import dataclass

import numpy as np

from splat2mesh.base.errors import InputError

from . import albedo, shapes
from .figure import figure
from .machine import machine
from .shapes import placed
from .still_life import still_life

SINK = 0.012
"""How deep objects stand in what carries them, so that no light leaks under them."""

VASE = [(0, 0), (0.17, 0), (0.22, 0.08), (0.3, 0.24), (0.12, 0.42), (0.16, 0.55), (0.2, 0.58)]
VASE += [(0.15, 0.58), (0.11, 0.5), (0.06, 0.42), (0.24, 0.24), (0.18, 0.1), (0.14, 0.06), (0, 0.06)]
BOWL = [
    (0, 0),
    (0.14, 0),
    (0.16, 0.03),
    (0.34, 0.12),
    (0.37, 0.3),
    (0.32, 0.3),
    (0.28, 0.14),
    (0.1, 0.06),
    (0, 0.06),
]
COLUMN = [(0, 0), (0.24, 0), (0.24, 0.1), (0.16, 0.12), (0.12, 0.2), (0.15, 0.5), (0.11, 0.85)]
COLUMN += [(0.17, 0.92), (0.22, 0.94), (0.22, 1.05), (0.18, 1.05), (0, 1.05)]


@dataclass(frozen=True)
class SceneTruth:
    """A scene known exactly, in the scene frame: right-handed, y up. Solids may overlap where they touch.

    kind, seed: what made it. vertices, normals: (V, 3) float32. faces: (F, 3) int32, counter-clockwise seen
    from outside; every solid is closed. albedo_linear: (V, 3) float32. part: (V,) uint8, the solid of a
    vertex.
    """

    kind: str
    seed: int
    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    albedo_linear: np.ndarray
    part: np.ndarray

    @classmethod
    def of_solids(cls, kind, seed, solids):
        """The scene of a list of (points (N, 3), faces (M, 3), linear colours (N, 3))."""
        counts = [len(points) for points, _, _ in solids]
        starts = np.cumsum([0, *counts[:-1]])
        points = np.concatenate([points for points, _, _ in solids])
        faces = np.concatenate([faces + start for (_, faces, _), start in zip(solids, starts, strict=True)])
        return cls(
            kind,
            seed,
            points.astype(np.float32),
            shapes.vertex_normals(points, faces).astype(np.float32),
            faces.astype(np.int32),
            np.concatenate([color for _, _, color in solids]).astype(np.float32),
            np.repeat(np.arange(len(solids)), counts).astype(np.uint8),
        )


def build(kind="tabletop", seed=0, vertices=45_000):
    """The scene of one kind and seed with about `vertices` vertices: a SceneTruth.

    The seed changes places, proportions, bumps and colours, never the list of solids; the vertex count
    changes the tessellation alone. Raises InputError for an unknown kind or fewer than 1,000 vertices.
    """
    if kind not in KINDS:
        raise InputError(f"--kind {kind}: expected one of {' '.join(KINDS)}")
    if vertices < 1000:
        raise InputError(f"--vertices {vertices}: expected at least 1000, fewer cannot show the shapes")
    edge = 0.1
    for _ in range(3):
        solids = KINDS[kind](np.random.default_rng(seed), edge)
        edge *= np.sqrt(sum(len(points) for points, _, _ in solids) / vertices)
    solids = KINDS[kind](np.random.default_rng(seed), edge)
    return SceneTruth.of_solids(kind, seed, solids)


def _object(rng, edge):
    """One bumpy blob in empty space, for views from all around."""
    points, faces = placed(shapes.blob(0.5, 0.35, rng, edge), (0, 0.5, 0))
    return [(points, faces, albedo.patches(points, albedo.random_colors(rng, 24), rng))]


def _tabletop(rng, edge):
    """Six solids on a slab: a column in the middle, the others around it in random order."""
    slab, slab_faces = placed(shapes.rounded_box((2.8, 0.14, 2.8), 0.04, edge), (0, -0.07, 0))
    solids = [(slab, slab_faces, albedo.patches(slab, albedo.random_colors(rng, 60), rng))]
    colors = albedo.random_colors(rng, 12)
    column = placed(shapes.turned(COLUMN, edge), (rng.uniform(-0.05, 0.05), -SINK, 0.0))
    solids.append((*column, albedo.mottled(column[0], colors[0], rng, 0.15)))
    radius = rng.uniform(0.26, 0.32)
    around = [
        (
            shapes.blob(radius, 0.3, rng, edge),
            0.85 * radius,
            lambda at: albedo.mottled(at, colors[1], rng, 0.2),
        ),
        (
            shapes.rounded_box(rng.uniform(0.36, 0.5, 3), 0.03, edge),
            None,
            lambda at: albedo.checker(at, colors[2:4], 0.13),
        ),
        (shapes.torus(0.26, 0.1, edge), 0.1, lambda at: albedo.stripes(at, colors[4:6], (1, 0.3, 0), 0.16)),
        (shapes.turned(VASE, edge), 0.0, lambda at: albedo.stripes(at, colors[6:8], (0.2, 1, 0), 0.14)),
        (shapes.turned(BOWL, edge), 0.0, lambda at: albedo.patches(at, colors[8:], rng)),
    ]
    places = rng.permutation(len(around)) + rng.uniform(-0.1, 0.1, len(around)) + rng.uniform()
    for (solid, height, paint), place in zip(around, places * 2 * np.pi / len(around), strict=True):
        height = -solid[0][:, 1].min() if height is None else height
        points, faces = placed(solid, (0.95 * np.cos(place), height - SINK, 0.95 * np.sin(place)), rng.uniform(0, 360))
        solids.append((points, faces, paint(points)))
    return solids


def _room(rng, edge):
    """A furnished room, 4.4 x 2.6 x 3.6, with a window to +x and a large skylight, seen from inside."""
    wall, floor, wood, cloth = albedo.random_colors(rng, 4)
    wall = 0.5 * wall + 0.5 * albedo.LIGHTEST
    shift = rng.uniform(-0.2, 0.2)
    walls = [  # lowest corner, highest corner; neighbours overlap, but never in one plane
        ((-2.2, 0, -1.95), (2.2, 2.6, -1.8)),
        ((-2.2, 0, 1.8), (2.2, 2.6, 1.95)),
        ((-2.35, 0, -1.95), (-2.2, 2.6, 1.95)),
        ((2.2, 0, -1.95), (2.35, 0.9, 1.95)),
        ((2.2, 2.3, -1.95), (2.35, 2.75, 1.95)),
        ((2.21, 0.85, -1.95), (2.35, 2.65, -1.1 + shift)),
        ((2.21, 0.85, 1.1 + shift), (2.35, 2.65, 1.95)),
        ((-2.35, 2.6, -1.95), (2.35, 2.75, -1.2)),
        ((-2.35, 2.6, 1.2), (2.35, 2.75, 1.95)),
        ((-2.35, 2.61, -1.25), (-1.2, 2.75, 1.25)),
    ]
    table = [((-0.6, 0.7, -0.4), (0.6, 0.76, 0.4))]
    table += [((x - 0.04, -SINK, z - 0.04), (x + 0.04, 0.71, z + 0.04)) for x in (-0.5, 0.5) for z in (-0.3, 0.3)]
    sofa = [((-2.1, -SINK, -1.0), (-1.32, 0.42, 0.9)), ((-2.15, -SINK, -1.0), (-1.85, 0.85, 0.9))]
    sofa += [((-2.1, -SINK, z - 0.11), (-1.3, 0.6, z + 0.11)) for z in (-1.0, 0.9)]
    shelf = [((0.6, y, -1.85), (1.9, y + 0.06, -1.46)) for y in (-SINK, 0.6, 1.2, 1.75)]
    shelf += [((x, -SINK, -1.85), (x + 0.06, 1.81, -1.45)) for x in (0.55, 1.88)]
    ground, ground_faces = _slab((-2.35, -0.15, -1.95), (2.35, 0.0, 1.95), edge)
    solids = [(ground, ground_faces, albedo.checker(ground, [floor, 0.4 * floor], 0.45))]
    offset = np.array([rng.uniform(0.1, 0.4), 0.0, rng.uniform(0.1, 0.5)])
    for boxes, color, move in ((walls, wall, 0), (table, wood, offset), (sofa, cloth, 0), (shelf, wood, 0)):
        for low, high in boxes:
            points, faces = _slab(low + np.asarray(move), high + np.asarray(move), edge)
            solids.append((points, faces, albedo.mottled(points, color, rng, 0.5)))
    colors = albedo.random_colors(rng, 4)
    vase, vase_faces = placed(shapes.turned(np.array(VASE) * 0.8, edge), offset + np.array([0.2, 0.76 - SINK, 0.1]))
    solids.append((vase, vase_faces, albedo.stripes(vase, colors[:2], (0.2, 1, 0), 0.12)))
    ball, ball_faces = placed(shapes.blob(0.3, 0.25, rng, edge), (-0.8, 0.3 - 2 * SINK, 1.2))
    solids.append((ball, ball_faces, albedo.checker(ball, colors[2:], 0.17)))
    return solids


KINDS = {
    "tabletop": _tabletop,
    "room": _room,
    "object": _object,
    "figure": figure,
    "machine": machine,
    "still-life": still_life,
}


def _slab(low, high, edge):
    """A lightly rounded box between two corners."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    return placed(shapes.rounded_box(high - low, 0.02, edge), (low + high) / 2)
