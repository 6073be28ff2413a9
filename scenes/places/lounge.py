"""A lounge: a closed, furnished room with two windows and a lamp, seen from within."""

# ruff: noqa: RUF005 - a list added to an array shifts it

import numpy as np

from .. import shapes
from ..kinds import BOWL, VASE
from . import cards, textures
from .garden import CUP, PLATE, POT
from .solids import cushion, joined, limb, moved, slab
from .walls import walls

HALF, TALL = (2.7, 2.15), 2.6
FOV_DEG = 72.0
LAMP = (6.5, 4.5, 2.4)
"""Radiance of the lamp's shade, where the mean sky has 1: warm, and clipped in every picture of the room."""

WINDOWS = (("+x", (1.05, 0.85), (3.25, 2.2)), ("+z", (0.7, 0.85), (2.1, 2.2)))
SHADE = [(0, 0.012), (0.13, 0.012), (0.2, 0.0), (0.205, 0.01), (0.15, 0.3), (0.145, 0.3), (0, 0.29)]


def lounge(made, rng):
    """Furnish a lounge; see the module."""
    made.walk, edge, fine = walk, made.edge, 0.7 * made.edge
    room, made.openings = walls(HALF, TALL, edge, WINDOWS)
    x, z = HALF
    oak = np.array([0.27, 0.155, 0.075])
    made.add(room["floor"], textures.planks(oak, (1, 0, 0), (0, 0, 1), 0.14, 1.9, rng.integers(1000)))
    made.add(room["shell"], (0.05, 0.05, 0.05))
    made.add(room["ceiling"], textures.plain((0.72, 0.71, 0.68), 0.04, 1.0))
    made.add(room["-z"], textures.wallpaper((0.24, 0.29, 0.22), (0.33, 0.37, 0.27)))
    made.add([room["+x"], room["+z"]], textures.plain((0.60, 0.56, 0.48), 0.06, 0.9, 2))
    made.add(room["-x"], textures.plain((0.55, 0.30, 0.20), 0.08, 0.8, 3))
    made.add(room["reveals"] + room["frames"], textures.plain((0.68, 0.67, 0.64), 0.03))
    skirting = [slab((-x, 0, -z), (x, 0.1, -z + 0.018), edge), slab((-x, 0, -z), (-x + 0.018, 0.1, z), edge)]
    skirting += [slab((-x, 0, z - 0.018), (x, 0.1, z), edge), slab((x - 0.018, 0, -z), (x, 0.1, z), edge)]
    made.add(skirting, textures.plain((0.66, 0.64, 0.6), 0.03))
    _rug(made, edge)
    _sofa(made, edge)
    _coffee_table(made, rng, fine)
    _shelf(made, rng, fine)
    _sideboard(made, rng, fine)
    _lamp(made, fine)
    _armchair(made, fine)
    _pictures(made, fine)
    _plant(made, rng, fine)
    _curtains(made, fine)


def walk(steps):
    """Around the middle of the room, looking across it, up and down."""
    turn = np.arange(len(steps)) * np.pi * (3.0 - np.sqrt(5.0))
    around = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    reach = np.where(np.arange(len(steps)) % 3 == 0, 0.45, 1.0)[:, None] * [1.55, 1.25]
    eyes = np.insert(around * reach, 1, 1.3 + 0.45 * np.sin(2.2 * turn), axis=1)
    side = 0.5 * np.stack([around[:, 1], -around[:, 0]], axis=1) * np.sin(1.3 * turn)[:, None]
    targets = np.insert((side - 1.1 * around) * [2.0, 1.6], 1, 0.75 + 0.95 * ((3 * turn) % 1.0), axis=1)
    return eyes, targets, FOV_DEG


def _rug(made, edge):
    center, half = (-0.25, 0.15), (1.35, 0.95)
    colors = [(0.36, 0.075, 0.05), (0.52, 0.42, 0.28), (0.06, 0.10, 0.17), (0.10, 0.03, 0.03)]
    low, high = (center[0] - half[0], -0.01, center[1] - half[1]), (center[0] + half[0], 0.014, center[1] + half[1])
    made.add(slab(low, high, 0.8 * edge), textures.rug(center, half, colors))


def _sofa(made, edge):
    cloth = textures.plain((0.055, 0.115, 0.16), 0.25, 0.03, 5)
    parts = [
        slab((-2.62, 0.1, -1.05), (-1.75, 0.36, 1.05), edge, 0.04),
        slab((-2.66, 0.1, -1.05), (-2.38, 0.86, 1.05), edge, 0.07),
    ]
    parts += [slab((-2.64, 0.1, s * 1.12 - 0.12), (-1.72, 0.6, s * 1.12 + 0.12), edge, 0.07) for s in (-1, 1)]
    parts += [moved(cushion((0.72, 0.17, 0.98), edge, 0.1), (-2.06, 0.43, s * 0.5)) for s in (-1, 1)]
    parts += [moved(cushion((0.2, 0.48, 0.96), edge, 0.12), (-2.34, 0.7, s * 0.5)) for s in (-1, 1)]
    made.add(parts, cloth)
    made.add(
        [slab((px, 0, pz), (px + 0.05, 0.12, pz + 0.05), edge) for px in (-2.6, -1.82) for pz in (-1.15, 1.1)],
        (0.08, 0.05, 0.03),
    )
    fine = 0.7 * edge
    made.add(
        moved(cushion((0.46, 0.44, 0.16), fine), (-2.1, 0.68, -0.75), 78.0, -16.0),
        textures.plain((0.56, 0.34, 0.05), 0.15, 0.03),
    )
    made.add(
        moved(cushion((0.46, 0.44, 0.16), fine), (-2.13, 0.68, 0.72), 98.0, -18.0),
        textures.rings([(0.58, 0.53, 0.45), (0.40, 0.10, 0.07)], 0.055, 1),
    )


def _coffee_table(made, rng, edge):
    top = 0.4
    parts = [slab((-0.85, top - 0.035, -0.25), (0.35, top, 0.5), edge, 0.01)]
    parts += [
        slab((px, 0.0, pz), (px + 0.05, top - 0.03, pz + 0.05), edge) for px in (-0.8, 0.25) for pz in (-0.2, 0.4)
    ]
    parts.append(slab((-0.8, 0.13, -0.2), (0.3, 0.15, 0.45), edge))
    made.add(parts, textures.planks((0.33, 0.17, 0.07), (1, 0, 0), (0, 0, 1), 0.25, 3.0, 11, 0.002))
    made.add(
        moved(shapes.turned(np.array(VASE) * 0.5, edge), (-0.55, top - 0.004, 0.02)),
        textures.rings([(0.06, 0.19, 0.23), (0.10, 0.28, 0.30), (0.55, 0.5, 0.4)], 0.06, 1, 3),
    )
    made.add(
        moved(shapes.turned(np.array(BOWL) * 0.42, edge), (0.12, top - 0.004, 0.25)),
        textures.plain((0.62, 0.59, 0.52), 0.06, 0.1),
    )
    fruit = [
        moved(
            shapes.blob(0.045, 0.05, rng, edge),
            (0.12 + 0.065 * np.sin(k * 2.1), top + 0.085, 0.25 + 0.065 * np.cos(k * 2.1)),
        )
        for k in range(4)
    ]
    made.add(fruit, [(0.6, 0.22, 0.03), (0.45, 0.05, 0.03), (0.25, 0.36, 0.06), (0.6, 0.24, 0.03)])
    books = [moved(slab((-0.14, 0, -0.1), (0.14, 0.028, 0.1), edge), (-0.2, top, 0.25), 20.0)]
    books += [moved(slab((-0.12, 0, -0.09), (0.12, 0.035, 0.09), edge), (-0.2, top + 0.028, 0.25), 5.0)]
    made.add(books, [(0.06, 0.11, 0.2), (0.5, 0.12, 0.06)])
    china = [
        moved(shapes.turned(outline, edge), (-0.25, top + 0.005, -0.1)) for outline in (np.array(PLATE) * 0.75, CUP)
    ]
    made.add(china, (0.62, 0.63, 0.63))
    stems = cards.blades(
        np.tile([-0.55, top + 0.26, 0.02], (14, 1)) + 0.02 * rng.normal(size=(14, 3)), 0.34, 0.035, rng, 0.28
    )
    made.add_leaves(stems, (0.16, 0.21, 0.06), rng)


def _shelf(made, rng, edge):
    """Against the wall at +z, left of the window as seen from inside."""
    x0, x1, back, front, tall = -2.05, -0.55, 2.14, 1.82, 1.95
    tint = textures.plain((0.30, 0.165, 0.075), 0.3, (0.5, 0.04, 0.04), 6)
    levels = np.linspace(0.06, tall, 6)
    boards = [slab((x0, y - 0.012, front), (x1, y + 0.012, back), edge) for y in levels]
    boards += [slab((px - 0.014, 0, front), (px + 0.014, tall + 0.012, back), edge) for px in (x0, x1)]
    boards.append(slab((x0, 0, back - 0.012), (x1, tall, back), edge))
    made.add(boards, tint)
    books, tints = [], []
    palette = np.array(
        [
            (0.33, 0.05, 0.04),
            (0.06, 0.11, 0.20),
            (0.10, 0.18, 0.09),
            (0.48, 0.36, 0.16),
            (0.55, 0.5, 0.42),
            (0.09, 0.06, 0.05),
            (0.42, 0.19, 0.05),
            (0.12, 0.22, 0.25),
        ]
    )
    for number, y in enumerate(levels[:-1]):
        at = x0 + 0.03
        while at < x1 - 0.08:
            wide, high, deep = rng.uniform(0.022, 0.055), rng.uniform(0.2, 0.31), rng.uniform(0.16, 0.22)
            if rng.random() < 0.05:
                at += rng.uniform(0.05, 0.2)
                continue
            books.append(
                slab((at, y + 0.012, back - 0.02 - deep), (at + wide - 0.003, y + high, back - 0.02), 2.0 * edge, 0.003)
            )
            tints.append(palette[rng.integers(len(palette))] * np.exp(0.2 * rng.normal()))
            at += wide
        if number == 4:
            break
    made.add(books, [tuple(np.clip(tint, 0.02, 0.8)) for tint in tints])


def _sideboard(made, rng, edge):
    z = -2.14
    parts = [slab((0.35, 0.12, z), (2.0, 0.74, z + 0.42), edge, 0.012)]
    parts += [
        slab((px, 0.0, pz), (px + 0.05, 0.13, pz + 0.05), edge) for px in (0.42, 1.88) for pz in (z + 0.04, z + 0.32)
    ]
    made.add(parts, textures.planks((0.30, 0.15, 0.06), (1, 0, 0), (0, 1, 0), 0.21, 1.4, 12))
    made.add(
        [slab((0.39 + 0.53 * k, 0.16, z + 0.42), (0.9 + 0.53 * k, 0.7, z + 0.432), edge) for k in range(3)],
        textures.planks((0.36, 0.19, 0.08), (0, 1, 0), (1, 0, 0), 0.3, 2.0, 14),
    )
    made.add(
        [moved(shapes.blob(0.016, 0.0, rng, 0.012), (0.84 + 0.53 * k, 0.45, z + 0.445)) for k in range(3)],
        (0.45, 0.36, 0.16),
    )
    made.add(
        moved(shapes.blob(0.16, 0.12, rng, edge), (0.7, 0.88, z + 0.21)),
        textures.plain((0.10, 0.19, 0.30), 0.5, 0.12, 4),
    )
    made.add(
        moved(shapes.torus(0.13, 0.035, edge), (1.25, 0.9, z + 0.2), 0.0, 82.0),
        textures.plain((0.5, 0.42, 0.3), 0.1, 0.1),
    )
    made.add(
        moved(shapes.turned(np.array(POT) * 0.8, edge), (1.75, 0.736, z + 0.22)),
        textures.plain((0.55, 0.52, 0.48), 0.05, 0.1),
    )
    places, outward = cards.in_ellipsoid(
        (1.75, 1.08, z + 0.24), (0.17, 0.17, 0.15), max(round(0.25 * made.leaves_wanted / 3), 20), rng, 0.15
    )
    made.add_leaves(cards.scattered(places, outward + [0, 0.6, 0], 0.1, 0.05, rng), (0.09, 0.19, 0.05), rng)


def _lamp(made, edge):
    at = np.array([-2.3, 0.0, -1.72])
    base = [(0, 0), (0.15, 0), (0.155, 0.012), (0.14, 0.025), (0.02, 0.035), (0.012, 0.06), (0.012, 1.35), (0, 1.36)]
    made.add(moved(shapes.turned(base, edge), at), (0.16, 0.12, 0.06))
    made.add(moved(shapes.turned(SHADE, edge), at + [0, 1.32, 0]), (0.6, 0.54, 0.42), emitted=LAMP)


def _armchair(made, edge):
    parts = [
        slab((-0.36, 0.14, -0.36), (0.36, 0.36, 0.36), edge, 0.05),
        moved(slab((-0.34, 0, -0.09), (0.34, 0.66, 0.09), edge, 0.07), (0, 0.28, -0.34), 0.0, -12.0),
    ]
    parts += [slab((s * 0.38 - 0.07, 0.14, -0.38), (s * 0.38 + 0.07, 0.58, 0.34), edge, 0.06) for s in (-1, 1)]
    parts.append(moved(cushion((0.62, 0.15, 0.62), edge, 0.1), (0, 0.42, 0.03)))
    made.add(moved(joined(parts), (1.55, 0, 1.15), 222.0), textures.plain((0.50, 0.42, 0.30), 0.22, 0.02, 9))
    legs = [slab((px, 0, pz), (px + 0.04, 0.15, pz + 0.04), edge) for px in (-0.34, 0.3) for pz in (-0.34, 0.3)]
    made.add(moved(joined(legs), (1.55, 0, 1.15), 222.0), (0.10, 0.06, 0.03))


def _pictures(made, edge):
    frames = []
    for number, (corner, right, up) in enumerate(
        (
            ((-2.685, 1.22, 0.75), (0, 0, -1.5), (0, 0.85, 0)),
            ((-1.35, 1.15, -2.135), (0.72, 0, 0), (0, 0.9, 0)),
            ((0.62, 1.25, -2.135), (0.6, 0, 0), (0, 0.45, 0)),
        )
    ):
        corner, right, up = np.array(corner), np.array(right, float), np.array(up, float)
        inward = np.cross(right, up) / np.linalg.norm(np.cross(right, up))
        low, high = corner - inward * 0.02, corner + right + up + inward * 0.008
        made.add(
            slab(np.minimum(low, high), np.maximum(low, high), 0.7 * edge, 0.003),
            textures.landscape(corner, right, up, number),
        )
        for a, b in (
            (corner, corner + right),
            (corner + up, corner + right + up),
            (corner, corner + up),
            (corner + right, corner + right + up),
        ):
            low, high = np.minimum(a, b) - 0.03 - 0.0 * inward, np.maximum(a, b) + 0.03
            keep = np.abs(inward) > 0.5
            plane = corner[keep] + np.array([-0.012, 0.025]) * inward[keep]
            low[keep], high[keep] = plane.min(), plane.max()
            frames.append(slab(low, high, edge))
    made.add(frames, textures.plain((0.34, 0.24, 0.09), 0.15, 0.1))


def _plant(made, rng, edge):
    at = np.array([2.2, 0.0, -1.65])
    made.add(moved(shapes.turned(np.array(POT) * 1.35, edge), at), textures.plain((0.46, 0.21, 0.12), 0.2, 0.15))
    stems = [
        limb([at + [0, 0.2, 0], at + [0.2 * np.sin(k * 2.1), 0.75, 0.2 * np.cos(k * 2.1)]], [0.014, 0.008], edge)
        for k in range(3)
    ]
    made.add(stems, (0.14, 0.12, 0.05))
    count = max(round(0.75 * made.leaves_wanted / 3), 50)
    places, outward = cards.in_ellipsoid(at + [0, 0.95, 0.02], (0.36, 0.42, 0.36), count, rng, 0.1)
    size = np.sqrt(700 / count)
    made.add_leaves(
        cards.scattered(places, outward + [0, 0.3, 0], 0.17 * size, 0.085 * size, rng), (0.05, 0.15, 0.035), rng
    )


def _curtains(made, edge):
    """Folded cloth on either side of each window, and the rods they hang on."""
    cloth, rods = [], []
    for wall, (u0, _), (u1, v1) in WINDOWS:
        across, level = (2 if wall == "+x" else 0), v1 + 0.12
        side = HALF[0] if wall == "+x" else HALF[1]
        ends = np.array([u0, u1]) - (HALF[1] if wall == "+x" else -HALF[0])
        ends = np.array([u0 - HALF[1], u1 - HALF[1]]) if wall == "+x" else np.array([HALF[0] - u1, HALF[0] - u0])
        rod = np.zeros((2, 3))
        rod[:, across], rod[:, 1], rod[:, 2 - across] = ends + [-0.35, 0.35], level, side - 0.09
        rods.append(limb(rod, [0.014, 0.014], edge))
        for end, way in ((ends[0], -1), (ends[1], 1)):
            for fold in range(5):
                path = np.zeros((2, 3))
                path[:, across], path[:, 1] = end + way * (0.04 + 0.062 * fold), (0.1, level)
                path[:, 2 - across] = side - 0.09 + 0.02 * (-1) ** fold
                cloth.append(limb(path, [0.043, 0.038], edge))
    made.add(cloth, textures.plain((0.56, 0.50, 0.38), 0.12, 0.05, 3))
    made.add(rods, (0.12, 0.10, 0.08))
