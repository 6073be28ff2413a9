"""A nook: an open box with objects on a plain floor, seen from its open side."""

import numpy as np

from .. import shapes
from ..kinds import BOWL, COLUMN, VASE
from . import textures
from .solids import cushion, moved, slab

HALF, TALL = 1.3, 1.5
FOV_DEG = 55.0


def nook(made, rng):
    """Furnish a nook; see the module."""
    made.walk = walk
    edge = made.edge
    made.add(slab((-HALF, -0.06, -HALF), (HALF, 0.0, HALF), edge), (0.42, 0.40, 0.37))
    wall = textures.plain((0.55, 0.50, 0.42), 0.08, 0.8)
    made.add(slab((-HALF, -0.06, -HALF - 0.06), (HALF, TALL, -HALF), edge), wall)
    made.add(
        slab((-HALF - 0.06, -0.06, -HALF - 0.06), (-HALF, TALL, HALF), edge),
        textures.plain((0.45, 0.13, 0.09), 0.1, 0.6),
    )
    made.add(
        slab((HALF, -0.06, -HALF - 0.06), (HALF + 0.06, TALL, HALF), edge), textures.plain((0.10, 0.24, 0.19), 0.1, 0.6)
    )
    fine = 0.7 * edge
    made.add(moved(shapes.turned(COLUMN, fine), (-0.55, -0.005, -0.65)), textures.plain((0.62, 0.6, 0.55), 0.15, 0.1))
    made.add(
        moved(shapes.turned(VASE, fine), (0.55, -0.005, -0.5)),
        textures.rings([(0.06, 0.14, 0.3), (0.5, 0.42, 0.3), (0.1, 0.25, 0.38)], 0.09),
    )
    made.add(
        moved(shapes.turned(np.array(BOWL) * 0.8, fine), (0.15, -0.005, 0.25)),
        textures.rings([(0.5, 0.3, 0.05), (0.3, 0.12, 0.03)], 0.06),
    )
    made.add(moved(shapes.blob(0.24, 0.25, rng, fine), (-0.6, 0.22, 0.35)), textures.plain((0.5, 0.2, 0.28), 0.4, 0.25))
    made.add(moved(shapes.torus(0.2, 0.075, fine), (0.75, 0.07, 0.4)), textures.plain((0.16, 0.3, 0.08), 0.2, 0.2))
    made.add(
        moved(cushion((0.6, 0.5, 0.2), fine), (0.0, 0.25, -1.05), 0.0, -14.0),
        textures.plain((0.55, 0.36, 0.08), 0.15, 0.05),
    )


def walk(steps):
    """A careful arc before the open side, low and high."""
    turn = np.radians(62.0) * np.sin(np.arange(len(steps)) * 2.4)
    far = 2.9 + 0.5 * np.cos(np.arange(len(steps)) * 1.7)
    eyes = np.stack([far * np.sin(turn) * 0.62, 0.45 + 1.35 * steps, far * np.cos(turn) - 0.1], axis=1)
    targets = np.stack([0.5 * np.sin(5.0 * turn), 0.35 + 0.25 * np.cos(3.0 * turn), np.full(len(steps), -0.3)], axis=1)
    return eyes, targets, FOV_DEG
