"""Splats of small places: a closed room, and a garden with a table, a house around it and nothing above."""

import numpy as np
from disc_splats import discs

from splat2mesh.splats.splats import Splats


def joined(*parts):
    names = ("means", "scales", "quats_wxyz", "opacities", "sh")
    return Splats(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def wall(corner, side, other, spacing):
    """Opaque discs on a rectangle from `corner` along two sides; they face along side x other."""
    corner, side, other = (np.asarray(a, float) for a in (corner, side, other))
    counts = [max(int(np.ceil(np.linalg.norm(a) / spacing)), 1) for a in (side, other)]
    u, v = np.meshgrid(*((np.arange(count) + 0.5) / count for count in counts))
    points = corner + u.reshape(-1, 1) * side + v.reshape(-1, 1) * other
    normal = np.cross(side, other) / np.linalg.norm(np.cross(side, other)) + [1e-6, 0, 0]  # never exactly -z
    return discs(points, np.tile(normal, (len(points), 1)), 0.6 * spacing, 1e-3)


def box(low, high, spacing, inwards=False):
    """The six sides of a box, facing outwards or inwards."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    x, y, z = np.diag(high - low)
    sides = [(low, y, x), (low, x, z), (low, z, y), (high, -x, -y), (high, -z, -x), (high, -y, -z)]
    return joined(*(wall(c, *((b, a) if inwards else (a, b)), spacing) for c, a, b in sides))


def room(spacing=0.04):
    """A closed room of 4 x 2.4 x 3 units with a crate on its floor; y up."""
    return joined(box([-2, 0, -1.5], [2, 2.4, 1.5], spacing, inwards=True), box([0.5, 0, 0], [1, 0.5, 0.5], spacing))


def garden(spacing=0.05):
    """A lawn of 8 x 8 units, a low wall on three sides, a table that stands on nothing, far off the sky; y up."""
    lawn = wall([-4, 0, -4], [0, 0, 8], [8, 0, 0], spacing)
    walls = [
        wall([-4, 0, -4], [8, 0, 0], [0, 0.8, 0], spacing),
        wall([-4, 0, 4], [0, 0, -8], [0, 0.8, 0], spacing),
        wall([4, 0, -4], [0, 0, 8], [0, 0.8, 0], spacing),
    ]
    table = box([-0.6, 0.7, -0.6], [0.6, 0.8, 0.6], spacing)
    far = box([-40, -2, -40], [40, 40, 40], 2.0, inwards=True)
    return joined(lawn, *walls, table, far)
