"""Normals for light: those of planes on walls, floors and table tops of a place, whose vertices stay where they are.

Where training sees little texture it leaves a fog of Gaussians before a wall. A mesh of it has bumps that the wall has
not. The fog carries the wall's colour, so it is what is lit, but light should fall on it as on the wall. Planes are
found among patches twice as wide as the fog is thick, over which its bumps cancel: each is drawn through one patch
(after Fischler and Bolles, "Random Sample Consensus", 1981) and fitted as one part of a mixture: patches lie on the
plane, with a spread of their heights and one of their normals, or anywhere. A vertex lies on the plane that its patch
lies on, where it stands out by no more than the surface is thick there.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Directions, Faces, Floats, Indices, Mask, Points, Vector
from .fair import edge_uses
from .patches import SeenPatches

SAMPLE = 40_000
"""Patches, drawn by their area, that planes are fitted to."""

DRAWS = 96
"""Planes drawn for each that is looked for, of which the best is fitted."""

STEPS = 12
"""Steps of a fit."""

PATCH = 2.0
"""Side of a patch in bands, the most distances between a plane and what lies on it: the thickness of fog."""

SIGMAS = 3.0
"""Standard deviations within which a thing is where it is expected: 997 times in 1,000."""

CONE = np.pi / 4
"""Largest angle between a plane's normal and one that is weighed, radians. Chosen on an office and a parlour."""

LEAST_SPREAD = 0.07
"""Least spread of normals along each of two axes, radians: some of a facade may be seen far better than the rest."""

LEAST_AREA, LEAST_GAIN = SAMPLE / 200, 1.0
"""Patches of the sample that lie on a plane at least, and how much likelier they are with it, in nats, on average:
one, chosen, not fitted, since the foggiest wall of a real office has 1.06."""

CELL, MOST_TURNING, FLAT = 8.0, 0.25, 1e-3
"""Side, in bands, of the cells within which normals may turn with their places; share of their variance above which
what they lie on is round; and variance across a plane, over that along it, which counts as none. Planes of rooms and
streets have up to 0.2, columns 0.9."""

MOST_FAILED = 5
"""Fits one after the other that give no plane, after which there are no more."""


class Plane(NamedTuple):
    """A plane that patches lie on: normal (3,) unit, offset: normal . x of its points x, standard deviation of their
    heights over it and of their normals about it, radians along each of two axes. held, gain, turning: of the sample,
    as LEAST_AREA, LEAST_GAIN and MOST_TURNING have them. thickness: of the surface, mean."""

    normal: Vector
    offset: float
    noise: float
    spread: float
    held: float
    gain: float
    turning: float
    thickness: float

    @property
    def is_sure(self) -> bool:
        """Whether enough lies on it, surely enough, and is neither round nor rougher than the surface is thick."""
        flat = self.turning <= MOST_TURNING and self.noise <= self.thickness
        return flat and self.held >= LEAST_AREA and self.gain >= LEAST_GAIN


class Evened(NamedTuple):
    """Normals (V, 3) float32 for light. shares: (V,) in [0, 1], how much of each is that of a plane. area: share of the
    area of patches that lies on planes. planes: the largest first, about."""

    normals: NDArray[np.float32]
    shares: Floats
    area: float
    planes: list[Plane]


class _Surface(NamedTuple):
    """Points, unit normals (M, 3) and thickness (M,) of patches, and the most distance between a plane and what lies on
    it."""

    points: Points
    normals: Directions
    thickness: Floats
    band: float

    def take(self, rows: NDArray) -> "_Surface":
        """Some of them, by number or as (M,) bool."""
        return _Surface(self.points[rows], self.normals[rows], self.thickness[rows], self.band)

    def around(self, normal: Vector, offset: float) -> tuple[Floats, Floats, Mask]:
        """Heights over a plane (M,), angles of the normals to its own (M,), and which of both are weighed."""
        heights, angles = self.points @ normal - offset, np.arccos(np.clip(self.normals @ normal, -1, 1))
        return heights, angles, (np.abs(heights) < self.band) & (angles < CONE)

    def on(self, plane: Plane) -> Mask:
        """Which of them are where things on a plane are expected: (M,)."""
        heights, angles, _ = self.around(plane.normal, plane.offset)
        return (np.abs(heights) < SIGMAS * plane.noise) & (angles < SIGMAS * plane.spread)

    def likelier(self, heights: Floats, angles: Floats, noise: float, spread: float) -> Floats:
        """Density on a plane of such a noise and spread over that of an even distribution: (M,)."""
        bells = np.exp(-0.5 * (heights / noise) ** 2 - 0.5 * (angles / spread) ** 2)
        evenly = 2 * self.band * 2 * np.pi * (1 - np.cos(CONE))
        return bells * evenly / ((2 * np.pi) ** 1.5 * noise * spread**2)


def evened(points: Points, normals: Directions, faces: Faces, thickness: Floats, patches: SeenPatches) -> Evened:
    """Give vertices the normals of planes they lie on, larger planes first, blended where these end.

    points, normals: (V, 3), unit. faces: (F, 3). thickness: (V,) of the surface there, same unit: its noise. What
    stands out by more than SIGMAS times that, itself or along its edges, or leans away by more than CONE, keeps its
    normal to the bit: fog that faces elsewhere is lit as it faces.
    """
    places, ways = np.asarray(points, np.float64), np.asarray(normals, np.float64)
    edges = edge_uses(faces, len(points))
    rings = np.maximum(np.diff(edges.indptr), 1)
    ends = np.repeat(np.arange(len(points)), np.diff(edges.indptr)), edges.indices
    lengths = np.bincount(ends[0], np.linalg.norm(places[ends[0]] - places[ends[1]], axis=1), len(points)) / rings
    edges.data[:] = 1
    calm = patches.take(patches.scatter <= SIGMAS * patches.thickness)  # nothing stands out within them
    vertices = _Vertices(places, ways, SIGMAS * thickness, lengths, patches.cells_of(places))
    summed, shares, planes = np.zeros_like(ways), np.zeros(len(points)), []
    for plane in planes_of(patches):
        rows = vertices.on(plane, calm)
        turning = _turning(places[rows], ways[rows], np.ones(len(rows)), CELL * patches.side / PATCH)
        if not len(rows) or turning > MOST_TURNING:
            continue
        planes.append(plane)
        on = np.zeros(len(points))
        on[rows] = 1
        share = (1 - shares) * on * (edges @ on) / rings
        summed += share[:, None] * plane.normal
        shares += share
    blended = summed + (1 - shares)[:, None] * ways
    blended /= np.maximum(np.linalg.norm(blended, axis=1, keepdims=True), 1e-12)
    held = np.zeros(len(patches.areas), bool)
    for plane in planes:
        held |= _on_plane(patches, plane)
    area = float(patches.areas[held].sum() / max(patches.areas.sum(), 1e-300))
    return Evened(np.where(shares[:, None] > 0, blended, normals).astype(np.float32), shares, area, planes)


class _Vertices(NamedTuple):
    """Points and unit normals (V, 3), how far each may stand out, mean lengths of its edges, and its cell of some
    SeenPatches, (V,) each."""

    points: Points
    normals: Directions
    reach: Floats
    lengths: Floats
    cells: Indices

    def on(self, plane: Plane, patches: SeenPatches) -> Indices:
        """Which of them lie on a plane: in the cell of a patch that does, as high as this, and tilted by no more than
        CONE, and than noise tilts edges."""
        rows = np.flatnonzero(_on_plane(patches, plane))
        if not len(rows):
            return rows
        held, first = np.unique(patches.cells[rows], return_index=True)
        at = np.minimum(np.searchsorted(held, self.cells), len(held) - 1)
        found = np.flatnonzero((held[at] == self.cells) & (self.normals @ plane.normal > np.cos(CONE)))
        above = (self.points[found] - patches.points[rows[first[at[found]]]]) @ plane.normal
        cosine = self.normals[found] @ plane.normal
        tilted = self.lengths[found] * np.sqrt(np.maximum(1 - cosine**2, 0)) / cosine
        return found[np.maximum(np.abs(above), tilted) <= self.reach[found]]


def _on_plane(patches: SeenPatches, plane: Plane) -> Mask:
    """Which patches lie on a plane, (S,): those as high and as tilted as it has them, or as their own noise allows."""
    heights, tilts = patches.points @ plane.normal - plane.offset, patches.normals @ plane.normal
    reach = SIGMAS * np.maximum(plane.noise, patches.thickness)
    return (np.abs(heights) < reach) & (tilts > np.cos(SIGMAS * plane.spread))


def _drawn(areas: Floats, rng: np.random.Generator) -> Indices:
    """SAMPLE rows of what has areas (M,), by these."""
    chances = areas.cumsum()
    return np.minimum(np.searchsorted(chances, rng.random(SAMPLE) * chances[-1]), len(chances) - 1)


def planes_of(patches: SeenPatches) -> list[Plane]:
    """The planes that patches lie on, the surest first; each patch counts for one of them, by its area."""
    if not len(patches.areas):
        return []
    rng = np.random.default_rng(0)
    surface = _Surface(patches.points, patches.normals, patches.thickness, patches.side / PATCH)
    drawn = surface.take(_drawn(patches.areas, rng))
    left, seeds, failed = np.ones(SAMPLE, bool), np.ones(SAMPLE, bool), 0
    planes: list[Plane] = []
    while failed < MOST_FAILED and (left & seeds).sum() > LEAST_AREA:
        these, chosen = drawn.take(left), rng.choice(np.flatnonzero(left & seeds), DRAWS)
        best = max(chosen, key=lambda seed: _close(these, drawn.points[seed], drawn.normals[seed]))
        found = _fitted(these, drawn.normals[best], float(drawn.normals[best] @ drawn.points[best]))
        if found is None:
            break
        if found.is_sure:
            planes.append(found)
            left &= ~drawn.on(found)
            seeds &= ~drawn.around(found.normal, found.offset)[2]
            failed = 0
        else:
            seeds &= ~drawn.on(found)
            failed += 1
    return planes


def _close(these: _Surface, point: Vector, normal: Vector) -> int:
    """The number of patches within half the band and half the cone of a plane."""
    close = np.abs((these.points - point) @ normal) < these.band / 2
    return int((close & (these.normals @ normal > np.cos(CONE / 2))).sum())


def _fitted(these: _Surface, normal: Vector, offset: float) -> Plane | None:
    """The plane near one given that fits best, None where too few patches lie near it: by expectation and maximisation
    of the likelihood of heights and normals together."""
    noise, spread, share = these.band / SIGMAS, CONE / SIGMAS, 0.5
    near = np.abs(these.points @ normal - offset) < 2 * these.band  # where it may move to
    these = these.take(near & (these.normals @ normal > 0))
    for _ in range(STEPS):
        heights, angles, around = these.around(normal, offset)
        rows = np.flatnonzero(around)
        if len(rows) < LEAST_AREA:
            return None
        likelier = these.likelier(heights[rows], angles[rows], noise, spread)
        weight = share * likelier / (share * likelier + 1 - share)
        count = weight.sum()
        share = min(count / len(rows), 1 - 1 / len(rows))  # one of them lies there by chance
        middle = weight @ these.points[rows] / count
        rest, ways = these.points[rows] - middle, these.normals[rows]
        across = (rest * weight[:, None]).T @ rest / noise**2 - (ways * weight[:, None]).T @ ways / spread**2
        axis = np.linalg.eigh(across)[1][:, 0]
        normal = axis if axis @ normal >= 0 else -axis
        offset = float(normal @ middle)
        noise = max(float(np.sqrt(weight @ (rest @ normal) ** 2 / count)), these.band / 100)
        spread = max(float(np.sqrt(weight @ angles[rows] ** 2 / count / 2)), LEAST_SPREAD)
    gain = float(np.log(share * likelier + 1 - share).sum() / count)
    turning = _turning(rest, ways, weight, CELL * these.band)
    thickness = float(weight @ these.thickness[rows] / count)
    return Plane(normal, offset, noise, spread, float(count), gain, turning, thickness)


def _turning(points: Points, ways: Directions, weight: Floats, side: float) -> float:
    """Share of the variance of normals that follows from places, linearly, within cells of a side: 0 on planes, near 1
    on round things. Bumps and dents cancel."""
    _, cell = np.unique(np.floor(points / side), axis=0, return_inverse=True)
    total = np.maximum(np.bincount(cell.ravel(), weight), 1e-300)

    def inside(values: Floats) -> Floats:
        means = np.stack([np.bincount(cell.ravel(), weight * column) for column in values.T], axis=1) / total[:, None]
        return values - means[cell.ravel()]

    rest, tilts = inside(points), inside(ways)
    scaled = rest * weight[:, None]
    explained = rest @ (np.linalg.pinv(scaled.T @ rest, rcond=FLAT) @ (scaled.T @ tilts))
    return float(weight @ (explained**2).sum(axis=1) / max(weight @ (tilts**2).sum(axis=1), 1e-300))
