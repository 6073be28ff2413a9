"""Sky that training left in the air before the background: near a roof, in the crown of a tree.

Sky has no texture, so nothing tells training how far away it is. Where it borders a roof or leaves, splats of it hang
as near as those. Under a new light they would be lit like surfaces and hang there as dark rags before a bright sky, or
as bright ones at night. Three facts identify them: they have the colour of the sky in their direction, they are coarse,
and from wherever people stand there is nothing behind them but sky.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Indices, Mask, Points, Vector
from splat2mesh.render.opacitygrid import BEFORE, OpacityGrid
from splat2mesh.splats.splats import Splats
from splat2mesh.views.panes import LEAST_OPEN
from splat2mesh.views.viewpoints import bounds_of

ALIKE = 0.2
"""Largest difference of a channel, in sRGB, between a splat and the sky in its direction. This number and those below
were chosen on a generated garden and a real field with a building."""

VOTES = 9
"""Neighbours that say what the sky is like in a direction."""

LEAST_EYES = 2
"""How many eyes see a splat at least. LEAST_OPEN of them see no surface behind it: of splats with the colour of the
sky, 31 of 4,042 and 106 of 13,636 exceed that; 92 and 93% of the others stay below a tenth."""

COARSE = 3.0
"""Least angular size, over the median of the far background for one of its splats, and of all splats for a nearer one.
Training leaves a sky coarse, while what stands against it, such as a white chimney or blossoms, is as fine as other
surfaces."""


class FromMiddle(NamedTuple):
    """How splats look from the middle of a scene. off: (N, 3) their places from there, distance: (N,) of these. colors:
    (N, 3) sRGB. sizes: (N,) about the solid angle, times the opacity."""

    off: Points
    distance: Floats
    colors: NDArray[np.float32]
    sizes: Floats

    @classmethod
    def of(cls, splats: Splats, middle: Vector) -> "FromMiddle":
        """How Splats look from a place (3,)."""
        finite = np.isfinite(splats.means).all(axis=1)[:, None]
        off = np.where(finite, splats.means - middle, np.float32(1.0)).astype(np.float64)
        distance = np.maximum(np.linalg.norm(off, axis=1), 1e-30)
        sizes = np.nan_to_num(splats.opacities * (splats.scales.max(axis=1) / distance) ** 2) + 1e-30
        return cls(off, distance, np.clip(splats.colors_diffuse, 0.0, 1.0), sizes)

    @property
    def directions(self) -> Points:
        return self.off / self.distance[:, None]


def hanging_sky(
    splats: Splats,  # every row of the source, in its frame
    far: Indices,  # (F,) far background
    sky: Indices,  # (K,) of all rows, known to be sky
    possible: Indices,  # (M,) other rows that have the place and hue of sky, but may be near
    middle: Vector,  # (3,) of the scene
    eyes: Points,  # (E, 3) where people stand
) -> Indices:
    """Return which rows are sky that hangs before the background, in order: some of `possible`."""
    if not len(sky) or not len(eyes):
        return possible[:0]
    sizes, distant = _sizes(splats, possible, eyes), np.isin(possible, far)
    coarse = np.where(distant, _coarse(splats, far, eyes), _coarse(splats, np.arange(len(splats)), eyes))
    rows = possible[sizes > coarse]
    rows = rows[_alike(*(FromMiddle.of(splats.take(some), middle) for some in (rows, sky)))]
    if not len(rows):
        return rows
    solid = np.ones(len(splats), bool)
    solid[sky] = solid[rows] = False
    solid &= np.isfinite(splats.means).all(axis=1)
    inner = solid.copy()
    inner[far] = False
    if not inner.any():
        return rows[:0]
    bounds = bounds_of(splats.take(np.flatnonzero(inner)))
    grid = OpacityGrid.around(splats.take(np.flatnonzero(solid)), bounds)
    return np.sort(rows[_free(grid, splats.means[rows].astype(np.float64), eyes)])


def _alike(some: FromMiddle, sky: FromMiddle) -> Mask:
    """Which splats have the colour of the sky in their direction: (M,) bool."""
    count = min(VOTES, len(sky.sizes))
    tree = scipy.spatial.cKDTree(sky.directions)
    around = tree.query(some.directions, count)[1].reshape(-1, count)
    weights = sky.sizes[around] / sky.sizes[around].sum(axis=1, keepdims=True)
    behind = np.einsum("nk,nkc->nc", weights, sky.colors[around])
    return np.asarray(np.abs(some.colors - behind).max(axis=1) < ALIKE)


def _sizes(splats: Splats, rows: Indices, eyes: Points) -> NDArray[np.float64]:
    """Middle extent of splats over the way from the nearest eye: (M,). Poles and edges are thin, however long."""
    means = splats.means[rows].astype(np.float64)
    nearest = scipy.spatial.cKDTree(eyes).query(means)[0]
    return np.asarray(np.sort(splats.scales[rows], axis=1)[:, 1] / np.maximum(nearest, 1e-30))


def _coarse(splats: Splats, rows: Indices, eyes: Points) -> float:
    """The size, as of `_sizes`, above which some splats (M,) count as coarse; inf without any."""
    rows = rows[np.isfinite(splats.means[rows]).all(axis=1)]
    return COARSE * float(np.median(_sizes(splats, rows, eyes))) if len(rows) else np.inf


def _free(grid: OpacityGrid, points: Points, eyes: Points) -> Mask:
    """Which points (M, 3) have nothing behind them, as seen by nearly all eyes that see them: (M,) bool."""
    shown, free = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    for eye in eyes:
        way = points - eye
        length = np.maximum(np.linalg.norm(way, axis=1), 1e-30)
        reached = grid.march(eye[None], way / length[:, None])[0][0]
        visible = ~(reached < BEFORE * length)
        shown += visible
        free += visible & np.isinf(reached)
    return np.asarray((shown >= LEAST_EYES) & (free > LEAST_OPEN * shown))
