"""Decimation by a size field: every part of a mesh loses detail in units of its own cells, near parts as far ones.

Quadric edge collapse (Garland and Heckbert, "Surface Simplification Using Quadric Error Metrics", 1997) in rounds of
collapses that do not touch one another, so the result is the same for any number of threads.
"""

from typing import NamedTuple

import numpy as np

from ..base.arrays import Faces, Floats, Indices, Integers, Mask, Points, Vector
from ..base.kernels import kernel
from ..base.threads import shared
from ..scene.mesh import edge_ends, edge_keys

LONGEST = 6.0
"""Length in cells that no edge outgrows: colours need vertices on flat ground too."""

CHEAPEST = 0.35
"""Share of the edges, the cheapest, that a round considers."""

SLOWEST = 0.002
"""Share of the vertices that a round must remove for another one to follow."""

STIFF = 1e-3
"""Weight of the distance from an edge's ends: it draws to the middle where the planes leave the place open, and prefers
short edges."""

LEAST_TURN = 0.2
"""Cosine of the largest turn of a face in one collapse."""


class Simplified(NamedTuple):
    """A mesh with fewer vertices. points: (V, 3) float64. faces: (F, 3) int32. sizes: (V,) side of the cell at each
    vertex. kept: (V,) which fixed vertex of the mesh before each is, -1 for none."""

    points: Points
    faces: Faces
    sizes: Floats
    kept: Indices


def simplify(points: Points, faces: Faces, sizes: Floats, wanted: int, fixed: Mask | None = None) -> Simplified:
    """Remove vertices until `wanted` are left, or nothing more can go.

    points: (V, 3) float64. faces: (F, 3) int32. sizes: (V,) side of the cell at each vertex. fixed: (V,) bool, which
    stay where they are, with the edges between them; none without.
    """
    kept = np.full(len(points), -1, np.int64)
    if fixed is not None:
        kept[fixed] = np.flatnonzero(fixed)
    points, faces, sizes = points.copy(), faces.copy(), np.asarray(sizes, float).copy()
    middle = points.mean(axis=0) if fixed is None else np.zeros(3)  # what is fixed keeps every bit
    points -= middle
    edges, uses = _edges(faces, len(points))
    quadrics, weights = np.zeros((len(points), 10)), np.zeros(len(points))
    _add_quadrics(points, faces, edges[uses == 1], quadrics, weights)
    left = len(points)
    while left > wanted:
        border = kept >= 0
        border[edges[uses == 1].ravel()] = True
        open_edges = (uses == 1) & (kept[edges] < 0).all(axis=1)
        costs, places = np.empty(len(edges)), np.empty((len(edges), 3))
        _costs(len(edges), points, edges, quadrics, weights, sizes, border, open_edges, costs, places)
        finite = np.isfinite(costs)
        if not finite.any():
            break
        count = max(int(CHEAPEST * finite.sum()), 1)
        limit = np.partition(costs[finite], count - 1)[count - 1]
        order = np.flatnonzero(costs <= limit)
        order = order[np.argsort(costs[order], kind="stable")]
        starts, around = _faces_around(faces, len(points))
        mesh = points, faces, starts, around, quadrics, weights, sizes, kept
        removed = _collapse(*mesh, edges, order, places, left - wanted)
        faces = faces[faces[:, 0] >= 0]
        left -= removed
        if removed < max(SLOWEST * left, 1):
            break
        edges, uses = _edges(faces, len(points))
    used, corners = np.unique(faces, return_inverse=True)
    return Simplified(points[used] + middle, corners.reshape(-1, 3).astype(np.int32), sizes[used], kept[used])


def _edges(faces: Faces, count: int) -> tuple[Indices, Indices]:
    """Each edge once, (E, 2) int64, smaller end first, and how many faces it has."""
    keys, uses = np.unique(edge_keys(faces, count), return_counts=True)
    return edge_ends(keys, count), uses


@kernel
def _faces_around(faces: Faces, count: int) -> tuple[Indices, Indices]:
    """For each vertex where its faces begin in a list, and the list, in order."""
    starts = np.zeros(count + 1, np.int64)
    for f in range(len(faces)):
        for k in range(3):
            starts[faces[f, k] + 1] += 1
    for v in range(count):
        starts[v + 1] += starts[v]
    around, end = np.empty(starts[count], np.int64), starts[:-1].copy()
    for f in range(len(faces)):
        for k in range(3):
            around[end[faces[f, k]]] = f
            end[faces[f, k]] += 1
    return starts, around


@kernel
def _add_quadrics(points: Points, faces: Faces, borders: Indices, quadrics: Floats, weights: Floats) -> None:
    """The planes of all faces, by area, and upright planes through border edges, at their corners."""
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x, y, z = points[a, 0], points[a, 1], points[a, 2]
        nx, ny, nz = _cross(
            *(points[b, 0] - x, points[b, 1] - y, points[b, 2] - z),
            *(points[c, 0] - x, points[c, 1] - y, points[c, 2] - z),
        )
        area = np.sqrt(_square(nx, ny, nz))
        if area > 0:
            d = -(nx * x + ny * y + nz * z) / area
            for k in range(3):
                _add_plane(quadrics, faces[f, k], nx / area, ny / area, nz / area, d, area / 2)
                weights[faces[f, k]] += area / 2
    for e in range(len(borders)):
        i, j = borders[e, 0], borders[e, 1]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
        length = np.sqrt(_square(dx, dy, dz))
        if length > 0:
            for axis in range(3):  # all that is across the edge: three planes less what runs along it
                along = dx if axis == 0 else dy if axis == 1 else dz
                nx = (1.0 if axis == 0 else 0.0) - dx * along / (length * length)
                ny = (1.0 if axis == 1 else 0.0) - dy * along / (length * length)
                nz = (1.0 if axis == 2 else 0.0) - dz * along / (length * length)
                size = np.sqrt(_square(nx, ny, nz))
                if size > 1e-6:
                    nx, ny, nz = nx / size, ny / size, nz / size
                    d = -(nx * x + ny * y + nz * z)
                    for k in range(2):
                        _add_plane(quadrics, borders[e, k], nx, ny, nz, d, length * length / 2)


@kernel
def _add_plane(quadrics: Floats, vertex: int, x: float, y: float, z: float, d: float, weight: float) -> None:
    q = quadrics[vertex]
    q[0] += weight * x * x
    q[1] += weight * x * y
    q[2] += weight * x * z
    q[3] += weight * y * y
    q[4] += weight * y * z
    q[5] += weight * z * z
    q[6] += weight * x * d
    q[7] += weight * y * d
    q[8] += weight * z * d
    q[9] += weight * d * d


@shared
@kernel
def _costs(
    begin: int,
    end: int,
    points: Points,
    edges: Indices,
    quadrics: Floats,
    weights: Floats,
    sizes: Floats,
    border: Mask,
    on_border: Mask,
    costs: Floats,
    places: Points,
) -> None:
    """The cost of each edge's collapse, in squared cells, and the position of its vertex; inf: no collapse."""
    for e in range(begin, end):
        a, b = edges[e, 0], edges[e, 1]
        weight, size = weights[a] + weights[b], min(sizes[a], sizes[b])
        length2 = _square(points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2])
        costs[e] = np.inf
        if length2 > (LONGEST * size) ** 2 or not weight > 0 or (border[a] and border[b] and not on_border[e]):
            continue
        p, q = quadrics[a], quadrics[b]
        xx, xy, xz, yy, yz = p[0] + q[0], p[1] + q[1], p[2] + q[2], p[3] + q[3], p[4] + q[4]
        zz, x1, y1, z1, rest = p[5] + q[5], p[6] + q[6], p[7] + q[7], p[8] + q[8], p[9] + q[9]
        mx, my, mz = (
            (points[a, 0] + points[b, 0]) / 2,
            (points[a, 1] + points[b, 1]) / 2,
            (points[a, 2] + points[b, 2]) / 2,
        )
        if border[a] != border[b]:
            kept = a if border[a] else b
            x, y, z = points[kept, 0], points[kept, 1], points[kept, 2]
        else:
            x, y, z = _best((xx, xy, xz, yy, yz, zz), (x1, y1, z1), STIFF * weight, (mx, my, mz))
            if _square(x - mx, y - my, z - mz) > length2:
                x, y, z = mx, my, mz
        error = (
            xx * x * x + 2 * xy * x * y + 2 * xz * x * z + yy * y * y + 2 * yz * y * z + zz * z * z
            + 2 * (x1 * x + y1 * y + z1 * z) + rest
        )  # fmt: skip
        away = _square(x - mx, y - my, z - mz) + length2 / 4  # mean of the squares of the distances from both ends
        costs[e] = (max(error, 0.0) / weight + STIFF * away) / (size * size)
        places[e, 0], places[e, 1], places[e, 2] = x, y, z


@kernel
def _square(x: float, y: float, z: float) -> float:
    return x * x + y * y + z * z


@kernel
def _best(
    square: tuple[float, ...], linear: tuple[float, ...], s: float, middle: tuple[float, ...]
) -> tuple[float, float, float]:
    """The place of least error, drawn by `s` towards the middle: it solves (A + s I) x = s middle - b."""
    (xx, xy, xz, yy, yz, zz), (x1, y1, z1), (mx, my, mz) = square, linear, middle
    a, d, f = xx + s, yy + s, zz + s
    b, c, e = xy, xz, yz
    r0, r1, r2 = s * mx - x1, s * my - y1, s * mz - z1
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * c00 + b * c01 + c * c02
    if not determinant > 0:
        return mx, my, mz
    c11, c12, c22 = a * f - c * c, b * c - a * e, a * d - b * b
    return (
        (c00 * r0 + c01 * r1 + c02 * r2) / determinant,
        (c01 * r0 + c11 * r1 + c12 * r2) / determinant,
        (c02 * r0 + c12 * r1 + c22 * r2) / determinant,
    )


@kernel
def _collapse(
    points: Points,
    faces: Faces,
    starts: Integers,
    around: Integers,
    quadrics: Floats,
    weights: Floats,
    sizes: Floats,
    kept: Indices,
    edges: Indices,
    order: Indices,
    places: Points,
    most: int,
) -> int:
    """Collapse edges in this order as long as they do not touch one another; returns their number."""
    touched = np.zeros(len(points), np.bool_)
    mark = np.full(len(points), -1, np.int64)
    removed = 0
    for e in order:
        a, b = edges[e, 0], edges[e, 1]
        if touched[a] or touched[b]:
            continue
        shared = 0
        for i in range(starts[a], starts[a + 1]):
            f = around[i]
            for k in range(3):
                mark[faces[f, k]] = 2 * e
            if faces[f, 0] == b or faces[f, 1] == b or faces[f, 2] == b:
                shared += 1
        common = 0
        for i in range(starts[b], starts[b + 1]):
            f = around[i]
            for k in range(3):
                v = faces[f, k]
                if mark[v] == 2 * e and v != a and v != b:
                    common += 1
                    mark[v] = 2 * e + 1
        if shared == 0 or common != shared:
            continue
        longest = LONGEST * min(sizes[a], sizes[b])
        place = places[e]
        fans = points, faces, starts, around
        if _spoils(fans, a, b, place, longest) or _spoils(fans, b, a, place, longest):
            continue
        for vertex in (a, b):
            for i in range(starts[vertex], starts[vertex + 1]):
                for k in range(3):
                    touched[faces[around[i], k]] = True
        for i in range(starts[b], starts[b + 1]):
            f = around[i]
            if faces[f, 0] == a or faces[f, 1] == a or faces[f, 2] == a:
                faces[f, 0] = faces[f, 1] = faces[f, 2] = -1
            else:
                for k in range(3):
                    if faces[f, k] == b:
                        faces[f, k] = a
        points[a, 0], points[a, 1], points[a, 2] = place[0], place[1], place[2]
        kept[a] = max(kept[a], kept[b])
        for k in range(10):
            quadrics[a, k] += quadrics[b, k]
        weights[a] += weights[b]
        sizes[a] = min(sizes[a], sizes[b])
        removed += 1
        if removed == most:
            break
    return removed


@kernel
def _spoils(
    fans: tuple[Points, Faces, Integers, Integers], vertex: int, other: int, place: Vector, longest: float
) -> bool:
    """Whether a face of `vertex` that stays would turn too far, vanish or outgrow `longest` with it at `place`."""
    points, faces, starts, around = fans
    x, y, z = points[vertex, 0], points[vertex, 1], points[vertex, 2]
    for i in range(starts[vertex], starts[vertex + 1]):
        f = around[i]
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if a == other or b == other or c == other:
            continue
        p, q = a, b
        if a == vertex:
            p, q = b, c
        elif b == vertex:
            p, q = c, a
        px, py, pz, qx, qy, qz = points[p, 0], points[p, 1], points[p, 2], points[q, 0], points[q, 1], points[q, 2]
        ax, ay, az = px - place[0], py - place[1], pz - place[2]
        bx, by, bz = qx - place[0], qy - place[1], qz - place[2]
        if max(_square(ax, ay, az), _square(bx, by, bz)) > longest * longest:
            return True
        u0, u1, u2 = _cross(px - x, py - y, pz - z, qx - x, qy - y, qz - z)
        v0, v1, v2 = _cross(ax, ay, az, bx, by, bz)
        product = u0 * v0 + u1 * v1 + u2 * v2
        if not product > LEAST_TURN * np.sqrt(_square(u0, u1, u2) * _square(v0, v1, v2)):
            return True
    return False


@kernel
def _cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float]:
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
