"""A still life: fruit, a jug, a bowl, a loaf, a candle and a book on a plate and a cloth with folds."""

# ruff: noqa: RUF005 - a list added to an array shifts it

import numpy as np

from . import albedo, shapes

SINK = 0.01
JUG = [
    (0, 0),
    (0.13, 0),
    (0.16, 0.04),
    (0.2, 0.16),
    (0.17, 0.28),
    (0.09, 0.36),
    (0.09, 0.42),
    (0.12, 0.46),
    (0.1, 0.46),
]
JUG += [(0.07, 0.42), (0.07, 0.36), (0.14, 0.27), (0.16, 0.16), (0.1, 0.05), (0, 0.05)]
DISH = [(0, 0), (0.22, 0), (0.3, 0.02), (0.4, 0.05), (0.4, 0.065), (0.3, 0.035), (0, 0.025)]
CUP = [
    (0, 0),
    (0.07, 0),
    (0.08, 0.02),
    (0.13, 0.09),
    (0.14, 0.17),
    (0.125, 0.17),
    (0.11, 0.09),
    (0.05, 0.03),
    (0, 0.03),
]
CANDLE = [
    (0, 0),
    (0.11, 0),
    (0.12, 0.02),
    (0.05, 0.04),
    (0.05, 0.04),
    (0.05, 0.3),
    (0.045, 0.31),
    (0.01, 0.31),
    (0, 0.34),
]
FRUITS = 5


def still_life(rng, edge):
    """Ten solids: a cloth, a plate with fruit, and four things around it. The seed chooses shapes, places, paints."""
    colors, patchy = albedo.palette(rng, 12)
    half = rng.uniform(0.75, 1.0)
    cloth, cloth_faces = shapes.placed(shapes.rounded_box((2 * half, 0.06, 2 * half), 0.025, edge), (0, -0.03, 0))
    creases, phase = rng.normal(0.0, 5.0, (2, 4)), rng.uniform(0, 2 * np.pi, 4)
    wave = np.sin(cloth[:, [0, 2]] @ creases + phase).mean(axis=1)
    far = np.clip(np.linalg.norm(cloth[:, [0, 2]], axis=1) / half - 0.95, 0, 1)
    cloth[:, 1] += rng.uniform(0.03, 0.12) * far * wave
    period = rng.uniform(0.12, 0.4)
    weave = [
        lambda at: albedo.mottled(at, colors[0], rng, 0.3, 0.2 + 0.5 * patchy),
        lambda at: albedo.checker(at * [1, 0, 1] + [0.01, 0.3, 0.01], colors[:2], period),
        lambda at: albedo.stripes(at, colors[:2], (1, 0, rng.uniform(-1, 1)), period),
    ]
    pattern = weave[rng.integers(1, 3) if patchy > 0.35 else 0]
    solids = [(cloth, cloth_faces, pattern(cloth))]
    spot = np.array([rng.uniform(-0.15, 0.15), 0.0, rng.uniform(-0.15, 0.15)])
    wide = rng.uniform(0.8, 1.05)
    things = [shapes.placed(shapes.turned(np.array(DISH) * [wide, 1.0], edge), spot - [0, SINK, 0])]
    start = rng.uniform(0, 2 * np.pi)
    for number in range(FRUITS):
        turn, radius = start + 2 * np.pi * number / (FRUITS - 1), rng.uniform(0.08, 0.105)
        away = 0.155 if number else 0.0
        fruit = shapes.blob(radius, rng.uniform(0.02, 0.25), rng, edge)
        stretched = fruit[0] * [1.0, rng.uniform(0.85, 1.25), 1.0], fruit[1]
        height = 0.02 - stretched[0][:, 1].min() - SINK + (0.0 if number else 0.09)
        at = spot + np.array([away * np.sin(turn), height, away * np.cos(turn)])
        things.append(shapes.placed(stretched, at, rng.uniform(0, 360)))
    loaf = shapes.rounded_box(rng.uniform((0.34, 0.14, 0.16), (0.5, 0.2, 0.22)), 0.065, edge)
    around = [
        shapes.turned(np.array(JUG) * rng.uniform(0.85, 1.35, 2), edge),
        shapes.turned(np.array((CUP, CANDLE)[rng.integers(2)]) * rng.uniform(0.9, 1.3, 2), edge),
        loaf if rng.random() < 0.5 else shapes.blob(0.14, 0.3, rng, edge),
        shapes.rounded_box(rng.uniform((0.2, 0.04, 0.28), (0.3, 0.09, 0.4)), 0.012, edge),
    ]
    turns = start + (rng.permutation(4) + rng.uniform(-0.12, 0.12, 4)) * np.pi / 2
    for solid, turn in zip(around, turns, strict=True):
        foot = -solid[0][:, 1].min() - SINK
        at = 0.68 * half * np.array([np.sin(turn), 0, np.cos(turn)])
        things.append(shapes.placed(solid, at + [0, foot, 0], rng.uniform(0, 360)))
    for number, (points, faces) in enumerate(things):
        paint = _paint(points, colors[[2 + number % 10, 2 + (3 * number + 1) % 10]], patchy, rng)
        solids.append((points, faces, paint))
    return solids


def _paint(points, colors, patchy, rng):
    """One colour, and in patchy scenes at times stripes, spots or a blush of a second one."""
    kind = rng.integers(4) if rng.random() < patchy else 0
    if kind == 1:
        return albedo.stripes(points, colors, rng.normal(size=3), rng.uniform(0.05, 0.15))
    if kind == 2:
        return albedo.patches(points, colors[rng.integers(2, size=14)], rng)
    if kind == 3:
        share = 0.5 + 0.5 * np.tanh(6 * (points - points.mean(axis=0)) @ rng.normal(size=3) / np.ptp(points))
        return colors[0] + share[:, None] * (colors[1] - colors[0])
    return albedo.mottled(points, colors[0], rng, rng.uniform(0.1, 0.4), 0.15 + 0.6 * patchy)
