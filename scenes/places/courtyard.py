"""A courtyard: a yard between four walls, with an arcade, a fountain or a table, potted plants and a tree."""

# ruff: noqa: RUF005 - a list added to an array shifts it

from functools import partial

import numpy as np

from .. import shapes
from . import cards, textures
from .facades import Front, facade
from .garden import GREEN, POT, TABLE_FOOT, TABLE_TOP, tree
from .masonry import STONES, coursed, paving, plaster_color, shades, wall_paint
from .solids import block, joined, moved, panel, slab

FOV_DEG = 70.0
ARCADE_M = 1.4
"""How deep the arcade is, along the wall at -z."""

BASIN = [(0, 0), (0.95, 0), (1.0, 0.05), (0.95, 0.1), (0.92, 0.38), (1.02, 0.42), (1.02, 0.48), (0.84, 0.48)]
BASIN += [(0.82, 0.4), (0.8, 0.2), (0, 0.2)]
SPOUT = [(0, 0), (0.22, 0), (0.24, 0.1), (0.12, 0.2), (0.1, 0.7), (0.14, 0.8), (0.5, 0.95), (0.52, 1.0), (0.46, 1.0)]
SPOUT += [(0.1, 0.9), (0.07, 1.15), (0.03, 1.25), (0, 1.25)]
PILLAR = [
    (0, 0),
    (0.2, 0),
    (0.2, 0.06),
    (0.14, 0.12),
    (0.125, 0.3),
    (0.11, 1.5),
    (0.13, 1.54),
    (0.19, 1.66),
    (0.19, 1.75),
]
PILLAR += [(0, 1.75)]


def courtyard(made, rng):
    """Furnish a courtyard; see the module. The seed chooses its size, paints, arcade, middle and plants."""
    edge, fine, leaves = made.edge, 0.7 * made.edge, made.leaves_wanted
    x, z, tall = rng.uniform(3.0, 4.6), rng.uniform(3.4, 5.0), rng.uniform(3.0, 5.6)
    made.transmittance = 0.3
    ground = panel(np.array([-x, 0.0, z]), (2 * x, 0, 0), (0, 0, -2 * z), edge, (), 0.1)
    made.add(ground, paving(rng))
    paint = wall_paint(rng)
    arcaded = rng.random() < 0.7
    fronts = [
        Front((-x, 0, -z), 0.0, 2 * x, tall),
        Front((x, 0, -z), -90.0, 2 * z, tall * rng.uniform(0.8, 1.2)),
        Front((x, 0, z), 180.0, 2 * x, tall * rng.uniform(0.55, 1.1)),
        Front((-x, 0, z), 90.0, 2 * z, tall * rng.uniform(0.8, 1.2)),
    ]
    for front in fronts:
        paint = wall_paint(rng) if rng.random() < 0.75 else paint
        facade(made, front, paint, rng)
        coping = block((-0.2, front.tall, -0.3), (front.wide + 0.2, front.tall + 0.1, 0.08), edge, "yYZ")
        made.add(front.placed(coping), textures.plain(STONES[rng.integers(len(STONES))], 0.15, 0.5))
    if arcaded:
        _arcade(made, rng, x, z)
    middle = np.array([0.0, 0.0, 0.5 * ARCADE_M if arcaded else 0.0])
    half = np.array([x, z - middle[2]])
    made.walk = partial(walk, middle, half)
    _middle(made, rng, middle, fine)
    size = np.sqrt(1500 / max(leaves, 60))
    _plants(made, rng, (middle, half), round(0.55 * leaves), size, fine)
    turn = rng.uniform(0, 2 * np.pi)
    place = middle[[0, 2]] + 0.86 * half * np.sign([np.sin(turn), 0.3 + abs(np.cos(turn))])
    tree(made, rng, tuple(place - 0.3 * np.sign(place)), rng.uniform(0.6, 0.9), GREEN, round(0.25 * leaves), size, fine)
    _creeper(made, rng, (x, z, tall), round(0.2 * leaves), size)


def walk(middle, half, steps):
    """Around the middle of a yard of `half` its size (x, z), looking across it, along the walls and up."""
    turn = np.arange(len(steps)) * np.pi * (3.0 - np.sqrt(5.0))
    around = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    eyes = np.insert(around * (half - 1.1), 1, 1.25 + 0.6 * steps, axis=1) + middle
    side = np.stack([around[:, 1], -around[:, 0]], axis=1) * np.sin(1.7 * turn)[:, None]
    targets = np.insert((0.9 * side - 0.8 * around) * half, 1, 0.4 + 1.9 * ((3 * turn) % 1.0), axis=1) + middle
    return eyes, targets, FOV_DEG


def arch(wide, spring, top, margin, thick, edge):
    """A wall with a round arch cut out below, about x = 0: its two sides at z = 0 and -thick, and the soffit.

    wide: of the bay. spring: height of the feet of the arch. margin: from the bay's ends to the arch.
    """
    radius = wide / 2 - margin
    angle = np.linspace(np.pi, 0.0, max(8, round(np.pi * radius / edge)) + 1)
    low = np.stack([radius * np.cos(angle), spring + radius * np.sin(angle)], axis=1)
    low = np.concatenate([[(-wide / 2, spring)], low, [(wide / 2, spring)]])
    share = np.linspace(0.0, 1.0, 3)[:, None]
    grid = np.stack([low[:, 0] + 0 * share, low[:, 1] + share * (top - low[:, 1])], axis=-1)
    front = _sheet(np.concatenate([grid, np.zeros_like(grid[..., :1])], axis=-1))
    back = front[0] - [0, 0, thick], front[1][:, ::-1]
    lines = np.insert(low, 2, 0.0, axis=1) - np.array([0, 0, thick]) * np.array([0.0, 1.0])[:, None, None]
    return [front, back, _sheet(lines[::-1])]


def _sheet(grid):
    """Triangles of a grid of points (R, C, 3); columns run to the right of its viewer, rows up."""
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    return grid.reshape(-1, 3), quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def _arcade(made, rng, x, z):
    """Arches on pillars along the wall at -z, with a lean-to roof."""
    edge, bays = made.edge, int(rng.integers(3, 6))
    pitch, front, spring = 2 * x / bays, -z + ARCADE_M, rng.uniform(1.7, 2.0)
    top = spring + pitch / 2 + 0.1
    middles = -x + pitch * (np.arange(bays) + 0.5)
    solids = [moved(part, (m, 0, front + 0.15)) for m in middles for part in arch(pitch, spring, top, 0.17, 0.3, edge)]
    stone = STONES[rng.integers(len(STONES))]
    made.add(solids, wall_paint(rng))
    posts = [
        moved(shapes.turned(np.array(PILLAR) * [1, spring / 1.75], edge), (-x + pitch * k, 0.0, front))
        for k in range(bays + 1)
    ]
    made.add(posts, textures.plain(stone * rng.uniform(0.9, 1.4), rng.uniform(0.05, 0.4), 0.3))
    roof = panel(np.array([-x, top, front + 0.4]), (2 * x, 0, 0), (0, 0.7, -ARCADE_M - 0.4), edge)
    tiles = np.array([0.40, 0.17, 0.09]) * rng.uniform(0.6, 1.2)
    made.add(roof, textures.roof_tiles(tiles, seed=int(rng.integers(1000))))
    boards = panel(np.array([-x, top - 0.02, -z]), (2 * x, 0, 0), (0, 0, ARCADE_M + 0.4), edge)
    made.add(boards, textures.planks((0.2, 0.12, 0.06), (0, 0, 1), (1, 0, 0), 0.2))
    step = block((-x, 0, -z), (x, 0.1, front + 0.3), edge, "YZ")
    made.add(step, coursed(shades(stone, 5, 0.2, 3), 0.8, 0.55, 0.015, 0.5 * stone, 4))


def _middle(made, rng, middle, edge):
    """A fountain, or a table with things on it, with two benches."""
    stone = STONES[rng.integers(len(STONES))] * rng.uniform(0.8, 1.4)
    paint = textures.plain(stone, rng.uniform(0.05, 0.5), 0.2)
    if rng.random() < 0.6:
        parts = [shapes.turned(BASIN, edge), moved(shapes.turned(SPOUT, edge), (0, 0.18, 0))]
        made.add([moved(part, middle) for part in parts], paint)
        water = shapes.turned([(0, 0.2), (0.86, 0.2), (0.86, 0.36), (0.84, 0.37), (0.5, 0.37), (0, 0.37)], edge)
        made.add(moved(water, middle), textures.plain((0.03, 0.07, 0.07), 0.4, 0.5))
    else:
        table = [moved(shapes.turned(TABLE_TOP, edge), (0, 0.74, 0)), shapes.turned(TABLE_FOOT, edge)]
        made.add([moved(part, middle) for part in table], paint)
        jug = np.array(POT) * rng.uniform(0.6, 0.9)
        made.add(moved(shapes.turned(jug, edge), middle + [0.2, 0.74, 0.1]), plaster_color(rng))
        plates = [shapes.blob(0.06, 0.05, rng, edge) for _ in range(3)]
        spots = [(-0.25, 0.79, 0.25), (-0.12, 0.79, 0.3), (-0.2, 0.79, 0.12)]
        made.add([moved(one, middle + spot) for one, spot in zip(plates, spots, strict=True)], plaster_color(rng))
    wood = np.array([0.30, 0.19, 0.095]) * rng.uniform(0.4, 1.4)
    for side in (-1, 1):
        bench = [slab((-0.7, 0.4, -0.2), (0.7, 0.46, 0.2), edge)]
        bench += [slab((s * 0.55 - 0.05, 0, -0.16), (s * 0.55 + 0.05, 0.41, 0.16), edge) for s in (-1, 1)]
        made.add(
            moved(joined(bench), middle + [side * 1.55, 0, 0.2], 90.0 + rng.uniform(-12, 12)),
            textures.plain(wood, 0.3, 0.1),
        )


def _plants(made, rng, yard, leaves, size, edge):
    """Pots along the walls, each with a bush, some in flower."""
    (middle, half), count = yard, int(rng.integers(6, 11))
    turn = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * 2 * np.pi / count
    way = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    spots = way / np.abs(way).max(axis=1, keepdims=True) * (half - 0.4) + middle[[0, 2]]
    pots, tints = [], []
    for at in spots:
        scale = rng.uniform(1.1, 2.0)
        pots.append(moved(shapes.turned(np.array(POT) * scale, edge), (at[0], 0.0, at[1])))
        tints.append((0.44, 0.19, 0.10) if rng.random() < 0.6 else plaster_color(rng))
        each = np.array([0.24, rng.uniform(0.2, 0.45), 0.24]) * scale
        places, outward = cards.in_ellipsoid(
            (at[0], 0.24 * scale + 0.8 * each[1], at[1]), each, leaves // count, rng, 0.2
        )
        leaf = np.array(GREEN) * np.exp(0.4 * rng.normal(size=3) * [1, 0.6, 1])
        blooms = rng.random((len(places), 1)) < rng.choice([0.0, 0.3])
        color = np.where(blooms, plaster_color(rng), leaf)
        made.add_leaves(cards.scattered(places, outward + [0, 0.5, 0], 0.16 * size, 0.1 * size, rng), color, rng)
    made.add(pots, [tuple(tint) for tint in tints])


def _creeper(made, rng, yard, leaves, size):
    """Leaves that grow over one side wall."""
    x, z, tall = yard
    side, start = rng.choice([-1, 1]), rng.uniform(-0.5, 0.4) * z
    rise = rng.random(leaves) ** 0.8
    along = start + (0.3 + 0.9 * rise) * rng.normal(size=leaves)
    places = np.stack([side * (x - rng.uniform(0.02, 0.12, leaves)), 0.75 * tall * rise, np.clip(along, -z, z)], axis=1)
    outward = np.tile([-side, 0.2, 0.0], (leaves, 1))
    made.add_leaves(cards.scattered(places, outward, 0.2 * size, 0.17 * size, rng, 0.6, 0.6), (0.07, 0.15, 0.03), rng)
