"""Leaves and blades of grass: thin cards of four corners, with a front and a back.

Cards: (C, 4, 3) float64 corners, counter-clockwise seen from the front; the first edge is the foot.
"""

import numpy as np


def scattered(places, outward, length, width, rng, droop=0.5, lean=1.0):
    """Leaves at `places` that look roughly `outward`: (C, 4, 3).

    places, outward: (C, 3). length, width: of a leaf, or (C,). droop: how far they hang. lean: spread of directions.
    """
    count = len(places)
    normal = _unit(np.asarray(outward) + lean * 0.6 * rng.normal(size=(count, 3)))
    tip = _unit(np.cross(normal, rng.normal(size=(count, 3))) - [0.0, droop, 0.0])
    return _cards(places, tip, np.cross(tip, normal), length, width, rng)


def blades(feet, length, width, rng, lean=0.45):
    """Blades of grass that stand on `feet`, (C, 3), and lean: (C, 4, 3). length, width: or (C,)."""
    count = len(feet)
    tip = _unit(np.array([0.0, 1.0, 0.0]) + lean * rng.normal(size=(count, 3)) * [1.0, 0.2, 1.0])
    side = np.cross(tip, rng.normal(size=(count, 3)))
    return _cards(feet, tip, side, length, width, rng, foot=0.0)


def in_ellipsoid(center, half_axes, count, rng, shell=0.5):
    """Points in an ellipsoid, most of them near its surface, and the way out: (count, 3) each."""
    outward = _unit(rng.normal(size=(count, 3)))
    reach = (shell + (1.0 - shell) * rng.random((count, 1))) ** 0.6
    return np.asarray(center) + reach * outward * half_axes, _unit(outward / half_axes)


def on_box(low, high, count, rng, depth=0.08, faces=("x", "X", "z", "Z", "Y")):
    """Points in the skin of a box, and the way out: (count, 3) each. faces: capitals are the far sides."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    size = high - low
    axes = np.array(["xyz".index(face.lower()) for face in faces])
    area = np.array([np.prod(np.delete(size, axis)) for axis in axes])
    chosen = rng.choice(len(faces), count, p=area / area.sum())
    points, outward = low + rng.random((count, 3)) * size, np.zeros((count, 3))
    far = np.array([face.isupper() for face in faces])[chosen]
    rows, axis = np.arange(count), axes[chosen]
    points[rows, axis] = np.where(far, high[axis], low[axis]) + depth * (rng.random(count) - 0.7) * np.where(far, 1, -1)
    outward[rows, axis] = np.where(far, 1.0, -1.0)
    return points, outward


def _cards(places, tip, side, length, width, rng, foot=-0.5):
    count = len(places)
    vary = np.exp(0.25 * rng.normal(size=(2, count, 1)))
    along = tip * np.broadcast_to(length, count)[:, None] * vary[0]
    across = _unit(side) * np.broadcast_to(width, count)[:, None] * vary[1]
    start = np.asarray(places) + foot * along
    narrow = (-0.3 * across, 0.3 * across) if foot < 0 else (-0.5 * across, 0.5 * across)
    ends = (0.35 * across, -0.35 * across) if foot < 0 else (0.12 * across, -0.12 * across)
    return np.stack([start + narrow[0], start + narrow[1], start + along + ends[0], start + along + ends[1]], axis=1)


def _unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
