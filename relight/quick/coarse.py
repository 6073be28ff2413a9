"""Places on the surface of a capture without a mesh: Gaussians that stand for their surroundings, and what they see.

Normals are the common shortest axis of Gaussians around a place. Rays march through the opacity of space.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Mask, Points
from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.capture import Capture
from splat2mesh.render.opacitygrid import CELLS, OUTER_CELLS, OpacityGrid
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.splats import SH_C0, SOLID, Splats
from splat2mesh.views.viewpoints import bounds_of

from ..albedo.evidence import LitPlaces
from ..albedo.samples import DIRECTIONS as SKY_DIRECTIONS
from ..albedo.samples import neighbor_pairs

PLACES = 4000
"""That carry the change of light. Twice as many take twice the time."""

LEAST_PLACES = 100
"""Fewer tell nothing of a light."""

DIRECTIONS = SKY_DIRECTIONS // 2
"""Of light, and to tell on which side of a surface the air is: half as many as the estimate of the captured
light of a mesh has."""


COARSER = 8
"""Times fewer cells for the opacity of space than standpoints are found with."""

AROUND = 16
"""Gaussians whose shape and colour count at a place."""

STEP = 2.0
"""Cells that rays start before the surface, out of its own opacity."""


class CoarseSurface(NamedTuple):
    """N places. points, normals: (N, 3) float64, splat frame. captured: (N, 3) linear. sky: (N, K) float32
    cosine-weighted visibility of directions (K, 3) of the scene frame. bounced: (N, 3), light of other surfaces. grid:
    the opacity of space."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    captured: NDArray[np.float64]
    sky: NDArray[np.float32]
    directions: NDArray[np.float64]
    bounced: NDArray[np.float64]
    grid: OpacityGrid

    @property
    def lit(self) -> LitPlaces:
        """The same for an estimate of the captured light."""
        pairs, weights = neighbor_pairs(self.points)
        return LitPlaces(self.sky, self.directions, self.captured, self.bounced, self.normals, pairs, weights)

    @property
    def visible(self) -> NDArray[np.float64]:
        """(N,) cosine-weighted part of the sky that is seen."""
        return np.asarray(self.sky.sum(axis=1), np.float64)

    def turned_light(self, radiance: Floats) -> NDArray[np.float64]:
        """(N, 3) direct light of radiance (K, 3)."""
        return np.asarray(self.sky @ radiance.astype(np.float32), np.float64)


def coarse_surface(capture: Capture, seed: int = 0) -> CoarseSurface:
    """The CoarseSurface of a Capture. Raises InputError for one without a surface."""
    grid = OpacityGrid.around(
        near_splats(capture), bounds_of(capture.foreground), CELLS // COARSER, OUTER_CELLS // COARSER
    )
    turn = capture.rotation[:3, :3]
    plain = replace(capture.foreground, sh=capture.foreground.sh[:, :1])
    solid = plain.take(np.flatnonzero(plain.opacities > SOLID))
    if len(solid) < LEAST_PLACES:
        raise InputError(f"only {len(solid)} of its splats are solid")
    rows = _chosen(solid, np.random.default_rng(seed))
    tree = scipy.spatial.cKDTree(solid.means)
    around = tree.query(solid.means[rows], min(AROUND, len(solid)))[1]
    points = np.asarray(solid.means[rows], np.float64)
    normals = _normals(solid, around)
    step = STEP * float(grid.cells[0])
    eyes = np.array([eye.center for eye in capture.standing.eyes])
    side, seen = _sides(grid, points, normals, step, eyes)
    if seen.sum() < LEAST_PLACES:
        raise InputError("hardly any of its surface was seen")
    points, normals, around = points[seen], (side[:, None] * normals)[seen], around[seen]
    directions = fibonacci_sphere(DIRECTIONS)
    met = grid.march(points + step * normals, directions @ turn)[0]
    cosine = np.maximum(normals @ turn.T @ directions.T, 0.0)
    sky = np.where(np.isinf(met), 4.0 / DIRECTIONS * cosine, 0.0).astype(np.float32)
    shown = np.clip(solid.sh[around, 0] * SH_C0 + 0.5, 0.0, 1.0).mean(axis=1)
    captured = np.maximum(linear_from_srgb(shown.astype(np.float32)).astype(np.float64), 1e-4)
    hidden = 1.0 - np.minimum(sky.sum(axis=1, dtype=np.float64), 1.0)
    bounced = hidden[:, None] * captured.mean(axis=0)
    return CoarseSurface(points, normals @ turn.T, captured, sky, directions, bounced, grid)


def near_splats(capture: Capture) -> Splats:
    """The splats of a Capture that are not far background, without what depends on the view."""
    plain = replace(capture.splats, sh=capture.splats.sh[:, :1])
    return plain.take(np.flatnonzero(~capture.far)) if capture.far.any() else plain


def _chosen(solid: Splats, rng: np.random.Generator) -> NDArray[np.int64]:
    """Rows that are spread over the surface: by the area of Gaussians, none of which counts more than most do."""
    scales = np.sort(solid.scales, axis=1)
    area = scales[:, 1] * scales[:, 2] * solid.opacities
    area = np.minimum(area, np.percentile(area, 95)).astype(np.float64)
    count = min(PLACES, int((area > 0).sum()))
    return np.asarray(np.sort(rng.choice(len(solid), count, replace=False, p=area / area.sum())))


def _normals(solid: Splats, around: NDArray[np.int64]) -> NDArray[np.float64]:
    """(N, 3) unit, of unknown sign: the direction that the shortest axes of Gaussians (N, k) around share."""
    shortest = solid.scales.argmin(axis=1)
    axes = np.take_along_axis(solid.rotation_matrices(), shortest[:, None, None], axis=2)[:, :, 0].astype(np.float64)
    scales = np.sort(solid.scales, axis=1)
    flat = (1.0 - scales[:, 0] / np.maximum(scales[:, 1], 1e-12)) * solid.opacities  # needles and balls have no normal
    axes, weight = axes[around], flat[around].astype(np.float64)
    tensor = np.einsum("nk,nki,nkj->nij", weight, axes, axes)
    positions = solid.means[around].astype(np.float64)
    off = positions - positions.mean(axis=1, keepdims=True)
    spread = np.einsum("nki,nkj->nij", off, off)
    spread /= np.maximum(np.trace(spread, axis1=1, axis2=2), 1e-30)[:, None, None]
    tensor -= weight.sum(axis=1)[:, None, None] * spread  # where centres spread, no normal points
    return np.linalg.eigh(tensor)[1][:, :, 2]


def _sides(
    grid: OpacityGrid, points: Points, normals: Points, step: float, eyes: Points
) -> tuple[NDArray[np.float64], Mask]:
    """1 or -1, (N,), so that normals point to where the capture stood, without eyes to where more of space is open; and
    whether that side was seen, (N,) bool."""
    directions = fibonacci_sphere(DIRECTIONS)
    seen = []
    for side in (1.0, -1.0):
        start = points + side * step * normals
        distance = grid.march(start, directions)[0]
        if len(eyes):
            seen.append(_share_of_eyes(eyes, start, side * normals, directions, distance))
        else:
            cosine = np.maximum(side * normals @ directions.T, 0.0)
            seen.append((np.isinf(distance) * cosine).sum(axis=1))
    return np.where(seen[0] >= seen[1], 1.0, -1.0), np.maximum(*seen) > 0.0


def _share_of_eyes(eyes: Points, points: Points, normals: Points, directions: Points, distance: Floats) -> Floats:
    """(N,) part of the eyes that nothing hides, by the nearest of the directions with known distances (N, K)."""
    total = np.zeros(len(points))
    for eye in eyes:
        way = eye - points
        nearest = (way @ directions.T).argmax(axis=1)
        free = np.take_along_axis(distance, nearest[:, None], axis=1)[:, 0] > np.linalg.norm(way, axis=1)
        total += free & (np.einsum("ni,ni->n", way, normals) > 0.0)
    return total / len(eyes)
