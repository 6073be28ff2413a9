"""Virtual cameras: views chosen so that together they see every visible part of a splat, from outside or inside.

The file does not say where the capture's cameras stood, but the splat shows it: surfaces that training saw are sharp,
the rest is fuzzy. Candidates all around and inside free space are rendered small, those that look at fuzz are dropped,
and a greedy cover picks, one by one, the view that shows most of the least seen surface.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import sphere
from ..base.arrays import Bounds, Floats, Matrix3, Points, Vector
from ..base.sphere import level_directions
from ..render.opacityfield import FieldDepth, field_depth
from ..render.view import View
from ..splats.splats import SOLID, Splats
from .eyes import FOV_DEG
from .freespace import FreeSpace

OUTER_FOV_DEG = 40.0
"""Angle of a view from outside; those from within have that of an eye's."""

CANDIDATE_PIXELS = 80
"""Side of a candidate's picture: enough to judge it, at a fraction of the cost of a real view."""

PICTURE_ASPECT = 4 / 3
"""Shape of the picture that a scene is shown with."""

TURNS = 24
"""Horizontal directions that are tried for a picture, all around."""

ELEVATIONS_DEG = 24.0, 10.0
"""The angle from which a picture looks down on a flat thing, and on one as high as it is wide: a table shows its top,
what stands upright is seen as one stands before it, with the horizon behind. Of a place both are tried."""

FEW = 100
"""Solid splats that say more of a shape than all splats, or its box, do."""

SKETCH_SPLATS = 20_000
"""Gaussians in the sample that judges candidates, three for each of their pixels: a view does not depend on every one
of millions."""

CLEARANCE = 2
"""Cells that an eye inside the box keeps away from all splats."""

GRID = 32
"""Cells along the longest side of the box in which coverage is counted and free space is searched: coarse enough to
close the gaps between Gaussians."""

SEALED_ROOM_SHARE = 0.6
"""Share of the box above which sealed space counts as a room; the inside of a sphere is half of its box."""

WANTED_VIEWS = 4
"""Views, or eyes, after which another one of the same patch of surface adds nothing."""

SHARP_ENOUGH = 1.5
"""A candidate is kept when its median fuzziness is at most this many times that of the sharpest tenth: unseen
undersides are fuzzier. Where fewer than the views wanted are so sharp, the sharpest are kept."""


def bounds_of(splats: Splats) -> NDArray[np.float64]:
    """The box that holds the solid part of a splat: (2, 3) float64; stray floaters and far background lie outside."""
    solid = splats.means[splats.opacities > SOLID]
    return box_of(solid if len(solid) > FEW else splats.means)


def box_of(points: Points) -> NDArray[np.float64]:
    """The box (2, 3) of points (N, 3) without strays, with a margin."""
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    margin = 0.02 * np.linalg.norm(high - low) + 1e-12
    return np.stack([low - margin, high + margin]).astype(np.float64)


def corners_of(bounds: Bounds) -> NDArray[np.float64]:
    """The corners (8, 3) of a box (2, 3)."""
    return np.stack(np.meshgrid(*bounds.T), axis=-1).reshape(-1, 3)


def near_plane(bounds: Bounds) -> float:
    """Camera z of the near plane for a scene of this box, so that floaters at the eye block no view."""
    return 0.005 * float(np.linalg.norm(np.ptp(bounds, axis=0)))


class Judged(NamedTuple):
    """What each of M candidates shows. coverage: (M, cells) float32, how well each cell of the box is seen.
    fuzziness: (M,), the median of what is shown, inf for nothing. edges: (M,), the amount of edges in the picture."""

    coverage: NDArray[np.float32]
    fuzziness: Floats
    edges: Floats

    @classmethod
    def by(cls, splats: Splats, views: Sequence[View], bounds: Bounds) -> "Judged":
        """What views show of splats."""
        coverage, fuzziness, edges = [], [], []
        for view in views:
            surface = field_depth(splats, view, near_plane(bounds))
            cells, fuzz = _what_is_seen(surface, view, bounds)
            coverage.append(cells)
            fuzziness.append(fuzz)
            edges.append(_edges(surface))
        return cls(np.array(coverage), np.array(fuzziness), np.array(edges))


def virtual_views(
    splats: Splats, count: int, pixels: int, up: Vector, seed: int = 0, space: FreeSpace | None = None
) -> list[View]:
    """Choose `count` views of a splat.

    splats: cleaned Splats. pixels: longer side of the views returned.
    up: (3,) unit, the up direction in the splat's frame. seed: for the jitter of the candidates. space: where all of
    them stand, or None for anywhere.
    Returns a list of View, the ones that show most first.
    """
    bounds, views = bounds_of(splats), candidate_views(splats, count, up, seed)
    if space is not None and views:
        views = [views[row] for row in np.flatnonzero(space.holds(np.stack([view.center for view in views])))]
    sketch = thinned(splats, np.random.default_rng(seed))
    judged = Judged.by(replace(sketch, sh=sketch.sh[:, :1]), views, bounds)  # no candidate is judged by its colours
    return [views[row].resized(pixels) for row in _cover(judged.coverage, judged.fuzziness, count)]


def candidate_views(splats: Splats, count: int, up: Vector, seed: int = 0) -> list[View]:
    """Views all around, views from nearer, and views from free places inside: list of small View."""
    rng = np.random.default_rng(seed)
    bounds = bounds_of(splats)
    center, radius = bounds.mean(axis=0), np.linalg.norm(np.diff(bounds, axis=0)) / 2
    distance = radius / np.sin(np.radians(OUTER_FOV_DEG) / 2)
    corners = corners_of(bounds)
    views = []
    for direction in even_directions(count):
        view = View.look_at(center + distance * direction, center, up, OUTER_FOV_DEG, CANDIDATE_PIXELS)
        views.append(view.framing(corners))
    for direction in even_directions(count):
        target = center + rng.uniform(-0.3, 0.3, 3) * np.ptp(bounds, axis=0)
        views.append(View.look_at(target + 0.5 * distance * direction, target, up, OUTER_FOV_DEG, CANDIDATE_PIXELS))
    for eye in _free_places(splats, bounds, max(count // 6, 4), rng):
        turn = _random_rotation(rng)
        for axis in np.vstack([np.eye(3), -np.eye(3)]) @ turn:
            views.append(View.look_at(eye, eye + axis, up, FOV_DEG, CANDIDATE_PIXELS))
    return views


def picture_view(splats: Splats, up: Vector) -> View:
    """A view that makes a good picture of a splat: from slightly above and the side with most to see. splats: dilated
    Splats. up: (3,) unit. Returns a View with the aspect PICTURE_ASPECT."""
    bounds, sketch = bounds_of(splats), thinned(splats, np.random.default_rng(0))
    solid = sketch.means[
        (sketch.opacities > SOLID) & ((sketch.means > bounds[0]) & (sketch.means < bounds[1])).all(axis=1)
    ]
    held = solid if len(solid) > FEW else corners_of(bounds)
    size = CANDIDATE_PIXELS, round(CANDIDATE_PIXELS / PICTURE_ASPECT)
    tilt = np.tan(picture_elevation(held, up)) * up
    backwards = level_directions(up, TURNS) + tilt
    ways = [View.look_at(backward, np.zeros(3), up, OUTER_FOV_DEG, *size) for backward in backwards]
    views = [way.holding(held, margin=1.2) for way in ways]
    judged = Judged.by(sketch, views, bounds)
    sharp = 2 * judged.fuzziness.min() + 1e-12
    return views[int(np.argmax(judged.edges / (1 + (judged.fuzziness / sharp) ** 2)))]


def picture_elevation(points: Points, up: Vector) -> float:
    """The angle, radians, from which a picture looks down on what fills the box of points (N, 3)."""
    heights = points @ up
    flat = points - np.outer(heights, up)
    width = np.linalg.norm(np.ptp(flat, axis=0)) / np.sqrt(2.0)
    return np.radians(np.interp(np.ptp(heights) / max(width, 1e-12), (0.0, 1.0), ELEVATIONS_DEG))


def _edges(surface: FieldDepth) -> float:
    """The amount of the edges in the picture of a surface."""
    return np.abs(np.diff(np.where(surface.alpha[..., None] > 0.5, surface.color, 0.5), axis=1)).sum()


def even_directions(count: int) -> NDArray[np.float64]:
    """`count` unit vectors (count, 3) that share the sphere evenly, from +z to -z."""
    return np.ascontiguousarray(sphere.fibonacci_sphere(count, first=0.5)[:, [0, 2, 1]])


def _free_places(splats: Splats, bounds: Bounds, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Up to `count` points inside the box that keep clear of all splats, as far from one another as can be. Space that
    surfaces seal off is the inside of an object, unless it is most of the box: then it is a room."""
    cell = np.ptp(bounds, axis=0).max() / GRID
    shape = np.maximum(np.ceil(np.ptp(bounds, axis=0) / cell).astype(int), 1)
    inside = (splats.opacities > 0.1) & ((splats.means >= bounds[0]) & (splats.means < bounds[1])).all(axis=1)
    cells = np.minimum(((splats.means[inside] - bounds[0]) / cell).astype(int), shape - 1)
    taken = np.zeros(shape, bool)
    taken[tuple(cells.T)] = True
    # With enough space around it, the box's outside is one region that every window and skylight opens to.
    margin = CLEARANCE + 1
    regions, _ = scipy.ndimage.label(~scipy.ndimage.binary_dilation(np.pad(taken, margin), iterations=CLEARANCE))
    roomy = np.bincount(regions.ravel()) > SEALED_ROOM_SHARE * taken.size
    roomy[0], roomy[regions[0, 0, 0]] = False, True
    free = np.argwhere(roomy[regions[margin:-margin, margin:-margin, margin:-margin]])
    if len(free) == 0:
        return np.zeros((0, 3))
    points = bounds[0] + (free + rng.uniform(0.25, 0.75, free.shape)) * cell
    central = np.abs(points - bounds.mean(axis=0)) < 0.42 * np.ptp(bounds, axis=0)
    points = points[central.all(axis=1)] if central.all(axis=1).any() else points
    chosen = [int(np.linalg.norm(points - bounds.mean(axis=0), axis=1).argmin())]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen]


def thinned(splats: Splats, rng: np.random.Generator, count: int = SKETCH_SPLATS) -> Splats:
    """A sketch of a large splat: `count` of its Gaussians, widened so that they cover the same area."""
    if len(splats) <= count:
        return splats
    kept = splats.take(np.sort(rng.choice(len(splats), count, replace=False)))
    return replace(kept, scales=kept.scales * np.float32(np.sqrt(len(splats) / count)))


def _what_is_seen(surface: FieldDepth, view: View, bounds: Bounds) -> tuple[NDArray[np.float32], float]:
    """How well each cell of the box is seen, (cells,) float32, and the median fuzziness, in the box's radius."""
    radius = np.linalg.norm(np.ptp(bounds, axis=0)) / 2
    seen = np.isfinite(surface.depth)
    rays, depth = view.ray_directions()[seen], surface.depth[seen]
    # The spread runs along z, the surface's thickness along its normal.
    fuzz = surface.spread[seen] * -(rays * surface.normal[seen]).sum(axis=1) / radius
    cell = np.ptp(bounds, axis=0).max() / GRID
    shape = np.ceil(np.ptp(bounds, axis=0) / cell).astype(int) + 1
    sight = np.zeros(int(shape.prod()), np.float32)
    points = view.center + rays * depth[:, None]
    inside = ((points >= bounds[0]) & (points < bounds[1])).all(axis=1)
    if inside.sum() < 20:
        return sight, np.inf
    cells = np.ravel_multi_index(((points[inside] - bounds[0]) / cell).astype(int).T, shape)
    footprint = depth[inside] / view.fx / cell
    quality = 1 / (1 + (fuzz[inside] / 0.01) ** 2) / np.maximum(footprint * 4, 1) ** 2
    np.maximum.at(sight, cells, quality.astype(np.float32))
    return sight, float(np.median(fuzz[inside]))


def _cover(coverage: Floats, fuzziness: Floats, count: int) -> list[int]:
    """Indices of the candidates chosen: each one adds most to what the ones before it have seen least."""
    usable = np.flatnonzero(np.isfinite(fuzziness))
    if len(usable) == 0:
        return []
    ranked = np.sort(fuzziness[usable])
    limit = max(SHARP_ENOUGH * np.percentile(ranked, 10), ranked[min(count, len(ranked)) - 1])
    pool = usable[fuzziness[usable] <= limit]
    seen, shown = np.zeros(coverage.shape[1], np.float32), coverage[pool]
    chosen: list[int] = []
    for _ in range(min(count, len(pool))):
        gain = shown @ np.maximum(1 - seen / WANTED_VIEWS, 0.02)
        gain[np.isin(pool, chosen)] = -1
        chosen.append(int(pool[gain.argmax()]))
        seen += coverage[chosen[-1]]
    return chosen


def _random_rotation(rng: np.random.Generator) -> Matrix3:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.diag(r))
