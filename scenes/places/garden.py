"""A garden: a set table on a terrace before a house, lawn, hedge, trees, and a ring of woods around it all."""

# ruff: noqa: RUF005 - a list added to an array shifts it

import numpy as np

from .. import shapes
from ..kinds import BOWL
from . import cards, textures
from .solids import ground, joined, limb, moved, slab

TERRACE = (-3.1, 3.1, -3.6, 2.3)
"""Extent of the terrace in metres: x from, to, z from, to. The house is on its far side, at -z."""

HOUSE_Z, TABLE_HEIGHT = -3.6, 0.74
FOV_DEG = 62.0

TABLE_TOP = [(0, -0.03), (0.78, -0.03), (0.82, -0.02), (0.83, -0.005), (0.81, 0.004), (0.78, 0.006), (0, 0.006)]
TABLE_FOOT = [(0, 0), (0.34, 0), (0.36, 0.02), (0.3, 0.05), (0.12, 0.09), (0.07, 0.2), (0.065, 0.45), (0.1, 0.6)]
TABLE_FOOT += [(0.22, 0.7), (0.24, 0.72), (0, 0.72)]
POT = [(0, 0), (0.1, 0), (0.115, 0.02), (0.15, 0.19), (0.175, 0.2), (0.175, 0.245), (0.15, 0.245), (0.145, 0.2)]
POT += [(0.12, 0.185), (0, 0.185)]
TEA_POT = [(0, 0), (0.07, 0), (0.1, 0.03), (0.12, 0.09), (0.09, 0.15), (0.05, 0.17), (0.055, 0.18), (0.02, 0.2)]
TEA_POT += [(0.03, 0.215), (0.02, 0.235), (0, 0.235)]
CUP = [(0, 0), (0.028, 0), (0.032, 0.008), (0.042, 0.03), (0.046, 0.075), (0.042, 0.075), (0.036, 0.03), (0.02, 0.012)]
CUP += [(0, 0.012)]
PLATE = [(0, 0), (0.07, 0), (0.08, 0.004), (0.115, 0.016), (0.115, 0.02), (0.08, 0.01), (0, 0.008)]

GREEN, DARK_GREEN, OLIVE = (0.10, 0.20, 0.03), (0.045, 0.11, 0.025), (0.16, 0.19, 0.05)
WHITE_PAINT, OAK, TEAK, TERRACOTTA = (0.68, 0.66, 0.60), (0.30, 0.19, 0.095), (0.36, 0.20, 0.09), (0.44, 0.19, 0.10)


def garden(made, rng):
    """Furnish a garden; see the module."""
    made.transmittance, made.walk = 0.35, walk
    leaves, edge = made.leaves_wanted, made.edge
    size = np.sqrt(4500 / max(leaves, 100))
    height = _land(made, rng, round(0.31 * leaves), size)
    _house(made, rng, edge)
    _table(made, rng, edge)
    _chair(made, (-1.15, 0.55), 62.0, edge)
    _chair(made, (0.95, -0.95), 222.0, edge)
    _pots(made, rng, edge, round(0.13 * leaves), size)
    _hedge(made, rng, edge, round(0.13 * leaves), size)
    tree(made, rng, (4.4, 2.2), 1.0, GREEN, round(0.17 * leaves), size, edge)
    tree(made, rng, (-4.2, 5.4), 0.72, (0.55, 0.33, 0.36), round(0.09 * leaves), size, edge)
    _woods(made, rng, round(0.17 * leaves), size, edge, height)


def walk(steps):
    """Three in five eyes circle the table, the others stroll about the garden and look around."""
    turn = np.arange(len(steps)) * np.pi * (3.0 - np.sqrt(5.0)) + 0.4
    around = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    orbit = np.arange(len(steps)) % 5 < 3
    radius = np.where(orbit, 1.85 + 0.55 * (np.arange(len(steps)) % 2), 2.55)
    height = np.where(orbit, 1.05 + 0.95 * steps, 1.35 + 0.3 * steps)
    eyes = np.insert(around * radius[:, None] * [1.0, 0.92], 1, height, axis=1)
    outward = np.insert(4.2 * np.roll(around, 1, axis=1) * [1, -1], 1, 0.75 + 0.9 * (turn % 1.0), axis=1)
    targets = np.where(orbit[:, None], [0.0, 0.72, 0.0], outward)
    return eyes, targets, FOV_DEG


def _land(made, rng, leaves, size):
    hills = rng.uniform(0, 2 * np.pi, 4)
    x0, x1, z0, z1 = TERRACE

    def height(at):
        away = np.maximum(np.linalg.norm(at, axis=1) - 5.0, 0.0)
        wave = np.sin(0.31 * at[:, 0] + hills[0]) + np.sin(0.27 * at[:, 1] + hills[1])
        return -0.02 + 0.008 * away * wave + 0.011 * away**1.6

    made.add(ground(30.0, 2.2 * made.edge, height), textures.lawn(rng.integers(1000)), volume=True)
    top = slab((x0, -0.1, z0), (x1, 0.0, z1), made.edge, 0.015)
    made.add(top, textures.flagstones(seed=rng.integers(1000)))
    far = np.sqrt(rng.uniform(0.0, 1.0, 4 * leaves)) ** 1.6 * 9.0
    turn = rng.uniform(0, 2 * np.pi, 4 * leaves)
    at = 1.6 * np.stack([np.sin(turn), np.cos(turn)], axis=1) + far[:, None] * np.stack([np.sin(turn), np.cos(turn)], 1)
    free = ~((at[:, 0] > x0) & (at[:, 0] < x1) & (at[:, 1] > z0) & (at[:, 1] < z1)) & (at[:, 1] > HOUSE_Z + 0.05)
    at = at[free][:leaves]
    feet = np.insert(at, 1, height(at) - 0.005, axis=1)
    grow = size * (0.7 + 0.13 * np.linalg.norm(at, axis=1))
    patch = textures.noise(feet, 1.1, 5)
    color = np.array([0.15, 0.27, 0.05]) * np.exp(0.35 * patch) + np.array([0.05, 0.02, 0.0]) * (patch > 0.2)
    made.add_leaves(cards.blades(feet, 0.11 * np.sqrt(grow), 0.026 * grow, rng), color, rng)
    return height


def _house(made, rng, edge):
    seed = rng.integers(1000)
    wall_edge = 1.5 * edge
    made.add(slab((-4.4, -0.1, HOUSE_Z - 3.0), (4.4, 2.75, HOUSE_Z), wall_edge), textures.bricks(seed=seed))
    made.add(
        slab((-4.44, -0.1, HOUSE_Z - 3.0), (4.44, 0.3, HOUSE_Z + 0.04), wall_edge), textures.plain((0.34, 0.31, 0.27))
    )
    roof = moved(slab((-4.8, -0.05, -2.2), (4.8, 0.05, 2.2), wall_edge), (0, 3.5, HOUSE_Z - 1.5), 0.0, 27.0)
    made.add(roof, textures.roof_tiles(seed=seed))
    made.add(slab((-4.7, 2.5, HOUSE_Z), (4.7, 2.62, HOUSE_Z + 0.42), edge), WHITE_PAINT)
    made.add(
        limb([(-4.7, 2.53, HOUSE_Z + 0.45), (4.7, 2.53, HOUSE_Z + 0.45)], [0.055, 0.055], edge), (0.22, 0.23, 0.24)
    )
    frames, panes, curtains = [], [], []
    for x, width, low, high in ((-2.75, 1.15, 0.95, 2.1), (2.45, 1.5, 0.95, 2.1)):
        z = HOUSE_Z
        panes.append(slab((x - width / 2, low, z), (x + width / 2, high, z + 0.012), edge))
        for side in (-1, 0, 1):
            middle = x + side * (width / 2 - 0.03 * abs(side))
            frames.append(slab((middle - 0.035, low, z), (middle + 0.035, high, z + 0.05), edge))
        for level in (low, high, low + 0.62 * (high - low)):
            frames.append(
                slab((x - width / 2 - 0.03, level - 0.035, z), (x + width / 2 + 0.03, level + 0.035, z + 0.052), edge)
            )
        frames.append(slab((x - width / 2 - 0.1, low - 0.1, z), (x + width / 2 + 0.1, low - 0.04, z + 0.14), edge))
        curtains += [
            slab(
                (x + s * width * 0.42 - 0.12, low + 0.05, z), (x + s * width * 0.42 + 0.12, high - 0.05, z + 0.02), edge
            )
            for s in (-1, 1)
        ]
    made.add(panes, textures.plain((0.045, 0.06, 0.075), 0.5, 0.6))
    made.add(curtains, textures.plain((0.5, 0.46, 0.40), 0.5, (0.05, 3.0, 1.0)))
    made.add(frames, WHITE_PAINT)
    door = [slab((-0.62, 0.0, HOUSE_Z), (0.42, 2.12, HOUSE_Z + 0.05), edge)]
    made.add(door, textures.planks((0.045, 0.155, 0.15), (0, 1, 0), (1, 0, 0), 0.13, 3.0, seed))
    jambs = [slab((x - 0.06, 0.0, HOUSE_Z), (x + 0.06, 2.2, HOUSE_Z + 0.08), edge) for x in (-0.66, 0.46)]
    jambs.append(slab((-0.72, 2.1, HOUSE_Z), (0.52, 2.22, HOUSE_Z + 0.08), edge))
    made.add(jambs, WHITE_PAINT)
    made.add(slab((-0.85, -0.05, HOUSE_Z), (0.65, 0.11, HOUSE_Z + 0.45), edge), textures.plain((0.36, 0.34, 0.31)))
    made.add(slab((0.29, 0.98, HOUSE_Z), (0.35, 1.12, HOUSE_Z + 0.1), 0.03), (0.42, 0.32, 0.12))


def _table(made, rng, edge):
    fine = 0.6 * edge
    top, faces = shapes.turned(TABLE_TOP, fine)
    turn = rng.uniform(0, np.pi)
    along = np.array([np.cos(turn), 0.0, np.sin(turn)])
    across = np.array([-np.sin(turn), 0.0, np.cos(turn)])
    made.add(
        (top + [0, TABLE_HEIGHT, 0], faces), textures.planks(TEAK, along, across, 0.165, 3.0, rng.integers(1000), 0.012)
    )
    made.add(shapes.turned(TABLE_FOOT, fine), textures.plain((0.10, 0.115, 0.105), 0.3, 0.1))
    on = TABLE_HEIGHT
    made.add(
        moved(shapes.turned(POT, fine), (0.05, on, -0.1)),
        textures.rings([(0.09, 0.17, 0.33), (0.55, 0.5, 0.42)], 0.06, seed=3),
    )
    tea = shapes.turned(TEA_POT, fine)
    spout = limb([(0.1, 0.07, 0), (0.15, 0.1, 0), (0.18, 0.16, 0)], [0.025, 0.018, 0.012], fine)
    arc = np.linspace(-1.9, 1.9, 9)
    handle = limb(
        np.stack([-0.1 - 0.055 * np.cos(arc), 0.095 + 0.05 * np.sin(arc), 0 * arc], 1), np.full(9, 0.009), fine
    )
    made.add(moved(joined([tea, spout, handle]), (-0.36, on, 0.2), 35.0), textures.plain((0.62, 0.60, 0.54), 0.06, 0.1))
    china = [moved(shapes.turned(PLATE, fine), (x, on, z)) for x, z in ((-0.5, -0.18), (0.38, 0.38))]
    china += [moved(shapes.turned(CUP, fine), (x, on + 0.008, z)) for x, z in ((-0.5, -0.18), (0.38, 0.38))]
    made.add(china, textures.plain((0.60, 0.62, 0.62), 0.05, 0.1))
    bowl = np.array(BOWL) * [0.46, 0.46]
    made.add(
        moved(shapes.turned(bowl, fine), (0.46, on, -0.22)),
        textures.rings([(0.05, 0.26, 0.27), (0.07, 0.34, 0.33)], 0.05),
    )
    fruit, tints = [], []
    for number in range(7):
        turn, radius = number * 2.4, 0.075 if number else 0.0
        place = (0.46 + radius * np.sin(turn), on + (0.165 if number else 0.2), -0.22 + radius * np.cos(turn))
        fruit.append(moved(shapes.blob(rng.uniform(0.036, 0.046), 0.05, rng, fine), place))
        tints.append([(0.60, 0.20, 0.03), (0.48, 0.055, 0.035), (0.55, 0.38, 0.05), (0.25, 0.36, 0.06)][number % 4])
    made.add(fruit, tints)
    lemon = [moved(shapes.blob(0.034, 0.1, rng, fine), (0.02 + 0.1 * k, on + 0.03, 0.44 - 0.07 * k)) for k in range(2)]
    made.add(lemon, (0.66, 0.50, 0.06))
    book = [slab((-0.13, 0.0, -0.09), (0.13, 0.03, 0.09), fine), slab((-0.11, 0.03, -0.08), (0.12, 0.055, 0.08), fine)]
    made.add(
        [moved(one, (-0.05, on, 0.22 + 0.0), turn_deg) for one, turn_deg in zip(book, (-24, -8), strict=True)],
        [(0.16, 0.035, 0.04), (0.07, 0.12, 0.22)],
    )


def _chair(made, place, turn_deg, edge):
    """A slatted garden chair whose back is at -z before it is turned."""
    fine = 0.7 * edge
    parts = [
        slab((x - 0.02, 0.0, z - 0.02), (x + 0.02, 0.43, z + 0.02), fine) for x in (-0.21, 0.21) for z in (-0.2, 0.2)
    ]
    parts += [slab((-0.23, 0.43, -0.22 + 0.09 * k), (0.23, 0.45, -0.145 + 0.09 * k), fine) for k in range(5)]
    parts += [slab((x - 0.02, 0.4, -0.245), (x + 0.02, 0.92, -0.2), fine) for x in (-0.21, 0.21)]
    parts += [slab((-0.2, 0.53 + 0.095 * k, -0.24), (0.2, 0.6 + 0.095 * k, -0.215), fine) for k in range(4)]
    parts += [slab((x - 0.025, 0.62, -0.24), (x + 0.025, 0.645, 0.22), fine) for x in (-0.235, 0.235)]
    parts += [slab((x - 0.02, 0.43, 0.18), (x + 0.02, 0.63, 0.22), fine) for x in (-0.235, 0.235)]
    solid = moved(joined(parts), (place[0], 0.0, place[1]), turn_deg)
    made.add(solid, textures.plain(OAK, 0.3, (0.3, 0.05, 0.3)))


def _pots(made, rng, edge, leaves, size):
    """A plant on the table, pots and a flower bed along the house."""
    fine = 0.8 * edge
    spots = [
        (-2.2, -2.75, 1.6),
        (-1.55, -3.0, 1.15),
        (1.25, -2.95, 1.5),
        (2.75, 1.5, 1.7),
        (2.3, 1.85, 1.1),
        (-2.65, 1.2, 1.35),
    ]
    made.add(
        [moved(shapes.turned(np.array(POT) * scale, fine), (x, 0.0, z)) for x, z, scale in spots],
        textures.plain(TERRACOTTA, 0.25, 0.15, 4),
    )
    made.add(
        slab((1.85, 0.0, -3.45), (3.05, 0.34, -3.0), edge), textures.planks(OAK, (1, 0, 0), (0, 1, 0), 0.115, 5.0, 8)
    )
    plants = [
        ((0.05, TABLE_HEIGHT + 0.33, -0.1), (0.21, 0.17, 0.21), (0.055, 0.15, 0.03), (0.66, 0.10, 0.14), 0.2, 0.055)
    ]
    kinds = [
        ((0.08, 0.17, 0.05), (0.42, 0.20, 0.62)),
        (DARK_GREEN, (0.7, 0.62, 0.58)),
        (GREEN, (0.72, 0.42, 0.05)),
        (DARK_GREEN, (0.62, 0.06, 0.09)),
        (OLIVE, (0.7, 0.66, 0.6)),
        (GREEN, (0.62, 0.14, 0.32)),
    ]
    for (x, z, scale), (leaf, flower) in zip(spots, kinds, strict=True):
        half = np.array([0.26, 0.24, 0.26]) * scale * 0.85
        plants.append(((x, 0.245 * scale + 0.75 * half[1], z), half, leaf, flower, 0.12, 0.07))
    plants.append(((2.45, 0.5, -3.22), (0.62, 0.24, 0.24), GREEN, (0.68, 0.52, 0.07), 0.2, 0.06))
    share = np.array([1.6, *(1.0 for _ in spots), 1.5])
    for (center, half, leaf, flower, blooms, length), count in zip(plants, leaves * share / share.sum(), strict=True):
        count = max(round(count), 8)
        places, outward = cards.in_ellipsoid(center, half, count, rng, 0.2)
        color = np.where(rng.random((count, 1)) < blooms * (outward[:, 1:2] > -0.1), flower, leaf)
        made.add_leaves(
            cards.scattered(places, outward + [0, 0.5, 0], 1.35 * length * size, 0.85 * length * size, rng), color, rng
        )


def _hedge(made, rng, edge, leaves, size):
    low, high = np.array([-6.1, -0.1, -3.4]), np.array([-5.1, 1.65, 6.6])
    made.add(
        slab(low + [0.12, 0, 0.12], high - [0.12, 0.12, 0.12], 2.5 * edge, 0.1),
        textures.foliage(DARK_GREEN, 0.1),
        volume=True,
    )
    places, outward = cards.on_box(low, high, leaves, rng, 0.16, ("X", "X", "z", "Z", "Y"))
    made.add_leaves(cards.scattered(places, outward, 0.17 * size, 0.13 * size, rng, 0.2), DARK_GREEN, rng, 0.3)


def tree(made, rng, place, scale, leaf, leaves, size, edge):
    """A tree at `place` (x, z), with `leaves` leaves of colour `leaf`; size: factor on theirs, as fewer are larger."""
    trunk_top = np.array([place[0], 1.75 * scale, place[1]])
    bend = rng.uniform(-0.1, 0.1, 2)
    trunk = [(place[0], -0.15, place[1]), (place[0] + bend[0], 0.8 * scale, place[1] + bend[1]), trunk_top]
    wood = [limb(trunk, np.array([0.2, 0.13, 0.115]) * scale, edge)]
    tips = []
    for number in range(9):
        turn, rise = number * 2.4 + rng.uniform(-0.3, 0.3), 0.55 + 0.9 * (number / 9)
        reach = np.array([np.sin(turn), rise, np.cos(turn)]) * scale * rng.uniform(0.85, 1.25)
        base = trunk_top - [0, 0.35 * scale * (1 - number / 9), 0]
        wood.append(
            limb([base, base + 0.5 * reach + [0, 0.05, 0], base + reach], np.array([0.07, 0.045, 0.018]) * scale, edge)
        )
        tips.append(base + reach)
    made.add(wood, textures.plain((0.15, 0.105, 0.07), 0.5, (0.04, 0.3, 0.04), rng.integers(1000)))
    tips = np.array([*tips, trunk_top + [0, 1.5 * scale, 0]])
    chosen = rng.integers(len(tips), size=leaves)
    places, outward = cards.in_ellipsoid((0, 0, 0), np.array([0.75, 0.5, 0.75]) * scale, leaves, rng, 0.15)
    places = places + tips[chosen]
    away = places - (trunk_top + [0, 0.5 * scale, 0])
    outward = outward + away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 0.1)
    made.add_leaves(cards.scattered(places, outward, 0.2 * size * scale**0.5, 0.13 * size * scale**0.5, rng), leaf, rng)


def _woods(made, rng, leaves, size, edge, height):
    """Trees and bushes 13 to 26 m away; of each some dark cores and large leaves."""
    count, lumps = 34, 4
    turn = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * 2 * np.pi / count
    far = rng.uniform(14.0, 25.0, count)
    tall = rng.uniform(2.4, 4.6, count) * np.where(np.arange(count) % 3, 1.0, 0.55)
    wide = tall * rng.uniform(0.55, 0.8, count)
    foot = np.stack([far * np.sin(turn), far * np.cos(turn)], axis=1)
    foot = np.insert(foot, 1, height(foot), axis=1)
    at = np.repeat(foot, lumps, axis=0)
    half = np.repeat(np.stack([wide, 0.7 * tall, wide], axis=1), lumps, axis=0)
    shift = rng.uniform(-0.55, 0.55, (count * lumps, 3)) + [0.0, 0.95, 0.0]
    at, half = at + shift * half, half * rng.uniform(0.5, 0.8, (count * lumps, 1))
    core = 5.0 * edge
    crowns = [shapes.blob(1.0, 0.3, rng, core) for _ in range(count * lumps)]
    solids = [
        moved((0.86 * points * axes, faces), place)
        for (points, faces), axes, place in zip(crowns, half, at, strict=True)
    ]
    made.add(solids, textures.foliage((0.07, 0.13, 0.03), 0.45), volume=True)
    made.add(
        [limb([p - [0, 0.2, 0], p + [0, 0.5 * t, 0]], [0.22, 0.14], core / 3) for p, t in zip(foot, tall, strict=True)],
        (0.10, 0.075, 0.055),
    )
    chosen = rng.integers(count * lumps, size=leaves)
    places, outward = cards.in_ellipsoid((0, 0, 0), (1, 1, 1), leaves, rng, 0.8)
    tints = np.array([DARK_GREEN, GREEN, OLIVE, (0.20, 0.16, 0.04)])[rng.choice(4, count, p=(0.4, 0.3, 0.2, 0.1))]
    woods = cards.scattered(places * half[chosen] + at[chosen], outward, 0.75 * size, 0.6 * size, rng)
    made.add_leaves(woods, tints[chosen // lumps], rng, 0.3)
