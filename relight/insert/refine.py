"""Local refinement of triangles without gaps: long edges are halved on both sides of every seam."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Integers, Mask, Points

MOST_ROUNDS = 12
"""Rounds of halving: an edge becomes at most 4,096 edges."""


def refined(
    points: Points,  # (V, 3)
    faces: Faces,  # (F, 3)
    longest: float,  # length up to which edges stay
    most_faces: int,  # no round begins with more
    wanted: Mask | None = None,  # (V,) bool: edges between two others stay whole
) -> tuple[Faces, list[Integers]]:
    """Halve long edges, round after round: the new faces, and the parents (M, 2) of the vertices of each round. A new
    vertex lies halfway between its parents, after all earlier vertices. See `carried`."""
    points, corners = np.asarray(points, np.float64), faces.astype(np.int64)
    wanted = np.ones(len(points), bool) if wanted is None else wanted
    rounds: list[Integers] = []
    near = wanted[corners].any(axis=1)  # no other face has an edge that is halved
    others, corners = corners[~near], corners[near]
    for _ in range(MOST_ROUNDS):
        if len(corners) + len(others) > most_faces:
            break
        edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1)
        length = np.linalg.norm(points[edges[..., 0]] - points[edges[..., 1]], axis=-1)
        halved = (length > longest) & wanted[edges].any(axis=-1)
        if not halved.any():
            break
        corners, parents = _halved(corners, edges, halved, len(points))
        rounds.append(parents)
        points = np.concatenate([points, points[parents].mean(axis=1)])
        wanted = np.concatenate([wanted, wanted[parents].any(axis=1)])
    return np.concatenate([others, corners]).astype(np.int32), rounds


def carried(values: NDArray, rounds: list[Integers]) -> NDArray:
    """Values (V, ...) of vertices, followed by those of new vertices, the means of their parents'."""
    for parents in rounds:
        values = np.concatenate([values, values[parents].mean(axis=1, dtype=np.float64).astype(values.dtype)])
    return values


def unit(normals: NDArray) -> NDArray[np.float32]:
    """Normals (V, 3) at unit length; zero normals stay."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, length, out=np.array(normals, np.float32), where=length > 0.0)


def _halved(faces: Integers, edges: Integers, halved: Mask, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Faces whose edges (F, 3, 2) are halved where a mask (F, 3) says, and the parents (M, 2) of the new vertices."""
    keys = np.sort(edges, axis=-1) @ np.array([count, 1])
    found = np.unique(keys[halved])
    place = np.minimum(np.searchsorted(found, keys), len(found) - 1)
    cut = found[place] == keys  # an edge is halved in all its faces
    middle = place + count
    first = np.select([cut.sum(axis=1) == 1, cut.sum(axis=1) == 2], [cut.argmax(axis=1), (~cut).argmax(axis=1)], 0)
    turn = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, turn, axis=1).T
    ab, bc, ca = np.take_along_axis(middle, turn, axis=1).T
    parts = [[(a, b, c)], [(a, ab, c), (ab, b, c)], [(a, b, bc), (a, bc, ca), (ca, bc, c)]]
    parts.append([(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)])
    of_face = [[np.stack(corners, axis=1) for corners in each] for each in parts]
    number = cut.sum(axis=1)
    pieces = [made[number == cuts] for cuts, each in enumerate(of_face) for made in each]
    return np.concatenate(pieces), np.stack([found // count, found % count], axis=1)
