"""Blocks: walls, roofs, posts, crowns and small things in no order, for estimates that must know no kind of place.

The seed draws everything: how large the place is, how much of the sky the walls leave, and every paint.
"""

from functools import partial

import numpy as np

from .. import shapes
from . import cards, textures
from .solids import block, ground, joined, limb, moved

FOV_DEG = 75.0


def blocks(made, rng):
    """Furnish a place of blocks; see the module."""
    reach, tone = np.exp(rng.uniform(np.log(2.0), np.log(8.0))), np.exp(0.4 * rng.standard_normal() - 0.2)
    paint = partial(_paint, rng, tone)
    edge, leaves = made.edge * max(reach / 3.0, 0.7), made.leaves_wanted
    made.transmittance, made.walk = 0.3, partial(walk, reach)
    swell, wave = rng.choice([0.0, 0.03]) * reach, 2.0 / reach
    made.add(ground(4.0 * reach, edge, lambda at: swell * np.sin(wave * at).prod(axis=1)), paint())
    _walls(made, rng, reach, edge, paint)
    _things(made, rng, reach, 0.6 * edge, paint)
    if rng.random() < 0.3:
        _roof(made, rng, reach, edge, paint)
    size = reach / 4.0 * np.sqrt(1500 / max(leaves, 60))
    crowns = int(rng.choice([0, 2, 5, 12]))
    for _ in range(crowns):
        _crown(made, rng, reach, leaves // crowns, size)


def walk(reach, steps):
    """Around the middle at eye level, looking across the place, along it and up."""
    turn = np.arange(len(steps)) * np.pi * (3.0 - np.sqrt(5.0))
    around, side = (np.stack([np.sin(way), np.cos(way)], axis=1) for way in (turn, turn + 2.6 * np.sin(3.0 * turn)))
    eyes = np.insert(0.45 * reach * around, 1, 1.2 + 0.6 * steps, axis=1)
    return eyes, np.insert(reach * side, 1, 0.3 * reach * ((3.0 * turn) % 1.0), axis=1), FOV_DEG


def _paint(rng, tone):
    """A paint of a random kind, as dark as the place is."""
    log = np.log(0.25) + 0.6 * rng.standard_normal() + 0.25 * rng.standard_normal(3)
    color, seed, kind = np.clip(tone * np.exp(log), 0.02, 0.75), rng.integers(1000), rng.integers(4)
    if kind == 0:
        return textures.plain(color, rng.uniform(0.05, 0.5), rng.uniform(0.2, 1.0), seed)
    if kind == 1:
        return textures.planks(color, (0, 1, 0), (0.7, 0, 0.7), rng.uniform(0.1, 0.4), 2.0, int(seed))
    if kind == 2:
        return textures.rings([color, color * np.exp(0.5 * rng.standard_normal())], rng.uniform(0.3, 1.2), 1, int(seed))
    return textures.foliage(color, rng.uniform(0.05, 0.3), int(seed))


def _walls(made, rng, reach, edge, paint):
    """Blocks around the middle, each turned its own way or all squared; with panes of another paint or without."""
    squared, tall = rng.random() < 0.6, np.exp(rng.uniform(np.log(0.3), np.log(2.0))) * reach
    for turn_deg in rng.permutation(np.arange(0, 360, 45))[: rng.integers(0, 8)]:
        turned = float(turn_deg) if not squared else 90.0 * round(turn_deg / 90.0)
        wide, high, far = rng.uniform(0.4, 2.4) * reach, tall * rng.uniform(0.5, 1.3), reach * rng.uniform(0.85, 1.5)
        side = (rng.uniform(-0.6, 0.6) if squared else 0.0) * reach
        wall = moved(block((-wide / 2, -0.1, -0.5 * reach), (wide / 2, high, 0.0), edge), (side, 0, -far))
        made.add(moved(wall, (0, 0, 0), turned), paint())
        if rng.random() < 0.5:
            panes = int(rng.integers(1, 5))
            at = (np.arange(panes) + 0.5) / panes * wide - wide / 2
            half, low, top = 0.3 * wide / panes, 0.3 * high * rng.random(), high * rng.uniform(0.5, 0.9)
            each = [block((x - half, low, 0.0), (x + half, top, 0.02 * reach), edge) for x in at]
            made.add(moved(moved(joined(each), (side, 0, -far)), (0, 0, 0), turned), paint())


def _things(made, rng, reach, edge, paint):
    """Boxes, boulders and posts on the ground."""
    for _ in range(rng.integers(2, 14)):
        size, at = np.exp(rng.uniform(np.log(0.06), np.log(0.3))) * reach, rng.uniform(-0.9, 0.9, 2) * reach
        kind = rng.integers(3)
        if kind == 0:
            solid = moved(shapes.rounded_box(size * rng.uniform(0.4, 1.6, 3), 0.05 * size, edge), (0, 0.4 * size, 0))
        elif kind == 1:
            solid = moved(shapes.blob(0.5 * size, rng.uniform(0, 0.3), rng, edge), (0, 0.35 * size, 0))
        else:
            solid = limb([(0, -0.1, 0), (0, 3.0 * size, 0)], np.full(2, 0.2 * size), edge)
        made.add(moved(solid, (at[0], 0.0, at[1]), rng.uniform(0, 360)), paint())


def _roof(made, rng, reach, edge, paint):
    """A slab on four posts."""
    half, high = rng.uniform(0.2, 0.6, 2) * reach, rng.uniform(2.2, 3.5)
    at = rng.uniform(-0.5, 0.5, 2) * reach
    posts = [
        limb([(x, -0.1, z), (x, high, z)], np.full(2, 0.03 * reach), edge)
        for x in (-half[0], half[0])
        for z in (-half[1], half[1])
    ]
    slab = block((-half[0] - 0.2, high, -half[1] - 0.2), (half[0] + 0.2, high + 0.15, half[1] + 0.2), edge)
    turn = rng.uniform(0, 90)
    made.add(moved(joined(posts), (at[0], 0, at[1]), turn), paint())
    made.add(moved(slab, (at[0], 0, at[1]), turn), paint())


def _crown(made, rng, reach, leaves, size):
    """A crown of leaves on a trunk, or a bush."""
    turn, far = rng.uniform(0, 2 * np.pi), reach * rng.uniform(0.4, 1.5)
    half, lift = reach * rng.uniform(0.15, 0.5, 3), rng.choice([0.0, 1.0]) * rng.uniform(1.5, 4.0)
    at = np.array([far * np.sin(turn), lift + 0.8 * half[1], far * np.cos(turn)])
    if lift:
        made.add(limb([at * [1, 0, 1], at], np.full(2, 0.03 * reach), made.edge), (0.12, 0.09, 0.06))
    places, outward = cards.in_ellipsoid(at, half, leaves, rng, 0.2)
    leaf = np.clip((0.1, 0.17, 0.05) * np.exp(0.4 * rng.standard_normal(3)), 0.02, 0.6)
    made.add_leaves(cards.scattered(places, outward, 0.25 * size, 0.18 * size, rng), leaf, rng)
