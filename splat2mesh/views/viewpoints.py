"""Virtual cameras: views chosen so that together they see every visible part of a splat, from outside or inside.

The file does not say where the capture's cameras stood, but the splat shows it: surfaces that training saw are sharp,
the rest is fuzzy. Candidates all around and inside free space are rendered small, those that look at fuzz are dropped,
and a greedy cover picks, one by one, the view that shows most of the least seen surface.
"""

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..base import sphere
from ..base.arrays import Bounds, Floats, Matrix3, Points, Vector
from ..base.errors import DataWarning
from ..render.opacityfield import FieldDepth, field_depth
from ..render.view import View
from ..splats.splats import Splats
from .freespace import FreeSpace
from .oneside import SUSPECTED, sharp_side

OUTER_FOV_DEG, INNER_FOV_DEG = 40.0, 90.0
CANDIDATE_PIXELS = 80
"""Side of a candidate's picture: enough to judge it, at a fraction of the cost of a real view."""

PICTURE_ASPECT = 4 / 3
"""Shape of the picture that a scene is shown with."""

FLATNESSES, ELEVATIONS_DEG = (0.3, 0.9), (24.0, 10.0)
"""Height of a thing over its width, and the angle from which its picture looks down on it: a table shows its top, what
stands upright is seen as one stands before it, with the horizon behind."""

PICTURE_FOV_DEG = 75.0
"""Angle of a picture from inside."""

SKETCH_SPLATS = 40_000
"""Gaussians in the sample that judges candidates: a view does not depend on every one of millions."""

OBJECT_SKETCH = 20_000
"""The same where an object is looked at from all around: three for each pixel of a candidate."""

CLEARER = 4
"""Gaussians over SKETCH_SPLATS by which a capture is found to be one-sided."""

COVER_GRID = 48
"""Cells along the longest side of the box in which coverage is counted."""

CLEARANCE = 2
"""Cells that an eye inside the box keeps away from all splats."""

FREE_GRID = 32
"""Cells along that side in the search for free space: coarse enough to close the gaps between Gaussians."""

SEALED_ROOM_SHARE = 0.6
"""Share of the box above which sealed space counts as a room; the inside of a sphere is half of its box."""

INSIDE_SHARPER = 3.0
"""Sharpness of the inside over the outside from which a scene is shown from inside."""

WANTED_VIEWS = 4
"""Views after which another one of the same cell adds nothing to its coverage."""

SHARP_ENOUGH = 1.5
"""A candidate is kept when its median fuzziness is at most this many times that of the sharpest tenth."""

RESCUE_SHARE, RESCUE_CELLS, SHARP_CELL = 0.25, 4.0, 0.5
"""Views, over those wanted, that may be added for what no sharp view shows, the cells that each of them must add, and
the sight of a cell that counts there."""

TOLERABLE = 1.5
"""Largest fuzziness of such a view over that of the sharp ones: unseen undersides are fuzzier."""

CHOICE = 0.75
"""Candidates to choose from, as a multiple of the views wanted: where fewer are sharp, the next sharpest join them."""


def bounds_of(splats: Splats) -> NDArray[np.float64]:
    """The box that holds the solid part of a splat: (2, 3) float64; stray floaters and far background lie outside."""
    solid = splats.means[splats.opacities > 0.3] if (splats.opacities > 0.3).sum() > 100 else splats.means
    low, high = np.percentile(solid, [0.5, 99.5], axis=0)
    margin = 0.02 * np.linalg.norm(high - low) + 1e-12
    return np.stack([low - margin, high + margin]).astype(np.float64)


def near_plane(bounds: Bounds) -> float:
    """Camera z of the near plane for a scene of this box, so that floaters at the eye block no view."""
    return 0.005 * float(np.linalg.norm(np.ptp(bounds, axis=0)))


def virtual_views(
    splats: Splats,
    count: int,
    pixels: int,
    up: Vector,
    seed: int = 0,
    space: FreeSpace | None = None,
    tell: bool = False,
) -> list[View]:
    """Choose `count` views of a splat, or up to a quarter more where parts of it would go unseen.

    splats: cleaned Splats. pixels: longer side of the views returned.
    up: (3,) unit, the up direction in the splat's frame. seed: for the jitter of the candidates. space: where all of
    them stand, or None for anywhere: then all look from the side that the capture looked from, if it was one.
    tell: whether to warn of such a capture.
    Returns a list of View, the ones that show most first.
    """
    bounds = bounds_of(splats)
    near = near_plane(bounds)
    candidates = candidate_views(splats, count, up, seed)
    if space is not None and candidates:
        free = space.holds(np.stack([view.center for view in candidates]))
        candidates = [view for view, stands in zip(candidates, free, strict=True) if stands]
    sketch = thinned(splats, np.random.default_rng(seed), OBJECT_SKETCH if space is None else SKETCH_SPLATS)
    sketch = replace(sketch, sh=sketch.sh[:, :1])  # no candidate is judged by its colours
    coverage, fuzziness, blur = [], [], []
    for view in candidates:
        surface = field_depth(sketch, view, near)
        cells, fuzz = _what_is_seen(surface, view, bounds)
        coverage.append(cells)
        fuzziness.append(fuzz)
        blur.append(fuzz / max(_edges(surface), 1e-12))
    backward = np.stack([-view.forward for view in candidates]) if candidates else np.zeros((0, 3))
    front = sharp_side(backward[:count], np.array(blur[:count]), up, SUSPECTED) if space is None else None
    if front is not None:  # also what has plain walls behind; the surfaces of a clearer sketch decide
        clear = thinned(splats, np.random.default_rng(seed), CLEARER * SKETCH_SPLATS)
        seen = [_what_is_seen(field_depth(clear, view, near), view, bounds)[1] for view in candidates[:count]]
        front = sharp_side(backward[:count], np.array(seen), up)
    if front is not None:
        kept = np.flatnonzero(backward @ front > 0.0)
        candidates, fuzziness = [candidates[k] for k in kept], [fuzziness[k] for k in kept]
        coverage = [coverage[k] for k in kept]
        if tell:
            message = "captured from one side: sharp from there, a blur from behind; what no camera saw stays open"
            warnings.warn(message, DataWarning, stacklevel=2)
    chosen = _cover(np.array(coverage), np.array(fuzziness), count)
    return [candidates[index].resized(pixels) for index in chosen]


def candidate_views(splats: Splats, count: int, up: Vector, seed: int = 0) -> list[View]:
    """Views all around, views from nearer, and views from free places inside: list of small View."""
    rng = np.random.default_rng(seed)
    bounds = bounds_of(splats)
    center, radius = bounds.mean(axis=0), np.linalg.norm(np.diff(bounds, axis=0)) / 2
    distance = radius / np.sin(np.radians(OUTER_FOV_DEG) / 2)
    corners = np.stack(np.meshgrid(*bounds.T), axis=-1).reshape(-1, 3)
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
            views.append(View.look_at(eye, eye + axis, up, INNER_FOV_DEG, CANDIDATE_PIXELS))
    return views


def picture_view(splats: Splats, up: Vector, within: bool = False) -> View:
    """A view that makes a good picture of a splat: from slightly above and the side with most to see.

    splats: dilated Splats. up: (3,) unit. within: whether it may be a room, to be shown from inside where that is much
    sharper. Returns a View with the aspect PICTURE_ASPECT.
    """
    rng = np.random.default_rng(0)
    bounds = bounds_of(splats)
    near, sketch = near_plane(bounds), thinned(splats, rng)
    solid = sketch.means[
        (sketch.opacities > 0.3) & ((sketch.means > bounds[0]) & (sketch.means < bounds[1])).all(axis=1)
    ]
    held = solid if len(solid) > 100 else np.stack(np.meshgrid(*bounds.T), axis=-1).reshape(-1, 3)
    ahead = np.linalg.svd(up[None])[2][1]
    side = np.cross(up, ahead)
    size = CANDIDATE_PIXELS, round(CANDIDATE_PIXELS / PICTURE_ASPECT)
    tilt = np.tan(picture_elevation(held, up))
    turns = np.arange(12) * np.pi / 6
    backwards = [np.cos(a) * ahead + np.sin(a) * side + tilt * up for a in turns]
    from_around = [View.holding(held, backward, up, OUTER_FOV_DEG, *size, margin=1.2) for backward in backwards]
    from_within = [
        View.look_at(eye, eye - backward, up, PICTURE_FOV_DEG, *size)
        for eye in (_free_places(splats, bounds, 3, rng) if within else ())
        for backward in backwards[::2]
    ]

    outside = [(view, *_judge(sketch, view, near, bounds)) for view in from_around]
    inside = [(view, *_judge(sketch, view, near, bounds)) for view in from_within]
    sharpest = min(fuzz for _, fuzz, _ in outside)
    # What is seen from inside a room is much sharper than what is seen of it from outside.
    from_inside = bool(inside) and min(fuzz for _, fuzz, _ in inside) < sharpest / INSIDE_SHARPER
    return _best_picture(inside if from_inside else outside)


def picture_elevation(points: Points, up: Vector) -> float:
    """The angle, radians, from which a picture looks down on what fills the box of points (N, 3)."""
    heights = points @ up
    flat = points - np.outer(heights, up)
    width = np.linalg.norm(np.ptp(flat, axis=0)) / np.sqrt(2.0)
    return np.radians(np.interp(np.ptp(heights) / max(width, 1e-12), FLATNESSES, ELEVATIONS_DEG))


def _judge(sketch: Splats, view: View, near: float, bounds: Bounds) -> tuple[float, float]:
    """Blur of a view, and the amount of its edges."""
    surface = field_depth(sketch, view, near)
    _, fuzz = _what_is_seen(surface, view, bounds)
    return fuzz, _edges(surface)


def _edges(surface: FieldDepth) -> float:
    """The amount of the edges in the picture of a surface."""
    return np.abs(np.diff(np.where(surface.alpha[..., None] > 0.5, surface.color, 0.5), axis=1)).sum()


def _best_picture(pool: Sequence[tuple[View, float, float]]) -> View:
    sharp = 2 * min(fuzz for _, fuzz, _ in pool) + 1e-12
    return max(pool, key=lambda entry: entry[2] / (1 + (entry[1] / sharp) ** 2))[0]


def even_directions(count: int) -> NDArray[np.float64]:
    """`count` unit vectors (count, 3) that share the sphere evenly, from +z to -z."""
    return np.ascontiguousarray(sphere.fibonacci_sphere(count, first=0.5)[:, [0, 2, 1]])


def _free_places(splats: Splats, bounds: Bounds, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Up to `count` points inside the box that keep clear of all splats, as far from one another as can be.

    Space that surfaces seal off is the inside of an object, unless it is most of the box: then it is a room.
    """
    from scipy.ndimage import binary_dilation, label

    cell = np.ptp(bounds, axis=0).max() / FREE_GRID
    shape = np.maximum(np.ceil(np.ptp(bounds, axis=0) / cell).astype(int), 1)
    inside = (splats.opacities > 0.1) & ((splats.means >= bounds[0]) & (splats.means < bounds[1])).all(axis=1)
    cells = np.minimum(((splats.means[inside] - bounds[0]) / cell).astype(int), shape - 1)
    taken = np.zeros(shape, bool)
    taken[tuple(cells.T)] = True
    # With enough space around it, the box's outside is one region that every window and skylight opens to.
    margin = CLEARANCE + 1
    regions, _ = label(~binary_dilation(np.pad(taken, margin), iterations=CLEARANCE))
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
    cell = np.ptp(bounds, axis=0).max() / COVER_GRID
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
    limit = max(SHARP_ENOUGH * np.percentile(ranked, 10), ranked[min(round(CHOICE * count), len(ranked)) - 1])
    pool, tolerable = usable[fuzziness[usable] <= limit], usable[fuzziness[usable] <= TOLERABLE * limit]
    seen, shown = np.zeros(coverage.shape[1], np.float32), coverage[pool]
    chosen: list[int] = []
    for _ in range(min(count, len(pool))):
        gain = shown @ np.maximum(1 - seen / WANTED_VIEWS, 0.02)
        gain[np.isin(pool, chosen)] = -1
        chosen.append(int(pool[gain.argmax()]))
        seen += coverage[chosen[-1]]
    # What only fuzzier views show, such as a foot seen past an edge, is seen now where it looks sharp itself.
    sights = np.where(coverage[tolerable] > SHARP_CELL, coverage[tolerable], 0)
    for _ in range(round(RESCUE_SHARE * count)):
        gain = sights @ np.maximum(1 - seen, 0)
        gain[np.isin(tolerable, chosen)] = -1
        if gain.max() < RESCUE_CELLS:
            break
        chosen.append(int(tolerable[gain.argmax()]))
        seen += coverage[chosen[-1]]
    return chosen


def _random_rotation(rng: np.random.Generator) -> Matrix3:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.diag(r))
