"""A figure: a bust with shoulders, neck, head and hair on a turned plinth, of smooth solids that melt together."""

# ruff: noqa: RUF005 - a list added to an array shifts it

import numpy as np

from . import albedo, shapes

PLINTH = [(0, 0), (0.3, 0), (0.3, 0), (0.3, 0.05), (0.27, 0.08), (0.17, 0.12), (0.15, 0.24), (0.2, 0.3), (0.22, 0.36)]
PLINTH += [(0, 0.36)]
BLEND = 0.06
"""Distance over which neighbouring ellipsoids melt into one surface."""

ROUNDS = 18
"""Halvings of the interval in which a ray leaves the solid: to 1e-7 of its size."""


def figure(rng, edge):
    """A bust in five paints: plinth, robe, head, hair, clasp. The seed chooses all proportions and folds."""
    colors, patchy = albedo.palette(rng, 10)
    wide, deep = rng.uniform(0.30, 0.44), rng.uniform(0.17, 0.24)
    tall, head = rng.uniform(0.07, 0.16), np.array([0.135, 0.18, 0.155]) * rng.uniform(0.85, 1.15, 3)
    look, nod = np.radians(rng.uniform(-40, 40)), rng.uniform(-0.03, 0.05)
    chest = np.array([0.0, 0.55, 0.0])
    neck = chest + [0.0, 0.2 + tall, 0.02]
    skull = neck + [0.02 * np.sin(look), 0.13, 0.03 + nod]
    robe = [
        (chest, (0.8 * wide, 0.24, deep)),
        (chest + [0.62 * wide, 0.07, 0.0], (0.17, 0.13, 0.14)),
        (chest + [-0.62 * wide, 0.07, 0.0], (0.17, 0.13, 0.14)),
        (chest + [0.0, 0.2, 0.0], (0.11, 0.12, 0.1)),
    ]
    folds, phase, slant = rng.uniform(0.0, 0.02), rng.uniform(0, 2 * np.pi), rng.uniform(-3, 3)

    def creased(points):
        axial = np.minimum((points[:, 0] ** 2 + points[:, 2] ** 2) / 0.15**2, 1.0)  # smooth where all folds meet
        return folds * axial * np.sin(9.0 * np.arctan2(points[:, 0], points[:, 2]) + slant * points[:, 1] + phase)

    torso = grown(chest, robe, edge, creased)
    nose, chin = rng.uniform(0.02, 0.035), rng.uniform(0.05, 0.075)
    sin, cos = np.sin(look), np.cos(look)

    def turned(x, y, z):
        return skull + [cos * x + sin * z, y, cos * z - sin * x]

    face = [
        (skull, head),
        (turned(0, -0.7 * head[1], 0.5 * head[2]), (chin + 0.02, chin, chin)),
        (turned(0, -0.15 * head[1], head[2]), (nose, 2 * nose, 1.3 * nose)),
        (turned(0.95 * head[0], -0.1 * head[1], 0), (0.025, 0.045, 0.03)),
        (turned(-0.95 * head[0], -0.1 * head[1], 0), (0.025, 0.045, 0.03)),
        (neck - [0, 0.03, 0], (0.065, 0.1 + 0.5 * tall, 0.065)),
    ]
    bun, curl = rng.uniform(0.05, 0.11), rng.uniform(0.0, 0.012)
    hair = [
        (turned(0, 0.22 * head[1], -0.25 * head[2]), head * [1.08, 0.98, 0.98]),
        (turned(0, rng.uniform(-0.6, 0.9) * head[1], -head[2]), (bun, bun, bun)),
    ]

    def curled(points):
        return curl * np.sin(70.0 * points).prod(axis=1)

    solids = [
        shapes.placed(shapes.turned(PLINTH, edge), (0, 0, 0)),
        torso,
        grown(skull, face, edge, lambda points: 0 * points[:, 0]),
        grown(hair[0][0], hair, edge, curled),
        shapes.placed(shapes.blob(0.045, 0.15, rng, 0.7 * edge), chest + [0.5 * wide, 0.12, deep * 0.62]),
    ]
    return [(*solid, _paint(solid[0], colors[2 * k : 2 * k + 2], patchy, rng)) for k, solid in enumerate(solids)]


def grown(center, ellipsoids, edge, relief):
    """The union of ellipsoids with smooth seams, as seen from `center`: closed where every ray leaves it once.

    ellipsoids: (middle (3,), half axes (3,)). relief: called with points (N, 3), how far (N,) they move out.
    Smooth minimum: log-sum-exp of the approximate distances (Quilez, "Smooth minimum").
    """
    size = max(np.linalg.norm(np.asarray(middle) - center) + max(axes) for middle, axes in ellipsoids)
    ball, faces = shapes.blob(size, 0.0, np.random.default_rng(0), 1.6 * edge)
    way = ball / np.linalg.norm(ball, axis=1, keepdims=True)

    def inside(points):
        away = []
        for middle, axes in ellipsoids:
            unit = (points - middle) / axes
            length = np.linalg.norm(unit, axis=1)
            slope = np.linalg.norm(unit / axes, axis=1)
            away.append(length * (length - 1.0) / np.maximum(slope, 1e-9))
        return -BLEND / 3 * np.log(np.exp(-3 * np.array(away) / BLEND).sum(axis=0)) - relief(points) < 0

    # Outwards in steps first: the last surface along a ray is the one that is seen.
    steps = np.linspace(0.0, 1.2 * size, 49)[1:]
    low = np.zeros(len(way))
    for far in steps:
        low = np.where(inside(center + far * way), far, low)
    high = low + steps[0]
    for _ in range(ROUNDS):
        middle = (low + high) / 2
        within = inside(center + middle[:, None] * way)
        low, high = np.where(within, middle, low), np.where(within, high, middle)
    return center + low[:, None] * way, faces


def _paint(points, colors, patchy, rng):
    """One colour with soft clouds, and a second in veins where the scene is patchy."""
    base = albedo.mottled(points, colors[0], rng, rng.uniform(0.15, 0.5), 0.2 + patchy)
    waves = rng.normal(0.0, 9.0, (3, 6))
    veins = np.sin(points @ waves + rng.uniform(0, 2 * np.pi, 6)).sum(axis=1) > 3.2 - 2.4 * patchy
    return np.where(veins[:, None], colors[1], base)
