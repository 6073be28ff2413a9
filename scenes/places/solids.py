"""Further shapes of places, in metres: open panels with holes, ground that coarsens with distance, limbs, furniture.

Like `scenes.shapes` these return vertices (V, 3) float64 and faces (F, 3) int64, counter-clockwise seen from their
front; panels and grounds have only a front.
"""

import itertools

import numpy as np

from .. import shapes
from ..shapes import joined


def slab(low, high, edge, bevel=0.008):
    """A lightly rounded box between two corners."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    return moved(shapes.rounded_box(high - low, min(bevel, 0.4 * (high - low).min()), edge), (low + high) / 2)


def block(low, high, edge, sides="xXyYzZ"):
    """A sharp box between two corners, of unwelded flat sides. sides: which; capitals are the far ones."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    size, sheets = np.diag(high - low), []
    for side in sides:
        axis = "xyz".index(side.lower())
        along, up = size[(axis + 1) % 3], size[(axis + 2) % 3]
        sheets.append(panel(low + size[axis], along, up, edge) if side.isupper() else panel(low, up, along, edge))
    return joined(sheets)


def moved(solid, position, turn_deg=0.0, tilt_deg=0.0):
    """A solid tilted about x, turned about y, then moved."""
    points, faces = solid
    sin, cos = np.sin(np.radians([turn_deg, tilt_deg])), np.cos(np.radians([turn_deg, tilt_deg]))
    about_x = np.array([[1, 0, 0], [0, cos[1], -sin[1]], [0, sin[1], cos[1]]])
    about_y = np.array([[cos[0], 0, sin[0]], [0, 1, 0], [-sin[0], 0, cos[0]]])
    return points @ (about_y @ about_x).T + np.asarray(position), faces


def panel(corner, along, up, edge, holes=(), overlap=0.0):
    """A flat sheet from `corner` over the vectors `along` and `up`; its front looks along their cross product.

    holes: rectangles (from, to) in metres along both: ((u0, v0), (u1, v1)). What lies in them is left out.
    overlap: how far the sheet goes on beyond all its sides.
    """
    lengths = np.linalg.norm(along), np.linalg.norm(up)
    lines = []
    for axis, length in enumerate(lengths):
        marks = {-overlap, 0.0, length, length + overlap, *(bound[axis] for hole in holes for bound in hole)}
        marks = sorted(marks)
        pieces = [np.linspace(a, b, max(1, round((b - a) / edge)) + 1)[:-1] for a, b in itertools.pairwise(marks)]
        lines.append(np.append(np.concatenate(pieces), marks[-1]))
    u, v = np.meshgrid(*lines, indexing="ij")
    points = corner + u.reshape(-1, 1) / lengths[0] * np.asarray(along) + v.reshape(-1, 1) / lengths[1] * np.asarray(up)
    index = np.arange(u.size).reshape(u.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
    if not len(holes):
        return points, quads.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    middle_u, middle_v = (lines[0][1:] + lines[0][:-1]) / 2, (lines[1][1:] + lines[1][:-1]) / 2
    kept = np.ones(quads.shape[:2], bool)
    for (u0, v0), (u1, v1) in holes:
        inside_v = (middle_v > v0) & (middle_v < v1)
        kept &= ~(((middle_u > u0) & (middle_u < u1))[:, None] & inside_v)
    used, faces = np.unique(quads[kept][:, [0, 1, 2, 0, 2, 3]], return_inverse=True)
    return points[used], faces.reshape(-1, 3)


def ground(radius, edge, height, near=2.5):
    """A disc of land about the origin whose edges grow with the distance beyond `near`. height: (N, 2) -> (N,)."""
    sides = max(12, round(2 * np.pi * near / edge))
    inner = np.linspace(0.0, near, max(2, round(near / edge)) + 1)[1:]
    outer = near * np.exp(
        np.linspace(0.0, np.log(radius / near), max(2, round(near * np.log(radius / near) / edge)) + 1)
    )
    rings = np.concatenate([inner, outer[1:]])
    angle = np.arange(sides) * 2 * np.pi / sides
    flat = (rings[:, None, None] * np.stack([np.cos(angle), -np.sin(angle)], axis=1)).reshape(-1, 2)
    flat = np.concatenate([np.zeros((1, 2)), flat])
    index = 1 + np.arange(len(rings) * sides).reshape(len(rings), sides)
    index = np.hstack([index, index[:, :1]])
    first = np.stack([np.zeros(sides, int), index[0, :-1], index[0, 1:]], axis=1)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([first, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)])
    return np.insert(flat, 1, height(flat), axis=1), faces


def limb(path, radii, edge):
    """A round tube along a polyline, closed at both ends. path: (M, 3). radii: (M,)."""
    path, radii = np.asarray(path, np.float64), np.asarray(radii, np.float64)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    stops = np.linspace(0.0, travelled[-1], max(3, round(travelled[-1] / edge)) + 1)
    path = np.stack([np.interp(stops, travelled, axis) for axis in path.T], axis=1)
    radii = np.interp(stops, travelled, radii)
    forward = np.gradient(path, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    side = np.cross(forward, np.eye(3)[np.abs(forward.mean(axis=0)).argmin()])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    sides = max(5, round(2 * np.pi * radii.max() / edge))
    angle = np.arange(sides) * 2 * np.pi / sides
    around = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * np.cross(forward, side)[:, None]
    points = (path[:, None] + radii[:, None, None] * around).reshape(-1, 3)
    index = np.arange(len(points)).reshape(-1, sides)
    index = np.hstack([index, index[:, :1]])
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    ends = [len(points), len(points) + 1]
    caps = [np.stack([np.full(sides, ends[0]), index[0, 1:], index[0, :-1]], axis=1)]
    caps += [np.stack([np.full(sides, ends[1]), index[-1, :-1], index[-1, 1:]], axis=1)]
    points = np.concatenate([points, path[:1], path[-1:]])
    return points, np.concatenate([quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3), *caps])


def cushion(size, edge, puff=0.25):
    """A pillow centred on the origin: a box with soft edges that swells in the middle. size: (3,)."""
    size = np.asarray(size, np.float64)
    points, faces = shapes.rounded_box(size, 0.42 * size.min(), edge)
    thin = size.argmin()
    others = [axis for axis in range(3) if axis != thin]
    swell = np.prod(np.cos(np.pi / 2 * np.clip(points[:, others] / size[others] * 2, -1, 1)), axis=1)
    points[:, thin] *= 1.0 - puff + 2 * puff * swell
    return points, faces
