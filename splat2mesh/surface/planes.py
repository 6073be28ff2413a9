"""Planes that the Gaussians of a place lie on, walls, floors, table tops, and which vertices of its mesh lie on them.

Where training sees little texture it leaves a fog of Gaussians before a wall, and a mesh of it has bumps that the wall
has not. Most of the area of the Gaussians lies on the wall, so its plane is known far better than any depth. Planes are
drawn through three Gaussians each (Fischler and Bolles, "Random Sample Consensus", 1981). Each is fitted as one part of a
mixture, first of Gaussians by their height over it, then of vertices by their height and normal: they lie on the plane
with a spread, or anywhere in any direction.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Directions, Faces, Floats, Points, Vector
from ..splats.splats import Splats
from .fair import edge_uses

SAMPLE, SKETCH = 40_000, 4_000
"""Gaussians, drawn by their area, that planes are fitted to, and those of them that tell good draws from bad ones."""

DRAWS, REFINED = 192, 4
"""Planes drawn for each that is looked for, and those of them, the best, that are fitted."""

REACH = 12.0
"""Largest distance between the Gaussians that a plane is drawn through, in units of the band."""

STEPS = 12
"""Steps of a fit."""

SIGMAS = 3.0
"""Standard deviations within which a thing is where it is expected: 997 times in 1,000."""

LEAST_GAIN = SAMPLE / 80
"""Logarithm of how much likelier the sample must be with a plane than with the same Gaussians evenly around it."""

LEAST_FITTED = 50
"""Gaussians or vertices that a fit needs."""

MOST_FAILED = 5
"""Fits one after the other that give no plane, after which there are no more."""

WIDE, LEAST_SPREAD = 0.3, 0.01
"""Spread of normals about a plane's, radians along each of two axes, from which a fit starts, and the least."""

BEFORE = 1.5
"""Farthest vertex from a plane in bands: a mesh lies in the fog before the Gaussians. With 1 a seventh of the walls of
generated lounges is missing, with 3 a table takes the floor."""

LEAST_EXPECTED = 1e-3
"""Least share of a vertex that its neighbours may make expected, and of the opposite."""


class Plane(NamedTuple):
    """A plane: normal (3,) unit, offset: normal . x of its points x. noise: standard deviation of the Gaussians'
    centres about it. gain: logarithm of how much likelier they are with it."""

    normal: Vector
    offset: float
    noise: float
    gain: float


class Evened(NamedTuple):
    """Normals (V, 3) float32 for light. shares: (V,) in [0, 1], how surely each vertex lies on a plane. area: share of
    the mesh's area that does."""

    normals: NDArray[np.float32]
    shares: Floats
    area: float


def planes_of(splats: Splats, middle: Vector, reach: float, band: float, pixel: float) -> list[Plane]:
    """The planes of a place, those with the most area first; each Gaussian counts for one of them.

    splats: in whose frame all is. middle: (3,) of the place. reach: distance from there at which area counts a quarter.
    band: most distance between a plane and its fog. pixel: training pixel.
    """
    rng = np.random.default_rng(0)
    scales = np.sort(splats.scales, axis=1).astype(np.float64)
    areas = splats.opacities * scales[:, 1] * scales[:, 2]
    distance = np.linalg.norm(splats.means - middle, axis=1)
    chances = (areas / (1 + (distance / reach) ** 2) ** 2).cumsum()
    if len(chances) == 0 or not (chances[-1] > 0 and band > 0):
        return []
    rows = np.searchsorted(chances, rng.random(SAMPLE) * chances[-1])
    centers = splats.means[np.minimum(rows, len(chances) - 1)].astype(np.float64)
    left, seeds, failed = np.ones(SAMPLE, bool), np.ones(SAMPLE, bool), 0
    planes: list[Plane] = []
    while failed < MOST_FAILED and (left & seeds).sum() > LEAST_GAIN:
        plane = _best(centers, np.flatnonzero(left), np.flatnonzero(left & seeds), band, pixel, rng)
        if plane is None:
            break
        height = np.abs(centers @ plane.normal - plane.offset)
        if plane.gain >= LEAST_GAIN:
            planes.append(plane)
            left &= height >= SIGMAS * plane.noise
            seeds &= height >= band  # fog is no plane of its own
            failed = 0
        else:
            seeds &= height >= SIGMAS * plane.noise
            failed += 1
    return planes


def _best(
    centers: Points, left: NDArray, seeds: NDArray, band: float, pixel: float, rng: np.random.Generator
) -> Plane | None:
    """The plane of most area through Gaussians that are `left`, drawn from the `seeds` of them."""
    these = centers[left]
    sketch = these[rng.choice(len(these), min(SKETCH, len(these)), replace=False)]
    drawn: list[tuple[float, Vector, float]] = []
    for seed in rng.choice(seeds, DRAWS):
        first = centers[seed]
        near = np.flatnonzero(np.linalg.norm(sketch - first, axis=1) < band * REACH ** rng.random())
        if len(near) < 3:
            continue
        second, third = sketch[rng.choice(near, 2, replace=False)]
        normal = np.cross(second - first, third - first)
        length = np.linalg.norm(normal)
        if length > 0:
            normal /= length
            height = np.abs(sketch @ normal - normal @ first)
            inner, outer = (height < band / 2).sum(), (height < 1.5 * band).sum()
            drawn.append((1.5 * inner - 0.5 * outer, normal, float(normal @ first)))
    drawn.sort(key=lambda each: -each[0])
    fits = [_fitted(these, normal, offset, band, pixel) for _, normal, offset in drawn[:REFINED]]
    return max((fit for fit in fits if fit is not None), key=lambda fit: fit.gain, default=None)


def _fitted(these: Points, normal: Vector, offset: float, band: float, pixel: float) -> Plane | None:
    """The plane near one given to which centres of equal area (M, 3) fit best, None where there are hardly any: by
    expectation and maximisation, within the band."""
    noise, share = band / SIGMAS, 0.5
    for _ in range(STEPS):
        heights = these @ normal - offset
        near = np.flatnonzero(np.abs(heights) < band)
        if len(near) < LEAST_FITTED:
            return None
        on = share * _bell(heights[near], noise)
        weight = on / (on + (1 - share) / (2 * band))
        mass = weight.sum()
        share = min(mass / len(near), 1 - 1e-6)
        middle = weight @ these[near] / mass
        rest = these[near] - middle
        axis = np.linalg.eigh((rest * weight[:, None]).T @ rest)[1][:, 0]
        normal = axis if axis @ normal >= 0 else -axis
        offset = float(normal @ middle)
        noise = max(float(np.sqrt(weight @ (rest @ normal) ** 2 / mass)), pixel / 4)
    heights = these @ normal - offset
    gain = np.log(2 * band * share * _bell(heights[np.abs(heights) < band], noise) + 1 - share).sum()
    return Plane(normal, offset, noise, float(gain))


def _bell(x: Floats, spread: float) -> Floats:
    """Density of a normal distribution about 0."""
    return np.exp(-0.5 * (x / spread) ** 2) / (np.sqrt(2 * np.pi) * spread)


def on_planes(
    planes: Sequence[Plane], points: Points, normals: Directions, faces: Faces, band: float
) -> Evened:
    """Normals for light: those of planes where vertices lie on them, larger planes first, and blended at their rims.

    points, normals: (V, 3), unit. faces: (F, 3). band: as of `planes_of`. The vertices stay where they are. What stands
    out by more than SIGMAS times the noise, in height or in the direction of its normal, keeps its normal to the bit.
    """
    points, own = np.asarray(points, np.float64), np.asarray(normals, np.float64)
    corners = points[faces]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.bincount(faces.ravel(), np.repeat(np.linalg.norm(crosses, axis=1), 3), len(points))
    uses = edge_uses(faces, len(points))
    uses.data[:] = 1
    summed, shares = np.zeros_like(own), np.zeros(len(points))
    band *= BEFORE
    for plane in planes:
        near = np.flatnonzero(np.abs(points @ plane.normal - plane.offset) < band)
        heights, cosines = points[near] @ plane.normal - plane.offset, own[near] @ plane.normal
        angles, free = np.arccos(np.minimum(np.abs(cosines), 1)), 1 - shares[near]
        share = free * _shares(heights, angles, free * areas[near], uses[near][:, near], plane, band)
        summed[near] += (share * np.sign(cosines))[:, None] * plane.normal
        shares[near] += share
    blended = summed + (1 - shares)[:, None] * own
    blended /= np.linalg.norm(blended, axis=1, keepdims=True)
    given = np.where(shares[:, None] > 0, blended, normals).astype(np.float32)
    return Evened(given, shares, float(shares @ areas / max(areas.sum(), 1e-300)))


def _shares(
    heights: Floats, angles: Floats, areas: Floats, among: "scipy.sparse.csr_matrix", plane: Plane, band: float
) -> Floats:
    """How surely each of R vertices lies on a plane, (R,): by height (R,) and angle (R,) of its normal, with the spreads
    found there, by expectation and maximisation, where that of its neighbours is what is expected (R, R)."""
    rings, level, noise, spread = np.maximum(np.diff(among.indptr), 1), 0.0, band / SIGMAS, WIDE
    expected = on = np.full(len(heights), 0.5)
    for _ in range(STEPS):
        off = np.abs(heights - level) / noise, angles / spread
        fits = _bell(heights - level, noise) * 2 * band * np.exp(-0.5 * off[1] ** 2) / spread**2
        on = np.where(np.maximum(*off) < SIGMAS, expected * fits / (expected * fits + 1 - expected), 0.0)
        weight = on * areas
        mass = weight.sum()
        if not mass > 0:
            return np.zeros(len(heights))
        level = float(weight @ heights / mass)
        noise = max(float(np.sqrt(weight @ (heights - level) ** 2 / mass)), plane.noise / 4)
        spread = max(float(np.sqrt(weight @ angles**2 / mass / 2)), LEAST_SPREAD)
        expected = np.clip(among @ on / rings, LEAST_EXPECTED, 1 - LEAST_EXPECTED)
    return on
