"""The up direction from the scene: the floor that a capture stands on, where a splat clearly has one.

The largest plane of a place is its floor or its ceiling: of the methods tried (normals of splats, walls about the
vertical, weight near the floor, brightness) only the area of planes found it in every capture, real and trained. Walls
have half of its area, objects no plane that stands out. If objects stand on one side only, that side is up; between a
floor and a ceiling the usual frame of trained files decides. It also decides for a table, unless its pictures from
below are much blurred: no camera stood there.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Directions, Floats, Integers, Points, Vector
from ..base.distinct import distinct
from ..base.quantiles import weighted_quantile
from ..base.sphere import level_axes
from ..render.rasterize import rasterize
from ..render.view import View
from ..splats.foreground import far_background
from ..splats.splats import SOLID, Splats
from .viewpoints import OUTER_FOV_DEG, even_directions

CELLS = 40
"""Cells along the radius that holds half of the detail: all that a cell holds counts once, so that a thing of many
small splats outweighs no floor of few large ones."""

DIRECTIONS, SAMPLE = 2400, 25_000
"""Directions (3.7 degrees apart) of the search for planes, and the cells searched."""


DETAIL_PIXELS, SOLID_PIXEL, CONTRAST = 192, 0.95, 1.6
"""Side and least alpha of the pictures whose detail shows from where cameras looked, and how much more of it the side
has that they saw: 1.9 and 2.2 times in two captures from above."""


@dataclass(frozen=True)
class FloorCalibration:
    """Criteria that distinguish a floor from other planes, chosen on nine captures of places, real and trained, and one
    object. Radii hold half of the detail each.

    radii: searched. thickness: of a plane, in cells: floors are no flatter, trained over several metres.
    least_cover: share of its outline, seen along the normal, that a floor fills: .58 to 1 in nine captures, .47 in an
    object. least_lead: how much larger than any plane that leans away by 30 degrees: 2 to 35 in places, 1.25 in an
    object. least_sided: cells on its upper side for each one below: 6.8 and more in places; floaters are what lies
    below. ceiling: share of the floor's area from which a plane opposite is a ceiling: .57 and .63 in rooms, .3 in a
    blurred one.
    leans_deg, leans_in_place_deg: how far from an axis a floor may lie, and where surroundings or a ceiling show that
    it is one. straight_deg: how near to an axis the capture is upright already.
    cover_in_place: least_cover where the capture is known to be a place: .46 in a garden between towers.
    """

    radii: float = 3.0
    thickness: float = 3.0
    least_cover: float = 0.5
    least_lead: float = 1.6
    least_sided: float = 3.0
    ceiling: float = 0.42
    leans_deg: float = 15.0
    leans_in_place_deg: float = 35.0
    straight_deg: float = 1.0
    cover_in_place: float = 0.4


FLOOR = FloorCalibration()


@dataclass(frozen=True)
class Ground:
    """Up as the place shows it.

    up: (3,) unit float64 in the splat's frame, or None where the evidence is weak. reason: what was found, one phrase.
    of_place: (3,) unit, what is up if the splat is a place, captured from within, where up is None; None where that
    would not settle it.
    """

    up: np.ndarray | None
    reason: str
    of_place: np.ndarray | None = None


@dataclass(frozen=True)
class Floor:
    """The largest plane of a splat and what speaks for its being a floor.

    normal: (3,) unit float64, towards the side with more on it. cover, lead, sided, opposite: what least_cover,
    least_lead, least_sided and ceiling of FLOOR are compared with. in_place: whether it has a far background, as places
    have; an object's flat top must not be taken for a floor.
    """

    normal: np.ndarray
    cover: float
    lead: float
    sided: float
    opposite: float
    in_place: bool

    @property
    def open_above(self) -> bool:
        """Whether no ceiling lies opposite."""
        return self.opposite < FLOOR.ceiling


def ground_of(splats: Splats) -> Ground:
    """Up from the floor of a place: a Ground. splats: cleaned Splats. The same whatever the number of threads."""
    floor = largest_plane(splats)
    if floor is None:
        return Ground(None, "no plane stands out as a floor")
    found = _judged(splats, floor)
    return found if found.up is not None else replace(found, of_place=_level_of_place(floor))


def _level_of_place(floor: Floor) -> NDArray[np.float64] | None:
    """Up of a place whose largest plane faces along z, as in files of scanners and of programs for buildings; None
    for other planes. Where both sides could be up, as between floor and ceiling, it is +z, which those files share."""
    up = floor.normal if floor.normal[2] > 0 or floor.open_above else -floor.normal
    stands_out = floor.cover >= FLOOR.cover_in_place and floor.lead >= FLOOR.least_lead
    if not stands_out or up[2] < np.cos(np.radians(FLOOR.leans_in_place_deg)):
        return None
    if floor.open_above and floor.sided < FLOOR.least_sided:
        return None
    return _straight(up)


def _leans(up: Vector) -> float:
    """Degrees between a direction (3,) and the axis nearest to it."""
    return float(np.degrees(np.arccos(min(1.0, np.abs(up).max()))))


def _straight(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """A direction (3,), or the axis that it hardly leans from."""
    on_axis = np.where(np.abs(up) == np.abs(up).max(), np.sign(up), 0.0)
    return on_axis if _leans(up) < FLOOR.straight_deg else up


def _judged(splats: Splats, floor: Floor) -> Ground:
    """The Ground that a plane shows by itself, whatever the splat is."""
    doubt = _no_floor(floor)
    if doubt:
        return Ground(None, doubt)
    axis, up, assumed = int(np.abs(floor.normal).argmax()), floor.normal, False
    if _either_side(floor):
        # The usual frame decides, if the plane agrees, unless the other side was never seen.
        seen_alone = floor.open_above and _sharper(splats, up) > CONTRAST
        assumed = up[1] > 0 and not seen_alone
        up = -up if assumed else up
    leans = _leans(up)
    if leans > (FLOOR.leans_in_place_deg if floor.in_place or not floor.open_above else FLOOR.leans_deg):
        return Ground(None, f"the largest plane leans by {leans:.0f} degrees")
    up = _straight(up)
    name = f"{'+' if up[axis] > 0 else '-'}{'xyz'[axis]}"
    if assumed and floor.open_above:
        return Ground(up, f"a flat side, {leans:.1f} degrees from {name}, assumed to be the lower one")
    return Ground(up, f"the floor, {leans:.1f} degrees from {name}")


def _no_floor(floor: Floor) -> str:
    """Why a plane cannot be a floor of which a side is known to be up, or ""."""
    if floor.cover < FLOOR.least_cover or floor.lead < FLOOR.least_lead:
        return "no plane stands out as a floor"
    axis = int(np.abs(floor.normal).argmax())
    if axis == 0:
        return "the largest plane faces sideways"
    if _either_side(floor):
        return "" if axis == 1 else "between two planes either side could be up"
    if floor.sided < FLOOR.least_sided:
        return "things stand on both sides of the largest plane"
    return "the largest plane may be a wall" if axis == 2 and not (floor.in_place and floor.normal[2] > 0) else ""


def _either_side(floor: Floor) -> bool:
    """Whether either side of a plane could be up: between a floor and a ceiling, or where an object stands on a plane
    that faces down in the usual frame."""
    faces_down = int(np.abs(floor.normal).argmax()) == 1 and floor.normal[1] > 0
    return bool(not floor.open_above or (faces_down and not floor.in_place))


def _sharper(splats: Splats, normal: Vector) -> float:
    """The detail of pictures from the side of a normal over that from the other side."""
    center = np.median(splats.means.astype(np.float64), axis=0)
    radius = np.percentile(np.linalg.norm(splats.means - center, axis=1), 98.0)
    across, along = level_axes(normal)
    away = radius / np.sin(np.radians(OUTER_FOV_DEG) / 2)
    detail = []
    for side in (normal, -normal):
        parts = []
        for lean in (across, along, -across, -along):
            eye = center + away * (0.8 * side + 0.6 * lean)
            shown = rasterize(splats, View.look_at(eye, center, normal, OUTER_FOV_DEG, DETAIL_PIXELS))
            color = shown.color.astype(np.float64)
            apart = np.abs(
                4 * color[1:-1, 1:-1] - color[2:, 1:-1] - color[:-2, 1:-1] - color[1:-1, 2:] - color[1:-1, :-2]
            )
            solid = shown.alpha[1:-1, 1:-1] > SOLID_PIXEL
            parts.append(float(apart[solid].mean()) if solid.any() else 0.0)
        detail.append(float(np.mean(parts)))
    return detail[0] / detail[1] if min(detail) > 0.0 else 1.0


def largest_plane(splats: Splats) -> Floor | None:
    """The Floor of a splat, not judged yet; None where too little is solid."""
    cells = _cells(splats)
    if len(cells) < CELLS:
        return None
    sample = cells[:: 1 + len(cells) // SAMPLE]
    directions = even_directions(DIRECTIONS)
    directions = directions[directions[:, 2] >= 0]
    counts, heights = _fullest_slabs(sample, directions)
    best = int(counts.argmax())
    normal, height = _fitted(cells, directions[best], heights[best])
    above = _along(cells, normal) - height
    if (above > FLOOR.thickness).sum() < (above < -FLOOR.thickness).sum():
        normal, above = -normal, -above
    on = np.abs(above) < FLOOR.thickness / 2
    upper = above[above > FLOOR.thickness]
    if not on.any() or len(upper) == 0:
        return None
    off = np.abs(above[:: 1 + len(cells) // SAMPLE]) >= FLOOR.thickness
    others = directions[np.abs(_along(directions, normal)) < np.cos(np.radians(30.0))]
    second = _fullest_slabs(sample[off], others)[0].max() if off.any() else 0
    beyond = above[above > 0.3 * np.percentile(upper, 98)]
    return Floor(
        normal,
        cover=_outline(cells[on], normal) / _outline(cells, normal),
        lead=float(on.sum() * len(sample) / len(cells) / max(second, 1)),
        sided=float(len(upper) / max((above < -FLOOR.thickness).sum(), 1)),
        opposite=float(_fullest_slab(beyond)[0] / on.sum()),
        in_place=bool(far_background(splats).any()),
    )


def _cells(splats: Splats) -> NDArray[np.float64]:
    """Centres of the cells that solid splats near the middle of the detail lie in, (C, 3) in cells."""
    solid = np.flatnonzero(splats.opacities > SOLID)
    if len(solid) < CELLS:
        return np.zeros((0, 3))
    size = splats.scales[solid].max(axis=1)
    detail = 1.0 / np.maximum(size, np.percentile(size, 5) + 1e-30).astype(np.float64) ** 2
    means = splats.means[solid].astype(np.float64)
    middle = np.array([weighted_quantile(means[:, axis], detail) for axis in range(3)])
    means -= middle
    distance = np.sqrt(_along(means**2, np.ones(3)))
    radius = weighted_quantile(distance, detail) + 1e-30
    index = np.floor(means[distance < FLOOR.radii * radius] * (CELLS / radius)).astype(np.int64)
    wide = 2 * round(FLOOR.radii) * CELLS
    keys = distinct(((index[:, 0] + wide) * 2 * wide + index[:, 1] + wide) * 2 * wide + index[:, 2] + wide)
    cells = np.stack([keys // (4 * wide * wide), keys // (2 * wide) % (2 * wide), keys % (2 * wide)], axis=1)
    return cells - wide + 0.5


def _fullest_slabs(points: Points, directions: Directions) -> tuple[Integers, Floats]:
    """Across each direction the slab, as thick as a plane, with most points: counts (D,), heights of middles (D,)."""
    found = [_fullest_slab(_along(points, direction)) for direction in directions]
    return np.array([count for count, _ in found]), np.array([height for _, height in found])


def _fullest_slab(heights: Floats) -> tuple[int, float]:
    if len(heights) == 0:
        return 0, 0.0
    steps = np.floor(heights).astype(np.int64)
    low, width = steps.min(), round(FLOOR.thickness)
    counts = np.convolve(np.bincount(steps - low), np.ones(width, np.int64))
    fullest = int(counts.argmax())
    return int(counts[fullest]), float(low + fullest + 1 - width / 2)


def _fitted(points: Points, normal: Vector, height: float) -> tuple[Vector, float]:
    """The plane through the points of a slab, fitted again and again: its normal and height."""
    for _ in range(8):
        near = points[np.abs(_along(points, normal) - height) < FLOOR.thickness / 2]
        if len(near) < 3:
            break
        middle = near.mean(axis=0)
        away = near - middle
        spread = np.array([[(away[:, i] * away[:, j]).sum() for j in range(3)] for i in range(3)])
        fitted = np.linalg.eigh(spread)[1][:, 0]
        normal = fitted * (1.0 if fitted @ normal >= 0 else -1.0)
        height = float(middle @ normal)
    return normal, height


def _outline(points: Points, normal: Vector) -> int:
    """Area of points seen along a normal, in squares of two cells."""
    squares = [np.floor(_along(points, axis) / 2).astype(np.int64) for axis in level_axes(normal)]
    return len(distinct(squares[0] * 65536 + squares[1]))


def _along(points: Points, direction: Vector) -> Floats:
    """Dot products, (N,), term by term: the rounding of a matrix product depends on its threads."""
    return points[:, 0] * direction[0] + points[:, 1] * direction[1] + points[:, 2] * direction[2]
