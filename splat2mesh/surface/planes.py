"""Planes that the Gaussians of a place lie on: walls, floors, table tops.

Where training sees little texture it leaves a fog of Gaussians before a wall. Depth maps end within the fog, but most
of the area of its Gaussians lies on the wall, so the plane is known far better than any depth. Planes are drawn through
three Gaussians each (Fischler and Bolles, "Random Sample Consensus", 1981) and fitted as one part of a mixture: area
lies on the plane with a normal spread, or evenly around it.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Floats, Mask, Points, Vector
from ..splats.splats import Splats

SAMPLE, SKETCH = 40_000, 4_000
"""Gaussians, drawn by their area, that planes are fitted to, and those of them that tell good draws from bad ones."""

DRAWS, REFINED = 192, 4
"""Planes drawn for each that is looked for, and those of them, the best, that are fitted."""

REACH = 12.0
"""Largest distance between the Gaussians that a plane is drawn through, in units of the band."""

ROUGH, FINE = 6, 12
"""Steps of a fit: of planes that were drawn, and of the best."""

SIGMAS = 3.0
"""Standard deviations within which a thing is where it is expected: 997 times in 1,000."""

LEAST_GAUSSIANS = SAMPLE / 32
"""Gaussians of the sample that a plane needs. Chance planes through furniture and hedges hold up to a fortieth."""

LEAST_FITTED = 50
"""Gaussians that a fit needs."""

MOST_FAILED = 5
"""Fits one after the other that give no plane, after which there are no more."""

CELL_PIXELS, MOST_CELLS = 4.0, 2_000
"""Side in training pixels of the cells in which a plane is solid or open, and most cells along its longer side."""

NARROWING = 0.8
"""Factor on the width within which density is sought, from step to step."""

MOST_POINTS = 512
"""Points at most that a Gaussian is spread over when cells are filled."""


class Plane(NamedTuple):
    """A plane and where on it there is a surface, in the splats' frame.

    normal: (3,) unit. offset: normal . x of its points x. noise: standard deviation of the Gaussians' centres about it.
    axes: (2, 3) unit, along it. low: (2,) corner of the cells along the axes. cell: their side. solid: (A, B) bool,
    cells whose Gaussians alone hide what is behind.
    """

    normal: Vector
    offset: float
    noise: float
    axes: NDArray[np.float64]
    low: NDArray[np.float64]
    cell: float
    solid: Mask


class FittedPlane(NamedTuple):
    """A plane fitted to Gaussians.

    normal, offset, noise: as of Plane. extent: standard deviation of the Gaussians themselves across it, the mean.
    gaussians: of equal area on it. mass: share of the area on it.
    """

    normal: Vector
    offset: float
    noise: float
    extent: float
    gaussians: float
    mass: float


class LooseGaussians(NamedTuple):
    """N Gaussians of a place: centres (N, 3), axes times scales as columns (N, 3, 3), opacities and areas (N,)."""

    centers: Points
    shapes: NDArray[np.float64]
    opacities: Floats
    areas: Floats

    @classmethod
    def of(cls, splats: Splats, rows: NDArray) -> "LooseGaussians":
        """Those of some rows (N,) of Splats."""
        scales = splats.scales[rows].astype(np.float64)
        shapes = _rotations(splats.quats_wxyz[rows].astype(np.float64)) * scales[:, None]
        return cls(splats.means[rows].astype(np.float64), shapes, splats.opacities[rows], _areas(splats)[rows])

    def take(self, rows: NDArray) -> "LooseGaussians":
        """Some of them."""
        return LooseGaussians(*(array[rows] for array in self))

    def across(self, normal: Vector) -> Floats:
        """(N,) standard deviations along a direction."""
        return np.linalg.norm(np.einsum("nij,i->nj", self.shapes, normal), axis=1)


def _areas(splats: Splats) -> Floats:
    """(N,) area that each of N Gaussians hides, seen along its shortest axis."""
    scales = np.sort(splats.scales, axis=1).astype(np.float64)
    return 2 * np.pi * splats.opacities * scales[:, 1] * scales[:, 2]


def planes_of(splats: Splats, middle: Vector, reach: float, band: float, pixel: float, level: float) -> list[Plane]:
    """The planes of a place, those with the most area first; each Gaussian counts for one of them.

    splats: Splats. middle: (3,) of the place. reach: distance from there, world units, at which area counts a quarter.
    band: most distance between a plane and its fog. pixel: training pixel. level: opacity at which there is a surface.
    """
    rng = np.random.default_rng(0)
    distance = np.linalg.norm(splats.means - middle, axis=1)
    chances = (_areas(splats) / (1 + (distance / reach) ** 2) ** 2).cumsum()
    if len(chances) == 0 or not (chances[-1] > 0 and band > 0):
        return []
    rows = np.searchsorted(chances, rng.random(SAMPLE) * chances[-1])
    drawn = LooseGaussians.of(splats, np.minimum(rows, len(chances) - 1))
    left, seeds, failed = np.ones(SAMPLE, bool), np.ones(SAMPLE, bool), 0
    planes: list[Plane] = []
    while failed < MOST_FAILED and (left & seeds).sum() > LEAST_GAUSSIANS:
        fit = _best(drawn, np.flatnonzero(left), np.flatnonzero(left & seeds), band, pixel, rng)
        if fit is None:
            break
        on = np.abs(drawn.centers @ fit.normal - fit.offset) < SIGMAS * fit.noise
        if fit.gaussians >= LEAST_GAUSSIANS:
            planes.append(_bounded(splats, _sharpened(drawn.take(left & on), fit, pixel), pixel, level))
            left &= ~on
            failed = 0
        else:
            seeds &= ~on
            failed += 1
    return planes


def _best(
    drawn: LooseGaussians, left: NDArray, seeds: NDArray, band: float, pixel: float, rng: np.random.Generator
) -> FittedPlane | None:
    """The plane of most area through Gaussians that are `left`, drawn from the `seeds` of them."""
    sketch = drawn.centers[rng.choice(left, min(SKETCH, len(left)), replace=False)]
    best: list[tuple[float, Vector, float]] = []
    for seed in rng.choice(seeds, DRAWS):
        first = drawn.centers[seed]
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
            best.append((1.5 * inner - 0.5 * outer, normal, float(normal @ first)))
    best.sort(key=lambda each: -each[0])
    these = drawn.take(left)
    fits = [_fitted(these, normal, offset, band, pixel, ROUGH) for _, normal, offset in best[:REFINED]]
    found = [fit for fit in fits if fit is not None]
    if not found:
        return None
    most = max(found, key=lambda fit: fit.mass)
    return _fitted(these, most.normal, most.offset, band, pixel, FINE)


def _fitted(
    these: LooseGaussians, normal: Vector, offset: float, band: float, pixel: float, steps: int
) -> FittedPlane | None:
    """The plane near one given to which Gaussians of equal area fit best, None where there are hardly any: by
    expectation and maximisation, within the band."""
    noise, share = band / SIGMAS, 0.5
    for _ in range(steps):
        heights = these.centers @ normal - offset
        near = np.flatnonzero(np.abs(heights) < band)
        if len(near) < LEAST_FITTED:
            return None
        heights, centers, extent = heights[near], these.centers[near], these.take(near).across(normal)
        on = share * np.exp(-0.5 * (heights / noise) ** 2) / (np.sqrt(2 * np.pi) * noise)
        sharp = 1 / (1 + extent / noise)
        weight = sharp * on / (on + (1 - share) / (2 * band))
        mass = weight.sum()
        share = min(mass / sharp.sum(), 1 - 1e-6)
        middle = weight @ centers / mass
        rest = centers - middle
        axis = np.linalg.eigh((rest * weight[:, None]).T @ rest)[1][:, 0]
        normal = axis if axis @ normal >= 0 else -axis
        offset = float(normal @ middle)
        noise = max(float(np.sqrt(weight @ (rest @ normal) ** 2 / mass)), pixel / 4)
    return FittedPlane(
        normal, offset, noise, float(weight @ extent / mass), float(mass**2 / (weight @ weight)), float(mass)
    )


def _sharpened(these: LooseGaussians, fit: FittedPlane, pixel: float) -> FittedPlane:
    """A plane moved to where the density of Gaussians of equal area is highest: they pile up behind a surface more than
    before it, or before it more than behind, but the flattest lie on it."""
    normal, offset, width = fit.normal, fit.offset, fit.noise
    extent = these.across(normal)
    for _ in range(FINE):
        variance = extent**2 + width**2
        weight = np.exp(-0.5 * (these.centers @ normal - offset) ** 2 / variance) / variance**1.5
        middle = weight @ these.centers / weight.sum()
        rest = these.centers - middle
        axis = np.linalg.eigh((rest * weight[:, None]).T @ rest)[1][:, 0]
        normal = axis if axis @ normal >= 0 else -axis
        offset, width = float(normal @ middle), max(width * NARROWING, pixel / 2)
    return fit._replace(normal=normal, offset=offset)


def _bounded(splats: Splats, fit: FittedPlane, pixel: float, level: float) -> Plane:
    """A plane with the cells in which its Gaussians reach the opacity of a surface."""
    normal = fit.normal
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    axes = np.stack([first / np.linalg.norm(first), np.cross(normal, first / np.linalg.norm(first))])
    these = LooseGaussians.of(splats, np.flatnonzero(np.abs(splats.means @ normal - fit.offset) < SIGMAS * fit.noise))
    centers, flat = these.centers @ axes.T, np.einsum("ki,nij->nkj", axes, these.shapes)
    covariance = flat @ flat.transpose(0, 2, 1)
    area = 2 * np.pi * np.sqrt(np.maximum(np.linalg.det(covariance), 0))
    cell = max(CELL_PIXELS * pixel, float(np.ptp(centers, axis=0).max()) / MOST_CELLS)
    low = centers.min(axis=0) - cell
    shape = np.ceil((centers.max(axis=0) + cell - low) / cell).astype(int) + 1
    counts = np.clip(np.ceil(2 * area / cell**2), 1, MOST_POINTS).astype(int)
    owner = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(owner)) - np.repeat(counts.cumsum() - counts, counts)
    root = np.linalg.cholesky(covariance + 1e-12 * cell**2 * np.eye(2))
    points = centers[owner] + np.einsum("nij,nj->ni", root[owner], _normal_points(MOST_POINTS)[number])
    at = np.floor((points - low) / cell).astype(int)
    inside = ((at >= 0) & (at < shape)).all(axis=1)
    depth = (these.opacities * area / counts)[owner[inside]] / cell**2
    tau = np.bincount(np.ravel_multi_index(at[inside].T, shape), depth, minlength=shape.prod()).reshape(shape)
    solid = tau > -np.log(1 - level)
    return Plane(normal, fit.offset, fit.noise, axes, low, cell, solid)


def _normal_points(count: int) -> Floats:
    """`count` points of a standard normal distribution in the plane, (count, 2), evenly: Roberts' sequence."""
    golden = np.array([0.7548776662466927, 0.5698402909980532])
    return scipy.special.ndtri((0.5 + np.arange(count)[:, None] * golden) % 1)


def _rotations(quats: Floats) -> Floats:
    """(N, 3, 3) matrices of unit quaternions (N, 4), w x y z."""
    w, x, y, z = quats.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=1)
