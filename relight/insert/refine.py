"""Local refinement of triangles without gaps: long edges are halved on both sides of every seam."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Integers, Mask, Points
from splat2mesh.scene.mesh import edges_of, halved

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
        edges = edges_of(corners)
        length = np.linalg.norm(points[edges[..., 0]] - points[edges[..., 1]], axis=-1)
        long = (length > longest) & wanted[edges].any(axis=-1)
        if not long.any():
            break
        corners, parents = halved(corners, long, len(points))
        rounds.append(parents)
        points = np.concatenate([points, points[parents].mean(axis=1)])
        wanted = np.concatenate([wanted, wanted[parents].any(axis=1)])
    return np.concatenate([others, corners]).astype(np.int32), rounds


def carried(values: NDArray, rounds: list[Integers]) -> NDArray:
    """Values (V, ...) of vertices, followed by those of new vertices, the means of their parents'."""
    for parents in rounds:
        values = np.concatenate([values, values[parents].mean(axis=1, dtype=np.float64).astype(values.dtype)])
    return values
