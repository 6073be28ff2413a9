"""Patches of the surface that the views of a place see, about as wide as its fog is thick: over them noise cancels."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Directions, Floats, Indices, Mask, Points, Vector
from ..base.cells import CELLS, keys_of
from .sight import LEAST_COSINE, Sighting

EVERY = 4
"""Every so many rows and columns of a depth map count."""

LEAST_AGREEMENT = 0.5
"""Length of the mean of unit normals below which a patch has none: they would be 60 degrees from it."""


class SeenPatches(NamedTuple):
    """Mean points (S, 3) and unit mean normals (S, 3) float64 of what lies in each of some cubes and faces one of the
    six ways that its sides do. thickness, scatter, areas: (S,), mean of it, standard deviation of heights over the mean
    plane, and sum. cells: (S,), the cubes, of a side about an origin."""

    points: Points
    normals: Directions
    thickness: Floats
    scatter: Floats
    areas: Floats
    cells: Indices
    origin: Vector
    side: float

    @classmethod
    def of(cls, points: Points, normals: Directions, thickness: Floats, areas: Floats, side: float) -> "SeenPatches":
        """Of points (M, 3) with unit normals (M, 3) float64 on a surface of a thickness (M,), by their areas (M,)."""
        origin = np.median(points, axis=0) - side / 2 if len(points) else np.zeros(3)
        facing = np.abs(normals).argmax(axis=1)
        facing = 2 * facing + (normals[np.arange(len(facing)), facing] > 0)
        keys, patch = np.unique(6 * _cells(points, origin, side) + facing, return_inverse=True)
        sums = np.asarray(np.bincount(patch.ravel(), areas, len(keys)), np.float64)

        def means(values: Floats) -> NDArray[np.float64]:
            columns = [np.bincount(patch.ravel(), column * areas, len(keys)) for column in values.T]
            return np.stack(columns, axis=1) / np.maximum(sums, 1e-300)[:, None]

        middle, way, thick = means(points), means(normals), means(thickness[:, None])[:, 0]
        length = np.linalg.norm(way, axis=1)
        way /= np.maximum(length, 1e-300)[:, None]
        heights = ((points - middle[patch.ravel()]) * way[patch.ravel()]).sum(axis=1)
        scatter = np.sqrt(means(heights[:, None] ** 2)[:, 0])
        kept = (length > LEAST_AGREEMENT) & (sums > 0)
        return cls(middle, way, thick, scatter, sums, keys // 6, origin, side).take(kept)

    @classmethod
    def seen(cls, shots: Sequence[Sighting], distance: float, side: float) -> "SeenPatches":
        """Of what Sightings show. distance: typical of the place: what is much farther away counts less, and what looks
        thick, as in the fusion."""
        parts = [_samples(shot, distance) for shot in shots]
        points, normals, thickness, areas = (np.concatenate(each) for each in zip(*parts, strict=True))
        return cls.of(points, normals, thickness, areas, side)

    def take(self, rows: Mask) -> "SeenPatches":
        """Some of them, (S,) bool."""
        points, normals, thickness = self.points[rows], self.normals[rows], self.thickness[rows]
        others = self.scatter[rows], self.areas[rows], self.cells[rows]
        return SeenPatches(points, normals, thickness, *others, self.origin, self.side)

    def cells_of(self, points: Points) -> Indices:
        """The cells of points (N, 3): (N,)."""
        return _cells(points, self.origin, self.side)


def _cells(points: Points, origin: Vector, side: float) -> Indices:
    return keys_of(np.clip(np.floor((points - origin) / side), -(CELLS // 2), CELLS // 2 - 1))


def _samples(shot: Sighting, distance: float) -> tuple[Points, Directions, Floats, Floats]:
    """Points (M, 3), normals (M, 3), thickness (M,) and areas (M,) of some pixels of a Sighting."""
    view, seen = shot.view, shot.seen
    some = np.s_[EVERY // 2 :: EVERY, EVERY // 2 :: EVERY]
    rays, depth, spread = view.ray_directions()[some], seen.depth[some].astype(np.float64), seen.spread[some]
    known = np.isfinite(depth) & np.isfinite(spread)
    rays, depth, normals = rays[known], depth[known], seen.normal[some][known].astype(np.float64)
    cosine = -(rays * normals).sum(axis=1) / np.linalg.norm(rays, axis=1)
    trust = seen.sharpness()[some][known] / (1 + (depth / (2 * distance)) ** 2)
    areas = trust * depth**2 * np.maximum(cosine, 0) / np.maximum(cosine, LEAST_COSINE)
    return view.center + rays * depth[:, None], normals, shot.thickness[some][known].astype(np.float64), areas
