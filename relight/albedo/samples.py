"""Places on a scene's surface that sample its capture light, the sky that each sees, and their neighbours."""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Indices, Mask
from splat2mesh.base.sphere import fibonacci_sphere

from ..transfer.facing import met_in_front
from ..transfer.neighbors import ranked_nodes
from ..transfer.occluder import Occluder

SAMPLES = 2500
"""Places. Other numbers were not tried; the time of the fit is proportional to it."""

DIRECTIONS = 1024
"""Directions of the sky, shared by all sample points."""

MIN_VISIBLE = 0.15
"""Least visible part of the cosine-weighted sky: with less, errors of the mesh outweigh the light."""

MAX_BEHIND = 0.3
"""Largest share of a point's hits on back faces; with more, the point is inside a body or under a floor."""

SPARE = 1.2
"""Factor of tried points per wanted point, since not all are usable."""

NEIGHBORS = 8
SPACINGS = (1, 4, 16)
"""Each place is compared to its 8 nearest among all places, among each fourth and among each sixteenth."""

BATCH = 256
"""Places traced at a time: 6 MB of rays."""

_AREA_GRID = 2.0**44  # parts of the squared diagonal that areas are rounded to, so that no sum depends on an order


class Samples(NamedTuple):
    """N places. vertices: (N,) indices. sky: (N, K) float32, cosine-weighted visibility of K directions, which sums
    to the visible fraction. directions: (K, 3) float64, unit. pairs: (P, 2) int64 of places. weights: (P,), sum 1."""

    vertices: NDArray[np.int64]
    sky: NDArray[np.float32]
    directions: NDArray[np.float64]
    pairs: NDArray[np.int64]
    weights: NDArray[np.float64]


def vertex_areas(occluder: Occluder) -> NDArray[np.float64]:
    """Area of the surface around every vertex, (V,) float64, as a part of the squared diagonal.

    Sums of whole numbers: they depend on no order of vertices or faces.
    """
    a, b, c = (occluder.origins[occluder.faces[:, corner]].astype(np.float64) for corner in range(3))
    twice = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    third = np.rint(np.minimum(np.nan_to_num(twice), 2.0) / 6.0 * _AREA_GRID)
    areas = np.zeros(len(occluder.origins))
    for corner in range(3):
        areas += np.bincount(occluder.faces[:, corner], third, len(areas))
    return areas / _AREA_GRID


def places(occluder: Occluder, areas: Floats, usable: Mask, count: int, seed: int) -> NDArray[np.int64]:
    """Vertices (N,) spread evenly over the area of those `usable`, (V,) bool, in order along a curve through space.

    The same places in any order of vertices and any division into chunks.
    """
    order, new_node, _ = ranked_nodes(occluder.origins, occluder.normals)
    node = np.cumsum(new_node) - 1
    shares = np.bincount(node, np.where(usable, areas, 0.0)[order])
    reached = np.cumsum(shares)
    if not reached[-1] > 0.0:
        return np.zeros(0, np.int64)
    shift = np.random.default_rng(seed).random()
    at = np.searchsorted(reached, (np.arange(count) + shift) / count * reached[-1], side="right")
    chosen = np.unique(np.minimum(at, len(shares) - 1))
    copies = np.where(usable[order], np.arange(len(order)), len(order))
    first = np.full(len(shares), len(order))
    np.minimum.at(first, node, copies)
    return order[first[chosen]]


def sky_of(
    occluder: Occluder, vertices: Indices, directions: Directions
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """(N, K) float32: (4 / K) max(0, n d) where the direction is free, and the share (N,) of hits met from behind."""
    sky = np.zeros((len(vertices), len(directions)), np.float32)
    behind = np.zeros(len(vertices))
    toward = np.ascontiguousarray(directions, np.float32)
    for start in range(0, len(vertices), BATCH):
        some = vertices[start : start + BATCH]
        cosine = occluder.normals[some] @ toward.T
        place, direction = np.nonzero(cosine > 0.0)
        rays = np.hstack([occluder.origins[some][place], toward[direction]])
        hits = occluder.first_hits(rays)
        weight = cosine[place, direction] * np.float32(4.0 / len(directions))
        sky[start + place, direction] = np.where(hits.faces < 0, weight, np.float32(0.0))
        wrong_side = (hits.faces >= 0) & ~met_in_front(occluder, hits, toward[direction])
        total = np.bincount(place, weight * (hits.faces >= 0), len(some))
        wrong = np.bincount(place, weight * wrong_side, len(some))
        behind[start : start + len(some)] = wrong / np.maximum(total, 1e-12) * (total > 0.0)
    return sky, behind


def neighbor_pairs(positions: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Pairs (P, 2) of places and their weights (P,), which sum to 1: each spacing has the same total."""
    found, weights = [], []
    for spacing in SPACINGS:
        some = np.arange(0, len(positions), spacing)
        near = min(NEIGHBORS + 1, len(some))
        if near < 2:
            continue
        _, index = scipy.spatial.cKDTree(positions[some]).query(positions[some], near)
        ends = np.stack([np.repeat(some, near - 1), some[index[:, 1:]].ravel()], axis=1)
        ends = np.unique(np.sort(ends, axis=1), axis=0)
        ends = ends[ends[:, 0] != ends[:, 1]]
        found.append(ends)
        weights.append(np.full(len(ends), 1.0 / max(len(ends), 1)))
    if not found:
        return np.zeros((0, 2), np.int64), np.zeros(0)
    return np.concatenate(found), np.concatenate(weights) / len(found)


def take(occluder: Occluder, areas: Floats, usable: Mask, seed: int) -> Samples:
    """The Samples of a scene among its usable vertices, (V,) bool; there may be few, or none."""
    count, directions = SAMPLES, fibonacci_sphere(DIRECTIONS)
    tried = places(occluder, areas, usable, round(SPARE * count), seed)
    sky, behind = sky_of(occluder, tried, directions)
    good = np.flatnonzero((sky.sum(axis=1) > MIN_VISIBLE) & (behind < MAX_BEHIND))
    if len(good) > count:  # evenly along the curve
        good = good[(np.arange(count) * len(good)) // count]
    vertices = tried[good]
    pairs, weights = neighbor_pairs(occluder.origins[vertices].astype(np.float64))
    return Samples(vertices, sky[good], directions, pairs, weights)
