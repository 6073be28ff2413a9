"""A street: a road between pavements and rows of houses, parked cars, lamp posts, trees, walked along."""

# ruff: noqa: RUF005 - a list added to an array shifts it

from functools import partial

import numpy as np

from .. import shapes
from . import cards, textures
from .facades import Front, crowned, facade
from .garden import DARK_GREEN, GREEN, OLIVE, tree
from .masonry import STONES, asphalt, coursed, paving, plaster_color, shades, wall_paint
from .solids import block, joined, limb, moved, panel

FOV_DEG = 70.0
KERB_M, CAR_M = 0.13, (4.0, 1.7, 1.45)
"""Height of the kerb; length, width and height of a car."""


def street(made, rng):
    """Furnish a street along x; see the module. The seed chooses its width, houses, paints, cars and trees."""
    edge, leaves = made.edge, made.leaves_wanted
    made.transmittance = 0.3
    half, road = rng.uniform(10.0, 14.0), rng.uniform(2.8, 3.8)
    pave = rng.uniform(1.5, 2.4)
    made.walk = partial(walk, half, road)
    _ground(made, rng, half, road, pave)
    wall = road + pave
    size = np.sqrt(1500 / max(leaves, 60))
    _row(made, rng, half, Front((-half, KERB_M, -wall), 0.0, 2 * half, 0.0))
    green = rng.random() < 0.4
    if green:
        _hedge(made, rng, (half, wall), round(0.3 * leaves), size)
    else:
        _row(made, rng, half, Front((half, KERB_M, wall), 180.0, 2 * half, 0.0))
    across = 2 * wall + 4.0
    ends = (half + 0.1, -wall - 2.0, -90.0), (-half * rng.uniform(1.05, 1.5), wall + 2.0, 90.0)
    for x, z, turn_deg in ends:
        closing, paint = Front((x, 0.0, z), turn_deg, across, rng.uniform(4.0, 8.0)), wall_paint(rng)
        facade(made, closing, paint, rng)
        crowned(made, closing, rng, paint)
    for side in (-1, 1):
        _cars(made, rng, half, side * (road - 0.95))
    _posts(made, rng, half, road + 0.3)
    count = int(rng.integers(2, 6))
    each = round((0.6 if green else 0.9) * leaves / count)
    for number in range(count):
        place = (half * (2 * (number + rng.uniform(0.2, 0.8)) / count - 1), (1 if number % 2 else -1) * (road + 0.45))
        leaf = np.array([GREEN, OLIVE, DARK_GREEN][rng.integers(3)]) * rng.uniform(0.8, 1.4)
        tree(made, rng, place, rng.uniform(1.0, 1.5), leaf, each, 1.4 * size, 1.5 * edge)


def walk(half, road, steps):
    """Up one side of the road and down the other, looking ahead, at the houses and up at their roofs."""
    count = len(steps)
    along = 0.8 * half * np.sin(2 * np.pi * steps * (1 - 1 / count) + 0.3)
    across = 0.14 * road * np.cos(2 * np.pi * steps + 0.3)
    eyes = np.stack([along, 1.5 + 0.35 * np.sin(2.4 * np.arange(count)), across], axis=1)
    turn = np.array([0.0, 0.9, 1.6, 2.4, 3.1, 3.9, 4.7, 5.4])[(3 * np.arange(count)) % 8]
    rise = np.array([-0.12, 0.08, 0.3])[np.arange(count) % 3]
    return eyes, eyes + np.stack([np.cos(turn), rise, np.sin(turn)], axis=1), FOV_DEG


def _ground(made, rng, half, road, pave):
    edge, seed = made.edge, int(rng.integers(1000))
    tar = np.array([0.065, 0.066, 0.07]) * rng.uniform(0.8, 2.6)
    setts = coursed(shades(STONES[rng.integers(2)] * 1.3, 6, 0.25, seed), 0.16, 0.13, 0.02, (0.09, 0.085, 0.08), seed)
    surface = asphalt(tar, 0.0 if rng.random() < 0.5 else None, seed) if rng.random() < 0.65 else setts
    long = 1.6 * half
    made.add(panel(np.array([-long, 0, road + 0.1]), (2 * long, 0, 0), (0, 0, -2 * road - 0.2), edge), surface)
    flags, kerb = paving(rng), STONES[rng.integers(1, 4)]
    for low, high in ((-road - pave - 3.0, -road - 0.14), (road + 0.14, road + pave + 3.0)):
        made.add(panel(np.array([-long, KERB_M, high]), (2 * long, 0, 0), (0, 0, low - high), 1.3 * edge), flags)
    kerbs = [
        block((-long, 0, min(z, z + 0.14)), (long, KERB_M, max(z, z + 0.14)), edge, "YzZ") for z in (-road - 0.14, road)
    ]
    made.add(kerbs, coursed(shades(kerb, 4, 0.15, seed), 0.9, 9.0, 0.012, 0.5 * kerb, seed))


def _row(made, rng, half, line):
    """Houses side by side along a line, each with its own height, paint and openings."""
    storey, start = rng.uniform(2.6, 3.1), 0.0
    while start < 2 * half - 2.0:
        wide = min(rng.uniform(4.6, 8.0), line.wide - start)
        tall = storey * rng.integers(1, 4) + rng.uniform(0.5, 1.2)
        corner = np.asarray(line.placed((np.array([[start, 0.0, 0.0]]), None))[0][0])
        front, paint = Front(tuple(corner), line.turn_deg, wide, tall), wall_paint(rng)
        facade(made, front, paint, rng, storey)
        crowned(made, front, rng, paint)
        start += wide


def _hedge(made, rng, line, leaves, size):
    """A garden wall with a hedge behind it, along the side at +z."""
    half, wall = line
    tall, paint = rng.uniform(0.6, 1.3), wall_paint(rng)
    made.add(block((-1.6 * half, 0, wall), (1.6 * half, tall, wall + 0.25), made.edge, "xXYzZ"), paint)
    low, high = np.array([-half, 0.0, wall + 0.3]), np.array([half, tall + rng.uniform(0.5, 1.5), wall + 1.4])
    core = block(low + [0.1, 0, 0.15], high - [0.1, 0.12, 0.1], 2.0 * made.edge)
    made.add(core, textures.foliage(DARK_GREEN, 0.15), volume=True)
    places, outward = cards.on_box(low, high, leaves, rng, 0.2, ("z", "z", "Y"))
    made.add_leaves(cards.scattered(places, outward, 0.3 * size, 0.22 * size, rng, 0.2), DARK_GREEN, rng, 0.3)


def _cars(made, rng, half, z):
    """Parked cars as rounded boxes with glass around and wheels, along one kerb."""
    at = -half + rng.uniform(1.0, 5.0)
    while at < half - CAR_M[0]:
        if rng.random() < 0.55:
            long, wide, tall = np.array(CAR_M) * rng.uniform(0.85, 1.1, 3)
            edge, coat = (
                0.8 * made.edge,
                plaster_color(rng) if rng.random() < 0.5 else np.full(3, rng.uniform(0.05, 0.7)),
            )
            body = shapes.rounded_box((long, 0.5 * tall, wide), 0.14, edge)
            cabin = shapes.rounded_box((0.55 * long, 0.6 * tall, 0.86 * wide), 0.16, edge)
            middle = np.array([at + long / 2, 0.0, z])
            made.add(moved(body, middle + [0, 0.45 * tall, 0]), textures.plain(coat, 0.08, 0.9))
            made.add(moved(cabin, middle + [-0.05 * long, 0.7 * tall, 0]), _glazing(coat, (0.72 * tall, 0.93 * tall)))
            wheels = [
                limb([(x, 0.3, s * wide * 0.3), (x, 0.3, s * wide * 0.51)], [0.3, 0.3], edge)
                for x in (-0.32 * long, 0.32 * long)
                for s in (-1, 1)
            ]
            made.add(moved(joined(wheels), middle), (0.035, 0.035, 0.038))
        at += rng.uniform(4.8, 6.5)


def _glazing(coat, band):
    """Paint of a car's cabin: dark glass in a band of heights, paint above and below."""

    def paint(points, normals):
        glass = (points[:, 1] > band[0]) & (points[:, 1] < band[1]) & (normals[:, 1] < 0.75)
        return textures.bounded(textures.mixed(coat, (0.04, 0.05, 0.055), glass))

    return paint


def _posts(made, rng, half, z):
    """Lamp posts along both pavements, and a bin at the foot of some."""
    iron, posts, heads, bins = plaster_color(rng) * 0.25, [], [], []
    for number in range(4):
        side = -1 if number % 2 else 1
        at = np.array([half * (0.5 * number - 0.75) + rng.uniform(-0.8, 0.8), KERB_M, side * z])
        tall = rng.uniform(3.2, 4.2)
        posts.append(limb([at, at + [0, 0.5, 0], at + [0, tall, 0]], [0.09, 0.055, 0.045], made.edge))
        heads.append(moved(shapes.blob(0.19, 0.0, rng, 0.7 * made.edge), at + [0, tall + 0.12, 0]))
        if rng.random() < 0.5:
            bins.append(limb([at + [0.5, 0, 0], at + [0.5, 0.9, 0]], [0.2, 0.24], 0.8 * made.edge))
    made.add(posts, textures.plain(iron, 0.2, 0.5))
    made.add(heads, textures.plain((0.6, 0.58, 0.5), 0.05))
    if bins:
        made.add(bins, textures.rings([plaster_color(rng), 0.5 * plaster_color(rng)], 0.3, 1))
