"""Closed triangle meshes of simple solids, evenly tessellated, counter-clockwise seen from outside.

Every function returns vertices, (V, 3) float64, and faces, (F, 3) int64. `edge` is the wanted edge length.
"""

import numpy as np

CORNER_CUTS = 4
"""Rounds of corner cutting (Chaikin 1974): four leave the polyline within 1% of an edge of its limit, a
B-spline."""

FEWEST_STOPS = 40
"""Points along a lathe profile that its lips and mouldings need, however long the edges."""


def rounded_box(size, bevel, edge):
    """A box with rounded edges, centred on the origin.

    size: (3,) full lengths. bevel: radius of the rounding, less than half the shortest length.
    """
    half = np.asarray(size, np.float64) / 2
    vertices, faces = _box_surface(*(_beveled_axis(length, bevel, edge) for length in half))
    core = np.clip(vertices, bevel - half, half - bevel)
    outward = vertices - core
    return core + bevel * outward / np.linalg.norm(outward, axis=1, keepdims=True), faces


def blob(radius, bumps, rng, edge):
    """A sphere with smooth bumps, centred on the origin.

    radius: of the sphere. bumps: height of the bumps as a fraction of the radius.
    """
    steps = max(2, round(radius * np.pi / 2 / edge))
    axis = np.tan(np.linspace(-np.pi / 4, np.pi / 4, steps + 1))
    cube, faces = _box_surface(axis, axis, axis)
    direction = cube / np.linalg.norm(cube, axis=1, keepdims=True)
    waves, phases = rng.normal(0.0, 2.5, (3, 6)), rng.uniform(0.0, 2 * np.pi, 6)
    height = 1.0 + bumps * np.sin(direction @ waves + phases).mean(axis=1, keepdims=True)
    return radius * height * direction, faces


def torus(ring_radius, tube_radius, edge):
    """A torus about the y axis, centred on the origin."""
    angle = np.linspace(0.0, 2 * np.pi, max(8, round(2 * np.pi * tube_radius / edge)), endpoint=False)
    circle = np.stack([ring_radius + tube_radius * np.cos(angle), tube_radius * np.sin(angle)], axis=1)
    return _revolved(circle, edge, closed=True)


def turned(profile, edge):
    """A solid turned on a lathe about the y axis.

    profile: (P, 2) control points (radius, height) of a smooth curve with the solid on its left. It starts
    and ends on the axis, at right angles to it; a curve that comes back down inside makes a vessel.
    """
    curve = np.asarray(profile, np.float64)
    for _ in range(CORNER_CUTS):
        cuts = np.stack([0.75 * curve[:-1] + 0.25 * curve[1:], 0.25 * curve[:-1] + 0.75 * curve[1:]], axis=1)
        curve = np.concatenate([curve[:1], cuts.reshape(-1, 2), curve[-1:]])
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    stops = np.linspace(0.0, travelled[-1], max(FEWEST_STOPS, round(travelled[-1] / edge)) + 1)
    even = np.stack([np.interp(stops, travelled, coordinate) for coordinate in curve.T], axis=1)
    return _revolved(even, edge, closed=False)


def placed(solid, position, turn_deg=0.0):
    """A solid turned about the y axis, then moved."""
    points, faces = solid
    sin, cos = np.sin(np.radians(turn_deg)), np.cos(np.radians(turn_deg))
    return points @ np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]]) + position, faces


def joined(solids):
    """Several solids as one."""
    starts = np.cumsum([0, *(len(points) for points, _ in solids[:-1])])
    return (
        np.concatenate([points for points, _ in solids]),
        np.concatenate([faces + start for (_, faces), start in zip(solids, starts, strict=True)]),
    )


def vertex_normals(vertices, faces):
    """Area-weighted unit vertex normals: (V, 3) float64."""
    first, second, third = (vertices[faces[:, corner]] for corner in range(3))
    doubled_area = np.cross(second - first, third - first)
    summed = np.stack(
        [np.bincount(faces.ravel(), np.repeat(doubled_area[:, axis], 3), len(vertices)) for axis in range(3)],
        axis=1,
    )
    return summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-30)


def _beveled_axis(half, bevel, edge):
    """Lattice coordinates along one axis of a box: even on the flat part, even in angle on the rounding."""
    flat = half - bevel
    inner = np.linspace(-flat, flat, max(1, round(2 * flat / edge)) + 1)
    angles = np.linspace(0.0, np.pi / 4, max(1, round(bevel * np.pi / 4 / edge)) + 1)[1:]
    rim = flat + bevel * np.tan(angles)
    return np.concatenate([-rim[::-1], inner, rim])


def _box_surface(*axes):
    """The surface of a lattice of box points, welded along its edges."""
    shape = tuple(len(axis) for axis in axes)
    quads = []
    for axis in range(3):
        along, across = (axis + 1) % 3, (axis + 2) % 3
        index = np.indices((shape[along], shape[across])).reshape(2, shape[along], shape[across])
        for end, order in ((0, [0, 3, 2, 1]), (shape[axis] - 1, [0, 1, 2, 3])):
            corner = [None] * 3
            corner[axis], corner[along], corner[across] = np.full_like(index[0], end), index[0], index[1]
            quads.append(_grid_quads(np.ravel_multi_index(corner, shape))[:, order])
    used, faces = np.unique(_triangles(np.concatenate(quads)), return_inverse=True)
    place = np.unravel_index(used, shape)
    return np.stack([axis[index] for axis, index in zip(axes, place, strict=True)], axis=1), faces.reshape(-1, 3)


def _revolved(profile, edge, closed):
    """Turn (P, 2) points (radius, height) about the y axis; ends of an open profile become single poles."""
    return revolved(profile, max(8, round(2 * np.pi * profile[:, 0].max() / edge)), closed)


def revolved(profile, segments, closed=False):
    """A polyline turned about the y axis in `segments` steps, its corners kept.

    profile: (P, 2) of (radius, height) with the solid on its left. Unless closed, its ends lie on the axis.
    """
    angle = np.linspace(0.0, 2 * np.pi, segments, endpoint=False)
    radius, height = profile[:, :1], profile[:, 1:]
    vertices = np.stack(
        [radius * np.cos(angle), np.broadcast_to(height, (len(profile), segments)), radius * np.sin(angle)],
        axis=-1,
    )
    index = np.arange(len(profile) * segments).reshape(len(profile), segments)
    if closed:
        index = np.concatenate([index, index[:1]])
    else:
        index[[0, -1]] = index[[0, -1], :1]
    index = np.concatenate([index, index[:, :1]], axis=1)
    faces = _triangles(_grid_quads(index))
    collapsed = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    used, faces = np.unique(faces[~collapsed], return_inverse=True)
    return vertices.reshape(-1, 3)[used], faces.reshape(-1, 3)


def _grid_quads(index):
    """The cells of a 2-D array of vertex numbers: (Q, 4), counter-clockwise when columns lie left of rows."""
    return np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)


def _triangles(quads):
    return quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
