"""From a raw surface to a clean triangle mesh of a wanted size: components, holes, decimation, ragged borders."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..base.arrays import Faces, Mask, Points
from ..scene.leaves import connected
from ..scene.mesh import edge_keys

SMALLEST_COMPONENT = 0.02
"""Connected parts with fewer triangles than this share of the largest part's are floaters and are dropped."""

SMALLEST_FACES = 100
"""Faces of the raw surface of a place below which a part that hangs on nothing is a floater, however large the whole
is."""


def drop_small_components(mesh: Any) -> int:
    """Remove disconnected parts that are small beside the largest one; returns how many were removed."""
    cluster, sizes, _ = mesh.cluster_connected_triangles()
    cluster, sizes = np.asarray(cluster), np.asarray(sizes)
    small = sizes < SMALLEST_COMPONENT * sizes.max(initial=0)
    mesh.remove_triangles_by_mask(small[cluster])
    mesh.remove_unreferenced_vertices()
    return int(small.sum())


def without_floaters(faces: Faces, fixed: Mask) -> tuple[Faces, int]:
    """Faces without parts of less than SMALLEST_FACES, and how many parts went. Parts with a `fixed` vertex, (V,) bool,
    stay: they go on beyond these faces."""
    if not len(faces):
        return faces, 0
    part = connected(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]]), len(fixed))
    sizes = np.bincount(part[faces[:, 0]], minlength=int(part.max()) + 1)
    small = (sizes < SMALLEST_FACES) & (sizes > 0)
    small[np.unique(part[np.flatnonzero(fixed)])] = False
    return faces[~small[part[faces[:, 0]]]], int(small.sum())


def fill_holes(
    points: Points,
    faces: Faces,
    longest: float,
    fixed: Mask | None = None,
    are_open: Callable[[list[Points]], Mask] | None = None,
) -> tuple[Points, Faces, int]:
    """Close the holes whose border is at most `longest` long: points and faces with those added, and their number.
    Those at `fixed` vertices, (V,) bool, stay open, and those that `are_open` says are none, by their borders (C, 3).

    Each is closed by a fan around the middle of its border: pinholes and slits where views disagreed vanish, while
    what was never seen stays open. Where a border touches itself, its loops are holes of their own.
    """
    new_points: list[Points] = []
    new_faces: list[tuple[int, int, int]] = []
    loops = []
    for loop in _border_loops(faces, len(points)):
        corners = points[loop]
        if len(loop) < 3 or np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum() > longest:
            continue
        if fixed is None or not fixed[loop].any():
            loops.append(loop)
    left = are_open([points[loop] for loop in loops]) if are_open is not None else np.zeros(len(loops), bool)
    for loop in (loop for loop, stays in zip(loops, left, strict=True) if not stays):
        corners = points[loop]
        middle = len(points) + len(new_points)
        new_points.append(corners.mean(axis=0))
        new_faces += [(after, before, middle) for before, after in zip(loop, [*loop[1:], loop[0]], strict=True)]
    if new_points:
        points, faces = np.concatenate([points, new_points]), np.concatenate([faces, np.array(new_faces, faces.dtype)])
    return points, faces, len(new_points)


def _border_loops(faces: Faces, count: int) -> Iterator[list[int]]:
    """The closed loops of border edges, lists of vertices in the direction of the faces, each vertex once."""
    following: dict[int, list[int]] = {}
    for start, end in zip(*(ends.tolist() for ends in _border_edges(faces, count)), strict=True):
        following.setdefault(start, []).append(end)
    for start in list(following):
        path: list[int] = []
        place: dict[int, int] = {}
        vertex = start
        while True:
            if vertex in place:  # back where the path has been: that part of it is a loop
                loop = path[place[vertex] :]
                yield loop
                for left in loop:
                    del place[left]
                del path[len(path) - len(loop) :]
            place[vertex] = len(path)
            path.append(vertex)
            if not following.get(vertex):
                break
            vertex = following[vertex].pop()


def _border_edges(faces: Faces, count: int) -> tuple[Faces, Faces]:
    """Edges of one face only, in that face's direction: starts and ends, (E,) each."""
    _, edge, uses = np.unique(edge_keys(faces, count), return_inverse=True, return_counts=True)
    alone = (uses[edge.ravel()] == 1).reshape(faces.shape).T
    return faces.T[alone], np.roll(faces, -1, axis=1).T[alone]


def trim_borders(faces: Faces, seen: Mask) -> Faces:
    """Faces (F', 3) without the ragged flaps at open borders: what hangs there and no view sees, (V,) bool, goes. It
    goes face by face from the border inwards, up to the first vertex that was seen; inner vertices always stay."""
    kept = np.ones(len(faces), bool)
    rows = np.flatnonzero(~seen[faces].all(axis=1))  # borders elsewhere are seen
    while len(rows):
        loose = np.zeros(len(seen), bool)
        loose[_border_edges(faces[rows], len(seen))[0]] = True
        loose &= ~seen
        hanging = loose[faces[rows]].any(axis=1)
        if not hanging.any():
            break
        kept[rows[hanging]] = False
        rows = rows[~hanging]
    return faces[kept]
