"""The camera positions of a capture, estimated from the splat alone: in a room, in a garden, or around an object.

Free places are tried: from each, rays go out in all directions through a grid of opacity. A place from which most of
them meet surfaces is enclosed; and since training makes Gaussians as small as its photos resolve, the distance of those
surfaces over the size of the smallest Gaussians there is a focal length in pixels. It is that of a camera only where
cameras can have stood: inside a hollow object it is far too short.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arrays import Bounds, Floats, Indices, Integers, Mask, Points, Vector
from ..base.errors import InputError
from ..base.sphere import EVENLY
from ..render.opacitygrid import OCCUPIED, OpacityGrid
from ..splats.splats import Splats
from .eyes import NEAR, Eye
from .freespace import FreeSpace
from .overhead import Overhead
from .viewpoints import WANTED_VIEWS, even_directions

PLACES, TRIED = 2500, 40_000
"""Free places, and cells tried at random until so many are found."""

CLEAR_CELLS = 3
"""Cells around a free place that nothing has OCCUPIED."""


@dataclass(frozen=True)
class StandpointCalibration:
    """Evidence for the camera positions, chosen on two real rooms, a generated parlour and garden, and objects.

    enclosed, surrounded: share of the rays that meet something: in a room, in the foreground; in the open, also far
    away. least_focal: focal length in pixels that a camera has at least: rooms imply 50 and more, the inside of a
    hollow object 20. room_share, garden_share: of the free places that are enclosed, or surrounded, in a place: 68 and
    43% in two real rooms, 24% in a generated parlour, 67% in a generated garden; objects reach .004 and .1.
    walk_pixels: training pixels across a scene that no single photo holds: whoever captured it walked through it.
    best: percentile of the share of rays that counts as the best. share_kept: an eye sees at least this part of what
    the best see.
    """

    enclosed: float = 0.7
    surrounded: float = 0.5
    least_focal: float = 40.0
    room_share: float = 0.02
    garden_share: float = 0.2
    walk_pixels: float = 5000
    best: float = 0.95
    share_kept: float = 0.75


STANDPOINTS = StandpointCalibration()

ROOM_SHARE = STANDPOINTS.room_share
"""Share of enclosed free positions above which a capture shows a room."""

EYES = 24
"""Eyes at most: in the open, views from around join them."""

STEEP = BURIED = 0.5
"""Rays up and down lean by less than 60 degrees; underground fewer than half as many hit below as above. In two gardens
and on a plaza the ratio was 0 to .1 there, and 1.5 or more at the eyes chosen above the ground."""

STRAYS = 2.0
"""Percentile of the heights at which rays hit the foreground, above which they are the ground."""

NEAR_DIAGONAL = 0.002
"""Near plane of an eye, over the scene's diagonal, at least."""

RENDERED_FOCAL = 300.0
"""Focal length in pixels at which twice the training pixel is still resolved by the views that are rendered."""


@dataclass(frozen=True)
class Standpoints:
    """Facts about the capture of a splat.

    kind: "inside" (a room: look from within), "both" (in the open: from within and around) or "outside" (an object).
    eyes: list of Eye, the ones that show most first. distance: median of the distances at which they see surfaces.
    focal: the focal length in pixels that the splat implies. share_enclosed, share_surrounded: of the free places.
    space: what the eyes see, where views from around join them, else None. overhead: of a room, where up is known.
    """

    kind: str
    eyes: list[Eye]
    distance: float
    focal: float
    share_enclosed: float
    share_surrounded: float
    space: FreeSpace | None = None
    overhead: Overhead | None = None


OUTSIDE = Standpoints("outside", [], 0.0, 0.0, 0.0, 0.0)


def standpoints(
    splats: Splats,
    bounds: Bounds,
    choice: str = "auto",
    hints: Sequence[ArrayLike] = (),
    seed: int = 0,
    up: Vector | None = None,
) -> Standpoints:
    """Find how a splat was captured, or take the given answer.

    splats: cleaned Splats. bounds: (2, 3) box of their foreground. choice: one of CHOICES. hints: (3,) places where an
    eye shall stand, in the splats' frame. seed: of the places that are tried. up: (3,) unit, in the splats' frame:
    in the open no eye stands under the ground; None where it is unknown. Returns Standpoints.
    Raises InputError for a hint inside a surface, and for a view from inside without a free place to stand.
    """
    if choice == "outside":
        return OUTSIDE
    grid, places = OpacityGrid.around(splats, bounds), np.array(hints, np.float64).reshape(-1, 3)
    _check_hints(grid, places)
    points = free_places(grid, np.random.default_rng(seed))
    if len(points) < PLACES * ROOM_SHARE and choice == "auto" and len(places) == 0:
        return OUTSIDE
    looks = _RayFans.cast(grid, np.concatenate([places, points]))
    shares = float(looks.enclosed[len(places) :].mean()), float(looks.surrounded[len(places) :].mean())
    kind = "inside" if choice == "inside" else _kind(grid, bounds, *shares)
    if kind == "outside":
        if len(places) == 0:
            return replace(OUTSIDE, share_enclosed=shares[0], share_surrounded=shares[1])
        kind = "both"
    fit = np.ones(len(looks.points), bool) if up is None or kind == "inside" else ~looks.underground(up)
    chosen, distance, focal = _chosen(looks, kind, len(places), fit)
    eyes = looks.eyes(chosen, NEAR_DIAGONAL * float(np.linalg.norm(np.ptp(bounds, axis=0))))
    if kind == "both":
        space = FreeSpace(splats, bounds, eyes, up, looks.lowest(up, chosen) if up is not None else 0.0)
        return Standpoints(kind, eyes, distance, focal, *shares, space)
    return Standpoints(kind, eyes, distance, focal, *shares, None, None if up is None else looks.overhead(up, eyes))


class _RayFans(NamedTuple):
    """The hits of M points in K directions: distance and local training pixel (M, K), hits at all, hits
    in the foreground; and per point the share and the implied focal length of each."""

    points: np.ndarray
    directions: np.ndarray
    distance: np.ndarray
    pixel: np.ndarray
    hit: np.ndarray
    inner: np.ndarray
    share: np.ndarray
    focal: np.ndarray
    share_inner: np.ndarray
    focal_inner: np.ndarray

    @classmethod
    def cast(cls, grid: OpacityGrid, points: Points) -> "_RayFans":
        directions = even_directions(EVENLY)
        distance, pixel, level = grid.march(points, directions)
        hit = np.isfinite(distance)
        inner = hit & (level == 0)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = distance / pixel
        per_point = []
        for seen in (hit, inner):
            per_point += [seen.mean(axis=1), _median(np.where(seen, ratio, np.nan))]
        return cls(points, directions, distance, pixel, hit, inner, *per_point)

    def take(self, rows: Indices) -> "_RayFans":
        """Some of the points."""
        per_point = (each[rows] for each in self[2:])
        return _RayFans(self.points[rows], self.directions, *per_point)

    def eyes(self, rows: Indices, nearest: float) -> list[Eye]:
        """An Eye at some of the points. nearest: least near plane."""
        found = []
        for row in rows:
            clearance = float(np.percentile(self.distance[row][self.hit[row]], 2))
            found.append(Eye(self.points[row], max(NEAR * clearance, nearest)))
        return found

    @property
    def enclosed(self) -> Mask:
        return (self.share_inner >= STANDPOINTS.enclosed) & (self.focal_inner >= STANDPOINTS.least_focal)

    @property
    def surrounded(self) -> Mask:
        return (self.share >= STANDPOINTS.surrounded) & (self.focal >= STANDPOINTS.least_focal)

    def underground(self, up: Vector) -> Mask:
        """Which points have the ground above them: much more of the foreground there than below. up: (3,) unit."""
        height = self.directions @ up
        below, above = (self.inner[:, cap].mean(axis=1) for cap in (height < -STEEP, height > STEEP))
        return np.asarray(below < BURIED * above)

    def overhead(self, up: Vector, eyes: Sequence[Eye]) -> Overhead:
        """What closes a room above, as its enclosed points see it. up: (3,) unit. eyes: those chosen."""
        stood = self.take(np.flatnonzero(self.enclosed))
        met = np.where(stood.inner, stood.distance, np.nan)
        return Overhead.of(stood.points, stood.directions, met, up, eyes)

    def lowest(self, up: Vector, chosen: Indices) -> float:
        """Height of the lowest foreground that some of the points see, but for strays. up: (3,) unit."""
        point, ray = np.nonzero(self.inner[chosen])
        if len(point) == 0:
            return -np.inf
        heights = self.points[chosen[point]] @ up + self.distance[chosen[point], ray] * (self.directions[ray] @ up)
        return float(np.percentile(heights, STRAYS))


def _kind(grid: OpacityGrid, bounds: Bounds, enclosed: float, surrounded: float) -> str:
    """The conclusion from the shares of free positions that are enclosed, and surrounded."""
    if enclosed >= STANDPOINTS.room_share:
        return "inside"
    across = float(np.linalg.norm(np.ptp(bounds, axis=0))) / grid.finest_pixel()
    walked = across > STANDPOINTS.walk_pixels and surrounded >= STANDPOINTS.room_share
    return "both" if surrounded >= STANDPOINTS.garden_share or walked else "outside"


def _chosen(looks: _RayFans, kind: str, hints: int, stands: Mask) -> tuple[Indices, float, float]:
    """Indices of the eyes, the first `hints` points first, the median distance of hits, the implied focal length.
    stands: (M,) bool, which of the points people can stand at."""
    share, focal = (looks.share_inner, looks.focal_inner) if kind == "inside" else (looks.share, looks.focal)
    usable = looks.enclosed if kind == "inside" else looks.surrounded
    if not usable.any():
        usable = share > 0
    if not usable.any():
        raise InputError(
            "`stand` inside: found no free place that sees a surface; name one with `eyes`, or give `stand` outside"
        )
    typical, best = float(np.median(focal[usable])), np.percentile(share, 100 * STANDPOINTS.best)
    fit = (share >= STANDPOINTS.share_kept * best) & (focal >= min(STANDPOINTS.least_focal, typical))
    fit = fit & stands if (fit & stands).any() else fit
    fit[:hints] = looks.hit[:hints].any(axis=1)
    kept = np.flatnonzero(fit)
    seen = looks.inner if looks.inner[kept].any() else looks.hit
    median = float(np.median(looks.distance[kept][seen[kept]]))
    first = np.flatnonzero(kept < hints)
    return kept[_cover(looks.take(kept), seen[kept], median, first)], median, typical


def _check_hints(grid: OpacityGrid, hints: Points) -> None:
    inner, shape = grid.inner(), grid.shapes[0]
    for hint in hints:
        cell = np.floor((hint - grid.origins[0]) / grid.cells[0]).astype(int)
        place = ",".join(f"{value:g}" for value in hint)
        if (cell < 0).any() or (cell >= shape).any():
            box = np.stack([grid.origins[0], grid.origins[0] + shape * grid.cells[0]]).round(2).tolist()
            raise InputError(
                f"`eyes` {place} lies outside the scene, whose box is {box[0]} to {box[1]} in the splat's frame"
            )
        around = tuple(slice(max(c - 1, 0), c + 2) for c in cell)
        if (inner[around] > OCCUPIED).any():
            raise InputError(f"`eyes` {place} lies inside a surface: choose a free place, in the splat's own frame")


def free_places(grid: OpacityGrid, rng: np.random.Generator) -> NDArray[np.float64]:
    """Up to PLACES random points of the innermost grid that keep clear of what is opaque: (M, 3) float64."""
    taken, shape = grid.inner() > OCCUPIED, grid.shapes[0]
    tried = rng.integers(0, shape, (TRIED, 3))
    free = []
    for cell in tried:
        low = np.maximum(cell - CLEAR_CELLS, 0)
        if not taken[tuple(slice(a, b + CLEAR_CELLS + 1) for a, b in zip(low, cell, strict=True))].any():
            free.append(cell)
            if len(free) == PLACES:
                break
    return grid.origins[0] + (np.array(free).reshape(-1, 3) + 0.5) * grid.cells[0]


def _median(values: Floats) -> Floats:
    """Median along the last axis of the numbers that are none of them NaN; 0 where all are."""
    found = np.zeros(len(values))
    some = np.isfinite(values).any(axis=1)
    found[some] = np.nanmedian(values[some], axis=1)
    return found


def _cover(looks: _RayFans, usable: Mask, median: float, first: Integers) -> Indices:
    """Indices of at most EYES eyes, `first` before others: each adds most to what those before it saw least."""
    points, directions, distance, pixel = looks[:4]
    where = np.where(usable, distance, 0)[..., None] * directions + points[:, None]
    cells = np.floor((where - where.min(axis=(0, 1))) / (median / 8)).astype(np.int64)
    facing = np.abs(directions).argmax(axis=1)
    facing = 2 * facing + (directions[np.arange(len(directions)), facing] > 0)
    size = cells.max(axis=(0, 1)) + 1
    key = np.ravel_multi_index(tuple(np.moveaxis(cells, -1, 0)), size) * 6 + facing
    some = usable & np.isfinite(pixel)
    known = np.where(np.isfinite(pixel), pixel, np.median(pixel[some]) if some.any() else median / RENDERED_FOCAL)
    quality = 1 / (1 + (distance / (2 * RENDERED_FOCAL * known)) ** 2)
    owner, ray = np.nonzero(usable)
    key, quality = np.unique(key[owner, ray], return_inverse=True)[1], quality[owner, ray]
    order = np.lexsort((-quality, key, owner))
    owner, key, quality = owner[order], key[order], quality[order]
    best = np.ones(len(owner), bool)
    best[1:] = (owner[1:] != owner[:-1]) | (key[1:] != key[:-1])
    owner, key, quality = owner[best], key[best], quality[best]
    ends = np.searchsorted(owner, np.arange(len(points) + 1))
    seen = np.zeros(key.max() + 1)
    chosen: list[int] = []
    for _ in range(min(EYES, len(points))):
        gain = np.bincount(owner, quality * np.maximum(1 - seen[key] / WANTED_VIEWS, 0.02), len(points))
        gain[chosen] = -1
        chosen.append(int(first[len(chosen)] if len(chosen) < len(first) else gain.argmax()))
        mine = slice(ends[chosen[-1]], ends[chosen[-1] + 1])
        seen[key[mine]] += quality[mine]
    return np.array(chosen, int)
