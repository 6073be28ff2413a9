"""Normals for light: those of planes on walls, floors and table tops of a place, whose vertices stay where they are.

Where training sees little texture it leaves a fog of Gaussians before a wall. A mesh of it has bumps that the wall has
not. The fog carries the wall's colour, so it is what is lit, but light should fall on it as on the wall. Planes are
drawn through one vertex and its normal each (after Fischler and Bolles, "Random Sample Consensus", 1981) and fitted as
one part of a mixture: vertices lie on the plane, with a spread of their heights and one of their normals, or anywhere.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Directions, Faces, Floats, Mask, Points, Vector
from .fair import edge_uses

SAMPLE, SKETCH = 40_000, 4_000
"""Vertices, drawn by their area, that planes are fitted to, and those of them that tell good draws from bad ones."""

DRAWS, REFINED = 96, 4
"""Planes drawn for each that is looked for, and those of them, the best, that are fitted."""

STEPS = 12
"""Steps of a fit."""

SIGMAS = 3.0
"""Standard deviations within which a thing is where it is expected: 997 times in 1,000."""

CONE = np.pi / 4
"""Largest angle between a plane's normal and one that is weighed, radians."""

WIDE, LEAST_SPREAD = 0.2, 0.07
"""Spread of normals along each of two axes, radians, from which a fit starts, and the least: some of a facade may be
seen far better than the rest."""

LEAST_AREA, LEAST_GAIN = SAMPLE / 200, 1.2
"""Vertices of the sample that lie on a plane at least, and how much likelier they are with it, the mean of logarithms.
Draws through chairs, curtains and hedges reach 1.17."""

CELL, MOST_TURNING, FLAT = 8.0, 0.25, 1e-3
"""Side, in bands, of the cells within which normals may turn with their places; share of their variance above which
what they lie on is round; and variance across a plane, over that along it, which counts as none. Planes of rooms and
streets have up to 0.2, columns 0.9."""

LEAST_FITTED = 50
"""Vertices that a fit needs."""

MOST_FAILED = 5
"""Fits one after the other that give no plane, after which there are no more."""

RINGS = 8
"""Rings over which normals are averaged where planes are drawn."""

DOUBT = 1e-3
"""Least chance of a vertex to lie on a plane, or not, whatever its neighbours do."""


class Plane(NamedTuple):
    """A plane that vertices lie on: normal (3,) unit, offset: normal . x of its points x, standard deviation of their
    heights over it and of their normals about it, radians along each of two axes. share: of the vertices around that
    lie on it. held, gain, turning: of the sample, as LEAST_AREA, LEAST_GAIN and MOST_TURNING have them."""

    normal: Vector
    offset: float
    noise: float
    spread: float
    share: float
    held: float
    gain: float
    turning: float

    @property
    def is_sure(self) -> bool:
        """Whether enough lies on it, surely enough, and is not round."""
        return self.held >= LEAST_AREA and self.gain >= LEAST_GAIN and self.turning <= MOST_TURNING

    def rank(self) -> tuple[bool, float]:
        """What the best of several planes has most of."""
        return self.is_sure, self.gain * self.held


class Evened(NamedTuple):
    """Normals (V, 3) float32 for light. shares: (V,) in [0, 1], how surely each vertex lies on a plane. area: share of
    the mesh's area that does, far area counting less. planes: the surest first."""

    normals: NDArray[np.float32]
    shares: Floats
    area: float
    planes: list[Plane]


class _Vertices(NamedTuple):
    """Points and unit normals (M, 3) of vertices, and the most distance between a plane and what lies on it."""

    points: Points
    normals: Directions
    band: float

    def take(self, rows: NDArray) -> "_Vertices":
        """Some of them, by number or as (M,) bool."""
        return _Vertices(self.points[rows], self.normals[rows], self.band)

    def around(self, normal: Vector, offset: float) -> tuple[Floats, Floats, Mask]:
        """Heights over a plane (M,), angles of the normals to its own (M,), and which of both are weighed."""
        heights, angles = self.points @ normal - offset, np.arccos(np.clip(self.normals @ normal, -1, 1))
        return heights, angles, (np.abs(heights) < self.band) & (angles < CONE)

    def likelier(self, heights: Floats, angles: Floats, noise: float, spread: float) -> Floats:
        """Density on a plane of such a noise and spread over that of an even distribution: (M,)."""
        bells = np.exp(-0.5 * (heights / noise) ** 2 - 0.5 * (angles / spread) ** 2)
        evenly = 2 * self.band * 2 * np.pi * (1 - np.cos(CONE))
        return bells * evenly / ((2 * np.pi) ** 1.5 * noise * spread**2)


def evened(points: Points, normals: Directions, faces: Faces, near: tuple[Vector, float], band: float) -> Evened:
    """Give vertices the normals of planes they lie on, larger planes first, blended where these end.

    points, normals: (V, 3), unit. faces: (F, 3). near: middle (3,) of the place, and the distance from there at which
    area counts a quarter. band: most distance between a plane and what lies on it, such as the thickness of fog. What
    stands out by more than SIGMAS times the noise, in height or direction, keeps its normal to the bit.
    """
    mesh = _Vertices(np.asarray(points, np.float64), np.asarray(normals, np.float64), band)
    corners = mesh.points[faces]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.bincount(faces.ravel(), np.repeat(np.linalg.norm(crosses, axis=1), 3), len(points)).astype(np.float64)
    areas /= (1 + (np.linalg.norm(mesh.points - near[0], axis=1) / near[1]) ** 2) ** 2
    edges = edge_uses(faces, len(points))
    edges.data[:] = 1
    planes = _planes(mesh, areas, edges) if areas.any() and band > 0 else []
    summed, shares = np.zeros_like(mesh.normals), np.zeros(len(points))
    for plane in planes:
        rows = np.flatnonzero(mesh.around(plane.normal, plane.offset)[2])
        share = (1 - shares[rows]) * _shares(mesh.take(rows), edges[rows][:, rows], plane)
        summed[rows] += share[:, None] * plane.normal
        shares[rows] += share
    blended = summed + (1 - shares)[:, None] * mesh.normals
    blended /= np.maximum(np.linalg.norm(blended, axis=1, keepdims=True), 1e-12)
    given = np.where(shares[:, None] > 0, blended, normals).astype(np.float32)
    return Evened(given, shares, float(shares @ areas / max(areas.sum(), 1e-300)), planes)


def _shares(these: _Vertices, edges: "scipy.sparse.csr_matrix", plane: Plane) -> Floats:
    """How surely each of R vertices lies on a plane, (R,): by its height and normal, and where its neighbours do.
    edges: (R, R), 1 between these."""
    heights, angles, _ = these.around(plane.normal, plane.offset)
    likelier = these.likelier(heights, angles, plane.noise, plane.spread)
    likelier[np.maximum(np.abs(heights) / plane.noise, angles / plane.spread) > SIGMAS] = 0
    rings, share = np.maximum(np.diff(edges.indptr), 1), np.full(len(heights), plane.share)
    for _ in range(STEPS):
        expected = np.clip(share, DOUBT, 1 - DOUBT)
        on = expected * likelier / (expected * likelier + 1 - expected)
        share = edges @ on / rings
    return on


def _planes(mesh: _Vertices, areas: Floats, edges: "scipy.sparse.csr_matrix") -> list[Plane]:
    """The planes of a mesh; each vertex counts for one of them, by its area (V,)."""
    rng = np.random.default_rng(0)
    even = mesh.normals
    for _ in range(RINGS):
        even = edges @ (even * areas[:, None]) + even * areas[:, None]
        even /= np.maximum(np.linalg.norm(even, axis=1, keepdims=True), 1e-12)
    chances = areas.cumsum()
    rows = np.minimum(np.searchsorted(chances, rng.random(SAMPLE) * chances[-1]), len(chances) - 1)
    drawn, even = mesh.take(rows), even[rows]
    left, seeds, failed = np.ones(SAMPLE, bool), np.ones(SAMPLE, bool), 0
    planes: list[Plane] = []
    while failed < MOST_FAILED and (left & seeds).sum() > LEAST_AREA:
        these, chosen = drawn.take(left), rng.choice(np.flatnonzero(left & seeds), DRAWS)
        sketch = these.take(rng.choice(len(these.points), min(SKETCH, len(these.points)), replace=False))
        counts = np.array([_close(sketch, drawn.points[seed], even[seed]) for seed in chosen]).reshape(REFINED, -1)
        best = chosen.reshape(REFINED, -1)[np.arange(REFINED), counts.argmax(axis=1)]
        fits = [_fitted(these, even[seed], float(even[seed] @ drawn.points[seed])) for seed in best]
        found = max((fit for fit in fits if fit is not None), key=Plane.rank, default=None)
        if found is None:
            break
        heights, angles, around = drawn.around(found.normal, found.offset)
        on = (np.abs(heights) < SIGMAS * found.noise) & (angles < SIGMAS * found.spread)
        if found.is_sure:
            planes.append(found)
            left &= ~on
            seeds &= ~around
            failed = 0
        else:
            seeds &= ~on
            failed += 1
    return planes


def _close(these: _Vertices, point: Vector, normal: Vector) -> int:
    """The number of vertices within half the band and half the cone of a plane."""
    close = np.abs((these.points - point) @ normal) < these.band / 2
    return int((close & (these.normals @ normal > np.cos(CONE / 2))).sum())


def _fitted(these: _Vertices, normal: Vector, offset: float) -> Plane | None:
    """The plane near one given that fits best, None where hardly any vertex lies on it: by expectation and maximisation
    of the likelihood of heights and normals together."""
    noise, spread, share = these.band / SIGMAS, WIDE, 0.5
    near = np.abs(these.points @ normal - offset) < 2 * these.band  # where it may move to
    these = these.take(near & (these.normals @ normal > 0))
    for _ in range(STEPS):
        heights, angles, around = these.around(normal, offset)
        rows = np.flatnonzero(around)
        if len(rows) < LEAST_FITTED:
            return None
        likelier = these.likelier(heights[rows], angles[rows], noise, spread)
        weight = share * likelier / (share * likelier + 1 - share)
        count = weight.sum()
        share = min(count / len(rows), 1 - DOUBT)
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
    return Plane(normal, offset, noise, spread, share, float(count), gain, turning)


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
