"""Volumes of a closed room that no camera saw: the mesh is often open there, and no sky must shine through.

No photograph shows the wall behind a cupboard or the floor under a sofa, so a mesh has holes there, and the sky that
enters through them passes for that of the windows. What was seen is known to be free: every line from where the capture
stood to a surface, or to the sky in a window. The rest of the room's hull is taken to be solid, for rays that would
leave the room. So is a hole through which rising lines of sight meet neither a surface nor captured sky.
"""

from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Integers, Mask
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.measured import CapturedSky
from splat2mesh.scene.scene import Scene

from ..albedo import samples
from ..albedo.skylight import GROUND, SkyParts
from ..transfer import sampling
from ..transfer.occluder import BATCH_RAYS, Frame, Occluder
from ..transfer.store import Cache
from .interior import MOST_CLOSED, fronts_seen, within
from .seen import seen_from

CELLS = 1e6
"""Cells of the box around the hull: 4 cm in a room of 5 m."""

ERODED = 1
"""Cells by which hidden volumes are smaller than what was not seen: rays that graze furniture stay free."""

SIDES, TRIMMED = 64, 0.01
"""Planes of the hull, and the part of the visible surface beyond each: what windows show outside, and frames."""

TRIED, TRIED_EACH = 4, 16
"""Directions from each surface seen, to tell a closed room before any light is computed, and what stands outside it."""

PORTAL, LINES = 3, 8192
"""Cells along the side of a portal, through which lines leave the hull, and lines from each standpoint."""

LEAST_SHOWN, LEAST_LINES = 0.15, 8
"""Share of the rising lines through a window that show captured sky, and lines without which a hole is a pinhole. The
windows of a trained parlour have .72, the hole beside its lamp .07; windows of generated lounges and of a trained one
.41 to .52, that of a box .44 and a hole of its ceiling .01."""

OUTDOORS = 0.35
"""Part of the sky above which a surface stands outside, seen through a window: sills have up to a half of it."""


def hidden_volumes(scene: Scene, occluder: Occluder) -> NDArray[np.float32]:
    """Triangles around the volumes of a closed room that no camera saw: (B, 3, 3) float32 corners, unit frame; none for
    other scenes."""
    none = np.zeros((0, 3, 3), np.float32)
    eyes = within(scene)
    if not len(eyes):
        return none
    unit = Frame.around(scene.vertices, scene.faces).unit(eyes)
    fronts = fronts_seen(occluder, unit)[:, 0]
    if not len(fronts) or _sky_seen(occluder, fronts, TRIED).mean() > MOST_CLOSED:
        return none
    seen = seen_from(occluder, np.arange(len(occluder.origins)), unit)
    if not seen.any():
        return none
    indoors = np.flatnonzero(seen)
    indoors = indoors[_sky_seen(occluder, indoors, TRIED_EACH) < OUTDOORS]
    if not len(indoors):
        return none
    hull = Hull.around(occluder.origins[indoors].astype(np.float64), samples.vertex_areas(occluder)[indoors])
    holes = _holes(occluder, unit, hull, None if scene.measured is None else scene.measured.sky)
    cells = np.argwhere(hull.inside)
    left, centers = np.arange(len(cells)), (hull.low + (cells + 0.5) * hull.cell).astype(np.float32)
    for eye in unit:
        way = centers[left] - eye
        shown = ~occluder.occluded(np.hstack([centers[left], -way]), 1.0)
        if holes.any():  # a line that leaves through a hole shows nothing
            some = np.flatnonzero(shown)
            some = some[~occluder.occluded(np.hstack([centers[left[some]], way[some]]))]
            shown[some] = ~holes[hull.portal(centers[left[some]], way[some])]
        left = left[~shown]
    unseen = np.zeros(hull.inside.shape, bool)
    unseen[tuple(cells[left].T)] = True
    solid = scipy.ndimage.binary_erosion(unseen, np.ones((3, 3, 3)), ERODED)
    return _around(solid | hull.membrane(holes), hull.low, hull.cell)


def kept_volumes(scene: Scene, cache: Cache, occluder: Occluder) -> NDArray[np.float32]:
    """Those of `hidden_volumes`, kept between runs in the Cache of the scene."""

    def checked(kept: dict[str, NDArray[Any]]) -> NDArray[np.float32]:
        found = kept["triangles"]
        if found.dtype != np.float32 or found.shape[1:] != (3, 3) or not np.isfinite(found).all():
            raise ValueError("these are no triangles")
        return found

    found = cache.restored(checked, "hidden")
    if found is None:
        found = hidden_volumes(scene, occluder)
        cache.put("hidden", triangles=found)
    return found


def _sky_seen(occluder: Occluder, rows: Integers, count: int) -> NDArray[np.float64]:
    """Part of the sky that vertices (R,) see, of so many directions, weighted as matt surfaces weigh it."""
    azimuths, free, size = sampling.fibonacci_azimuths(count), np.zeros(len(rows)), BATCH_RAYS // count
    for start in range(0, len(rows), size):
        part = rows[start : start + size]
        rays = np.zeros((len(part), count, 6), np.float32)
        sampling.shoot(occluder.origins[part], occluder.normals[part], azimuths, 0, rays)
        free[start : start + size] = 1.0 - occluder.occluded(rays).mean(axis=1)
    return free


class Hull(NamedTuple):
    """The trimmed hull of a room, unit frame. reach: (SIDES,) of its planes, whose normals are spread evenly. low: (3,)
    lowest corner of a grid. cell: side of its cells. inside: mask of those in the hull."""

    reach: Floats
    low: Floats
    cell: float
    inside: Mask

    @classmethod
    def around(cls, points: Floats, weights: Floats) -> "Hull":
        """Of points (N, 3), trimmed by their weights (N,)."""
        sides = fibonacci_sphere(SIDES)
        reach = np.zeros(SIDES)
        for number, side in enumerate(sides):
            along = points @ side
            order = np.argsort(along)
            total = np.cumsum(weights[order])
            reach[number] = along[order[np.searchsorted(total, (1.0 - TRIMMED) * total[-1])]]
        held = points[(points @ sides.T <= reach).all(axis=1)]
        held = held if len(held) else points
        low, high = held.min(axis=0), held.max(axis=0)
        extent = np.maximum(high - low, 1e-3)
        cell = float(np.cbrt(extent.prod() / CELLS))
        axes = [np.arange(np.ceil(each / cell)) + 0.5 for each in extent]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return cls(reach, low, cell, ((low + grid * cell) @ sides.T < reach).all(axis=3))

    @property
    def portals(self) -> tuple[int, ...]:
        """Shape of the grid of portals, with one around the hull."""
        return tuple(count // PORTAL + 3 for count in self.inside.shape)

    def portal(self, origins: Floats, directions: Floats) -> tuple[Integers, ...]:
        """Where rays leave the hull, as index of its portals. origins, directions: (R, 3); inside it."""
        sides = fibonacci_sphere(SIDES)
        toward, room = directions @ sides.T, self.reach - origins @ sides.T
        with np.errstate(divide="ignore", invalid="ignore"):
            gone = np.where(toward > 0.0, np.maximum(room, 0.0) / toward, np.inf).min(axis=1)
        return self._portal_at(origins + gone[:, None] * directions)

    def membrane(self, holes: Mask) -> Mask:
        """The outermost cells, where they lie in some portals."""
        edge = self.inside & ~scipy.ndimage.binary_erosion(self.inside, np.ones((3, 3, 3)))
        cells = np.argwhere(edge)
        edge[edge] = holes[self._portal_at(self.low + (cells + 0.5) * self.cell)]
        return edge

    def _portal_at(self, points: Floats) -> tuple[Integers, ...]:
        at = np.floor((points - self.low) / (PORTAL * self.cell)).astype(np.int64) + 1
        return tuple(np.clip(at, 0, np.array(self.portals) - 1).T)


def _holes(occluder: Occluder, eyes: NDArray[np.float32], hull: Hull, sky: CapturedSky | None) -> Mask:
    """Portals of a Hull that are holes of the mesh: rising lines from eyes (E, 3) that leave through them show no sky.

    None where no sky was captured, or none in any opening. What leaves downward is the light of the ground, about as
    dark as a floor."""
    left, shown = np.zeros(hull.portals), np.zeros(hull.portals)
    if sky is None:
        return shown > 0.0
    directions = fibonacci_sphere(LINES)
    directions = directions[directions[:, 1] > 0.0]
    bright = _shows(sky, directions)
    for eye in eyes:
        origins = np.broadcast_to(eye, directions.shape)
        free = ~occluder.occluded(np.hstack([origins, directions]).astype(np.float32))
        at = hull.portal(origins[free].astype(np.float64), directions[free])
        np.add.at(left, at, 1.0)
        np.add.at(shown, at, bright[free])
    part, count = scipy.ndimage.label(left > 0.0, np.ones((3, 3, 3)))
    rows = np.arange(1, count + 1)
    lines, lit = (scipy.ndimage.sum_labels(each, part, rows) for each in (left, shown))
    dark = np.concatenate([[False], (lit < LEAST_SHOWN * lines) & (lines >= LEAST_LINES)])
    if not (lit >= LEAST_SHOWN * lines).any():
        return np.zeros(hull.portals, bool)
    beside = scipy.ndimage.binary_dilation(dark[part], np.ones((3, 3, 3)))
    return np.asarray(beside & (dark[part] | (part == 0)))


def _shows(sky: CapturedSky, directions: Floats) -> Mask:
    """In which directions (D, 3) the sky was captured."""
    parts = SkyParts.looked_up(sky, directions)
    return np.asarray(parts.unseen.mean(axis=1) < 0.5 * np.where(directions[:, 1] < 0.0, GROUND, 1.0))


def _around(solid: Mask, low: Floats, cell: float) -> NDArray[np.float32]:
    """(B, 3, 3) float32: two triangles on each side of a solid cell where a free one follows."""
    padded, found = np.pad(solid, 1), [np.zeros((0, 3, 3))]
    for axis in range(3):
        at = np.argwhere(np.diff(padded.astype(np.int8), axis=axis) != 0).astype(np.float64) - 1.0
        at[:, axis] += 1.0
        first, second = np.delete(np.eye(3), axis, axis=0)
        corners = np.stack([at, at + first, at + first + second, at + second], axis=1) * cell + low
        found += [corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]
    return np.concatenate(found).astype(np.float32)
