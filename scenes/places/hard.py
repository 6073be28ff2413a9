"""Small places that are hard on light: no way in, only leaves, a black cabinet, one window, a white sky."""

# ruff: noqa: RUF005 - a list added to an array shifts it

import numpy as np

from .. import shapes
from ..kinds import VASE
from . import cards, textures
from .garden import GREEN
from .solids import ground, limb, moved, slab
from .walls import walls

HALF, TALL = (1.6, 1.3), 2.2
FOV_DEG = 70.0
LAMP = (4.0, 4.0, 4.0)
"""Radiance of the only lamp of the closed box, where the mean sky has 1."""

BLACK = 0.015
"""Albedo of the cabinet: as good as none."""


def closed_box(made, rng):
    """A room without an opening, lit by a lamp under the ceiling: no environment ever enters."""
    _box_room(made, rng, ())
    made.openings = np.zeros((0, 3, 3))
    made.add(
        moved(shapes.blob(0.16, 0.0, rng, 0.6 * made.edge), (0.2, TALL - 0.35, 0.1)), (0.5, 0.5, 0.5), emitted=LAMP
    )


def one_window(made, rng):
    """A room whose only light is what comes through one window."""
    _, made.openings = _box_room(made, rng, (("+x", (0.7, 0.8), (1.9, 1.9)),))


def forest(made, rng):
    """Undergrowth and crowns all around: nothing but volume, save a few trunks."""
    made.transmittance, made.walk = 0.35, _stroll

    def height(at):
        return 0.06 * np.sin(1.1 * at[:, 0]) * np.sin(0.9 * at[:, 1])

    made.add(ground(9.0, 1.5 * made.edge, height), textures.lawn(3), volume=True)
    count = made.leaves_wanted
    size = np.sqrt(2000 / max(count, 50))
    turn, far = np.arange(12) * 2.4, 2.6 + 5.5 * rng.random(12)
    at = np.stack([far * np.sin(turn), 0 * turn, far * np.cos(turn)], axis=1)
    made.add(
        [limb([p - [0, 0.1, 0], p + [0, 2.2, 0]], [0.12, 0.08], made.edge) for p in at],
        textures.plain((0.14, 0.1, 0.065), 0.4, 0.1),
        volume=True,
    )
    low = count // 2
    feet = rng.uniform(-6, 6, (low, 3)) * [1, 0, 1]
    feet[:, 1] = height(feet[:, ::2])
    made.add_leaves(cards.blades(feet, 0.28 * size**0.5, 0.05 * size, rng), (0.11, 0.19, 0.04), rng)
    chosen = rng.integers(12, size=count - low)
    places, outward = cards.in_ellipsoid((0, 0, 0), (1.3, 1.0, 1.3), count - low, rng, 0.1)
    made.add_leaves(
        cards.scattered(places + at[chosen] + [0, 2.4, 0], outward, 0.3 * size, 0.2 * size, rng), GREEN, rng
    )


def cabinet(made, rng):
    """A black cabinet on a light floor, with two coloured solids before it."""
    made.walk, edge = _half_circle, made.edge
    made.add(slab((-1.8, -0.06, -1.2), (1.8, 0.0, 1.8), edge), textures.plain((0.5, 0.45, 0.38), 0.1, 0.4))
    made.add(slab((-0.9, -0.01, -1.0), (0.9, 1.3, -0.45), edge), (BLACK,) * 3)
    made.add(moved(shapes.blob(0.25, 0.2, rng, edge), (-0.5, 0.22, 0.3)), textures.plain((0.55, 0.12, 0.06), 0.2, 0.2))
    made.add(
        moved(shapes.turned(np.array(VASE), edge), (0.55, -0.005, 0.35)),
        textures.rings([(0.06, 0.14, 0.3), (0.55, 0.45, 0.3)], 0.1),
    )


def white_sky(made, rng):
    """Wet basalt under the open sky: exposed for the ground, every sky is white."""
    made.walk = _half_circle
    made.add(ground(14.0, 1.6 * made.edge, lambda at: 0 * at[:, 0]), textures.plain((0.05, 0.05, 0.055), 0.4, 0.4))
    made.add(
        moved(shapes.blob(0.4, 0.3, rng, made.edge), (-0.4, 0.33, 0)), textures.plain((0.07, 0.06, 0.05), 0.4, 0.2)
    )
    made.add(
        moved(shapes.rounded_box((0.5, 0.9, 0.5), 0.04, made.edge), (0.5, 0.43, -0.2), 25.0),
        textures.plain((0.045, 0.05, 0.06), 0.4, 0.2),
    )


def _box_room(made, rng, windows):
    made.walk, edge = _inside, made.edge
    room, openings = walls(HALF, TALL, edge, windows)
    made.add(room["floor"], textures.planks((0.3, 0.18, 0.09), width=0.2))
    made.add(room["shell"], (0.05, 0.05, 0.05))
    made.add(room["ceiling"], (0.7, 0.7, 0.68))
    made.add([room["-z"], room["+z"]], textures.plain((0.55, 0.5, 0.42), 0.1, 0.7))
    made.add([room["-x"], room["+x"]], textures.plain((0.20, 0.30, 0.38), 0.1, 0.7, 2))
    if windows:
        made.add(room["reveals"] + room["frames"], (0.66, 0.65, 0.62))
    made.add(
        moved(shapes.rounded_box((0.6, 0.7, 0.6), 0.04, edge), (-0.75, 0.34, -0.4), 20.0),
        textures.plain((0.5, 0.3, 0.07), 0.2, 0.2),
    )
    made.add(moved(shapes.blob(0.25, 0.2, rng, edge), (0.5, 0.22, 0.55)), textures.plain((0.45, 0.1, 0.08), 0.2, 0.2))
    return room, openings


def _inside(steps):
    turn = np.arange(len(steps)) * 2.4
    around = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    eyes = np.insert(around * [1.05, 0.8], 1, 1.2 + 0.5 * np.sin(3 * turn), axis=1)
    return eyes, np.insert(-around * [1.2, 0.9], 1, 0.5 + 1.2 * ((3 * turn) % 1.0), axis=1), FOV_DEG


def _stroll(steps):
    turn = np.arange(len(steps)) * 2.4
    around = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    return (
        np.insert(1.2 * around, 1, 1.4 + 0.4 * steps, axis=1),
        np.insert(-3 * around, 1, 0.6 + 1.5 * steps, axis=1),
        FOV_DEG,
    )


def _half_circle(steps):
    turn = np.radians(75.0) * np.sin(2.4 * np.arange(len(steps)))
    eyes = np.stack([3.0 * np.sin(turn), 0.5 + 1.5 * steps, 3.0 * np.cos(turn)], axis=1)
    return eyes, np.tile([0.0, 0.4, -0.2], (len(steps), 1)), 55.0
