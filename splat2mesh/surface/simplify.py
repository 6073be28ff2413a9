"""Decimation by a size field: every part of a mesh loses detail in units of its own cells, near parts as far ones.

Quadric edge collapse (Garland and Heckbert, "Surface Simplification Using Quadric Error Metrics", 1997) in rounds of
collapses that do not touch one another, so that the result is the same whatever the number of threads.
"""

import numba
import numpy as np

LONGEST = 6.0
"""Length in cells that no edge outgrows: colours need vertices on flat ground too."""

CHEAPEST = 0.35
"""Share of the edges, the cheapest, that a round considers."""

SLOWEST = 0.002
"""Share of the vertices that a round must remove for another one to follow."""

STIFF, SHORT = 1e-3, 1e-4
"""Pull towards an edge's middle where its planes leave the place open, and the preference for short edges."""

LEAST_TURN = 0.2
"""Cosine by which a face may turn in one collapse."""

_function = numba.njit(cache=True, nogil=True, error_model="numpy")


def simplify(points, faces, sizes, wanted, fixed=None):
    """Remove vertices until `wanted` are left, or nothing more can go.

    points: (V, 3) float64. faces: (F, 3) int32. sizes: (V,) side of the cell at each vertex. fixed: (V,) bool, which
    stay where they are, with the edges between them; none without.
    Returns points (V', 3), faces (F', 3) int32, sizes (V',) and, where `fixed` is given, which fixed vertex each is
    (V',), -1 for none.
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
        border = np.zeros(len(points), bool)
        border[edges[uses == 1].ravel()] = True
        border |= kept >= 0
        open_edges = (uses == 1) & (kept[edges] < 0).all(axis=1)
        costs, places = np.empty(len(edges)), np.empty((len(edges), 3))
        _costs(points, edges, quadrics, weights, sizes, border, open_edges, costs, places)
        finite = np.isfinite(costs)
        if not finite.any():
            break
        count = max(int(CHEAPEST * finite.sum()), 1)
        limit = np.partition(costs[finite], count - 1)[count - 1]
        order = np.flatnonzero(costs <= limit)
        order = order[np.argsort(costs[order], kind="stable")]
        starts, around = _faces_around(faces, len(points))
        removed = _collapse(
            points, faces, starts, around, quadrics, weights, sizes, kept, edges, order, places, left - wanted
        )
        faces = faces[faces[:, 0] >= 0]
        left -= removed
        if removed < max(SLOWEST * left, 1):
            break
        edges, uses = _edges(faces, len(points))
    used, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int32)
    if fixed is None:
        return points[used] + middle, faces, sizes[used]
    return points[used] + middle, faces, sizes[used], kept[used]


def _edges(faces, count):
    """Each edge once, (E, 2) int64, smaller end first, and how many faces it has."""
    starts, ends = faces.T.ravel().astype(np.int64), np.roll(faces, -1, axis=1).T.ravel().astype(np.int64)
    key, uses = np.unique(np.minimum(starts, ends) * count + np.maximum(starts, ends), return_counts=True)
    return np.stack([key // count, key % count], axis=1), uses


def _faces_around(faces, count):
    """For each vertex where its faces begin in a list, and the list."""
    corners = faces.ravel()
    around = np.argsort(corners, kind="stable") // 3
    return np.concatenate([[0], np.cumsum(np.bincount(corners, minlength=count))]), around


@_function
def _add_quadrics(points, faces, borders, quadrics, weights):
    """The planes of all faces, by area, and upright planes through border edges, at their corners."""
    for f in range(len(faces)):
        a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
        n = np.cross(b - a, c - a)
        area = np.sqrt((n * n).sum())
        if area > 0:
            for k in range(3):
                _add_plane(quadrics[faces[f, k]], n / area, -(n * a).sum() / area, area / 2)
                weights[faces[f, k]] += area / 2
    for e in range(len(borders)):
        i, j = borders[e]
        along = points[j] - points[i]
        length = np.sqrt((along * along).sum())
        if length > 0:
            for axis in range(3):  # all that is across the edge: three planes less what runs along it
                n = np.zeros(3)
                n[axis] = 1.0
                n -= along * along[axis] / (length * length)
                size = np.sqrt((n * n).sum())
                if size > 1e-6:
                    n /= size
                    d = -(n * points[i]).sum()
                    _add_plane(quadrics[i], n, d, length * length / 2)
                    _add_plane(quadrics[j], n, d, length * length / 2)


@_function
def _add_plane(q, n, d, weight):
    x, y, z = n
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


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def _costs(points, edges, quadrics, weights, sizes, border, on_border, costs, places):
    """What the collapse of each edge costs, in squared cells, and where its vertex would lie; inf: not at all."""
    for e in numba.prange(len(edges)):
        a, b = edges[e]
        q, weight, size = quadrics[a] + quadrics[b], weights[a] + weights[b], min(sizes[a], sizes[b])
        along = points[b] - points[a]
        length2 = (along * along).sum()
        costs[e] = np.inf
        if length2 > (LONGEST * size) ** 2 or not weight > 0 or (border[a] and border[b] and not on_border[e]):
            continue
        middle = (points[a] + points[b]) / 2
        if border[a] != border[b]:
            place = points[a] if border[a] else points[b]
        else:
            place = _best(q, weight, middle)
            shift = place - middle
            if (shift * shift).sum() > length2:
                place = middle
        x, y, z = place
        error = (
            q[0] * x * x + 2 * q[1] * x * y + 2 * q[2] * x * z + q[3] * y * y + 2 * q[4] * y * z + q[5] * z * z
            + 2 * (q[6] * x + q[7] * y + q[8] * z) + q[9]
        )  # fmt: skip
        costs[e] = max(error, 0.0) / (weight * size * size) + SHORT * length2 / (size * size)
        for k in range(3):
            places[e, k] = place[k]


@_function
def _best(q, weight, middle):
    """The place of least error, drawn a little towards the middle: it solves (A + s I) x = s middle - b."""
    s = STIFF * weight
    a, b, c, d, e, f = q[0] + s, q[1], q[2], q[3] + s, q[4], q[5] + s
    r0, r1, r2 = s * middle[0] - q[6], s * middle[1] - q[7], s * middle[2] - q[8]
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * c00 + b * c01 + c * c02
    if not determinant > 0:
        return middle.copy()
    c11, c12, c22 = a * f - c * c, b * c - a * e, a * d - b * b
    return (
        np.array([c00 * r0 + c01 * r1 + c02 * r2, c01 * r0 + c11 * r1 + c12 * r2, c02 * r0 + c12 * r1 + c22 * r2])
        / determinant
    )


@_function
def _collapse(
    points, faces, starts, around, quadrics, weights, sizes, kept, edges, order, places, most
):  # fmt: skip
    """Collapse edges in this order as long as they do not touch one another; returns their number."""
    touched = np.zeros(len(points), np.bool_)
    mark = np.full(len(points), -1, np.int64)
    removed = 0
    for e in order:
        a, b = edges[e]
        if touched[a] or touched[b]:
            continue
        shared = 0
        for i in range(starts[a], starts[a + 1]):
            f = faces[around[i]]
            for k in range(3):
                mark[f[k]] = 2 * e
            if f[0] == b or f[1] == b or f[2] == b:
                shared += 1
        common = 0
        for i in range(starts[b], starts[b + 1]):
            f = faces[around[i]]
            for k in range(3):
                if mark[f[k]] == 2 * e and f[k] != a and f[k] != b:
                    common += 1
                    mark[f[k]] = 2 * e + 1
        if shared == 0 or common != shared:
            continue
        longest = LONGEST * min(sizes[a], sizes[b])
        if _spoils(points, faces, starts, around, a, b, places[e], longest):
            continue
        if _spoils(points, faces, starts, around, b, a, places[e], longest):
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
        points[a] = places[e]
        kept[a] = max(kept[a], kept[b])
        quadrics[a] += quadrics[b]
        weights[a] += weights[b]
        sizes[a] = min(sizes[a], sizes[b])
        removed += 1
        if removed == most:
            break
    return removed


@_function
def _spoils(points, faces, starts, around, vertex, other, place, longest):
    """Whether a face of `vertex` that stays would turn too far, vanish or outgrow `longest` with it at `place`."""
    for i in range(starts[vertex], starts[vertex + 1]):
        f = faces[around[i]]
        if f[0] == other or f[1] == other or f[2] == other:
            continue
        k = 0 if f[0] == vertex else 1 if f[1] == vertex else 2
        p, q = points[f[(k + 1) % 3]], points[f[(k + 2) % 3]]
        if max(((p - place) ** 2).sum(), ((q - place) ** 2).sum()) > longest * longest:
            return True
        before, after = np.cross(p - points[vertex], q - points[vertex]), np.cross(p - place, q - place)
        product = (before * after).sum()
        if not product > LEAST_TURN * np.sqrt((before * before).sum() * (after * after).sum()):
            return True
    return False
