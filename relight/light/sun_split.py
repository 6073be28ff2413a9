"""Split light that is too concentrated for spherical harmonics off an environment, as suns that are ray traced.

    rest, suns = split(environment)
    radiance = transfer @ rest.sh(bands) + sunlight(occluder, rows, suns)

The coefficients of light split in this way are exact, SH(rest) + SH(suns as points) = SH(environment). Errors come
only from beyond the bands: from contrast that stays in the rest, and from patches that now shine as points. Estimate
both for walls that may stand anywhere, and find the fewest suns within a tolerance.
"""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Indices, Integers, Radiance
from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.color import luminance
from splat2mesh.scene.measured import SKY_HEIGHT, SKY_WIDTH

from ..sh import harmonics
from . import HEIGHT, SUN_TOLERANCE, projections
from .environment import Environment, Suns, turned_about_y
from .projections import pooled, pooling

DEFAULT_LIMIT = 128
"""Most suns. Half of them stand before a vertex: a quarter of the rays of the default transfer, for every light."""

LEVELS = 160.0 * 0.5 ** np.arange(7)  # where luminance is cut off, over its mean: down to 2.5
_OPENING_DEG = 2.0  # narrower patches are cut down to what surrounds them, wider ones to the level
_POINT_DEG = 2.0  # a bright texel with dark ones around it is a point, unless it is higher than this
PARTS = 8  # a side of each texel at most; a sun's disc may be one texel
_PART_ENERGY = 1.0 / 1024  # of the light, in each part of a texel: well below what one sun holds
_POOL_HEIGHT = 2 * HEIGHT  # rows of finer images are pooled to so many, of 0.35 degrees: less than the solar disc
ENOUGH = 1.1  # of the least error that can be reached: the last tenth can take a hundred suns
GRID = (SKY_HEIGHT, SKY_WIDTH)  # for the estimate: cells of 2.8 degrees, well under the width of a lobe of 10 bands

_EDGE_ERROR = (math.sqrt(2.0) - 1.0) / (2.0 * math.sqrt(math.pi)) / (6.0 * math.pi**2)
"""Mean squared error of exit radiance, per squared weight and radian of spread, when a spot shines as a point: vertices
face anywhere, so that their cosine squared has mean 1/6; a wall's edge, a great circle of any direction, passes at a
distance of density 1/2; and at a distance x the error of a normal distribution of spread s is Q(|x| / s), whose square
integrates to s (sqrt 2 - 1) / sqrt pi."""

_SPREAD_HELD = 1.36  # over B: a wider spot is as wrong as one of this spread, since the bands hold what is smoother

Spots: TypeAlias = tuple[Directions, Radiance, Floats]
"""Directions (P, 3), weights (P, 3) and variances (P,) in rad^2 of small patches of light."""


class Rest(Environment):
    """An environment without its suns. Its image has them cut off. Its coefficients are those of the whole less those
    of the suns as points, so that both together are exact in any number of bands.

    width: estimated relative error from patches that shine as points, and error: in all. variances: (S,) of those
    patches, mean square of the distance from the sun over its light, rad^2.
    """

    def __init__(
        self, whole: Environment, image: Radiance, suns: tuple[Suns, Floats], width: float, error: float
    ) -> None:
        """Make it of an unrotated Environment: the image (H, W, 3) of what stays, and the Suns removed with the
        variances of their patches."""
        super().__init__(image, whole.name)
        self.repaired = whole.repaired
        self._whole, (self._suns, self.variances), self.width, self.error = whole, suns, width, error

    def sh(self, bands: int) -> NDArray[np.float64]:
        """Radiance coefficients (B^2, 3) float64 in the basis of `relight.sh.harmonics`, rotation included."""
        unrotated = self.derived(("sh", bands), lambda: self._whole.sh(bands) - self._suns.sh(bands))
        return turned_about_y(unrotated, self.rotation_deg)


def split(
    environment: Environment,
    bands: int = harmonics.MAX_BANDS,
    tolerance: float = SUN_TOLERANCE,
    limit: int = DEFAULT_LIMIT,
) -> tuple[Environment, Suns]:
    """Split an Environment, turned or not, into what few bands hold and the suns beside it, brightest first, turned
    alike.

    bands: of the transfer that it will light, from 1 to 10. tolerance: relative error of radiance that may remain, an
    estimate: root mean square over vertices beside walls. limit: most suns; where they do not reach the tolerance, the
    fewest that come to 1.1 of the least estimate. The rest is the Environment itself where the bands hold it well
    enough. Raises InputError for bands outside 1..10, and for a tolerance or a limit that is not positive.

    What exceeds a level of luminance is cut off and gathered into suns. Level and number are found once for an image
    and all its rotations.
    """
    harmonics.check_bands(bands)
    if not tolerance > 0.0:
        raise InputError(f"the tolerance of the sun split must be above 0, found {tolerance}")
    if limit != int(limit) or limit < 1:
        raise InputError(f"the limit of suns must be a whole number above 0, found {limit}")
    turned = environment.rotation_deg
    rest, suns = environment.derived(
        ("split", bands, tolerance, limit), lambda: _split(environment.rotated(-turned), bands, tolerance, limit)
    )
    return (rest.rotated(turned), suns.rotated(turned)) if len(suns) else (environment, suns)


def _split(environment: Environment, bands: int, tolerance: float, limit: int) -> tuple[Environment, Suns]:
    """Rest (or the environment itself) and Suns of an unrotated environment."""
    image = _square_texels(environment.radiance)
    coarse = environment.derived(("coarse", bands), lambda: _Coarse(image, bands))
    if coarse.contrast() <= tolerance:
        return environment, Suns.none()
    cuts = environment.derived(("cuts", bands), lambda: list(_cuts(environment, image, coarse)))
    if not cuts:
        return environment, Suns.none()
    (missed, _, error), cut, label = _cheapest(cuts, bands, coarse.scale, tolerance, limit)
    if missed:
        (_, _, error), cut, label = _cheapest(cuts, bands, coarse.scale, error * ENOUGH, limit)
    suns, rest = _suns(cut.spots, label), image.copy()
    rest[cut.row, cut.column] *= cut.stays[:, None].astype(np.float32)
    width = math.sqrt(max(error**2 - cut.contrast**2, 0.0))
    return Rest(environment, rest, suns, width, error), suns[0]


class _Cut(NamedTuple):
    """The result of cutting at a level: texels, the share of each that stays, and the spots removed."""

    row: Indices
    column: Indices
    stays: NDArray[np.float64]
    spots: Spots
    contrast: float  # that the rest has, relative


def _cuts(environment: Environment, image: Radiance, coarse: "_Coarse") -> Iterator[_Cut]:
    """A _Cut for every level that anything exceeds."""
    brightness = luminance(image)
    around = _around(brightness)
    power = 4.0 * np.pi * environment.mean_luminance
    for level in LEVELS * environment.mean_luminance:
        row, column = np.nonzero(brightness > level)
        if not len(row):
            continue
        stays = np.minimum(level, around[row, column]) / brightness[row, column]  # narrow patches drop to that
        excess = image[row, column] * (1.0 - stays)[:, None]
        spots = _spots(row, column, excess, brightness.shape, power * _PART_ENERGY)
        yield _Cut(row, column, stays, spots, coarse.contrast(row, column, excess))


def _cheapest(
    cuts: list[_Cut], bands: int, scale: float, tolerance: float, limit: int
) -> tuple[tuple[bool, int, float], _Cut, NDArray[np.int64]]:
    """((missed, number, error), cut, labels of its spots): fewest suns within the tolerance, else the least error."""
    best: tuple[tuple[bool, int, float], _Cut, NDArray[np.int64]] | None = None
    for cut in cuts:
        most = limit if best is None or best[0][0] else min(limit, best[0][1])
        label, count, width = clusters(cut.spots, bands, scale, tolerance**2 - cut.contrast**2, most)
        error = math.hypot(cut.contrast, width)
        found = error > tolerance, count if error <= tolerance else 0, error
        if best is None or found < best[0]:
            best = found, cut, label
    if best is None:
        raise ValueError("expected a cut to choose from, found none")
    return best


def _square_texels(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same patches of radiance in about square texels: rows or columns repeated, to 0.35 degrees at the finest.

    What follows takes a texel to be as wide as it is high. Images about twice as wide as high come back themselves.
    """
    height, width, _ = image.shape
    down = round(min(width, 2 * _POOL_HEIGHT) / (2 * height))
    right = round(min(2 * height, 2 * _POOL_HEIGHT) / width)
    if max(down, right) <= 1:
        return image
    return np.repeat(np.repeat(image, max(1, down), axis=0), max(1, right), axis=1)


class _Coarse:
    """An image in cells of 2.8 degrees, and its light on imagined vertices, in full and in a few bands.

    Each vertex faces a direction of a Fibonacci sphere; a wall beside it hides a half of all directions at random.
    """

    def __init__(self, image: Radiance, bands: int) -> None:
        height, width, _ = image.shape
        self._rows, self._columns = pooling((height, width), GRID)
        self._full, self._banded, self._project = _probes(bands)
        self._cells = pooled(image, GRID).reshape(-1, 3)
        self._shape = height, width
        self.scale = math.sqrt(np.square(self._full @ self._cells).sum(axis=1).mean())

    def contrast(
        self, row: Indices | tuple[()] = (), column: Indices | tuple[()] = (), excess: Radiance | None = None
    ) -> float:
        """Relative error, root mean square, of the banded light of the image less the `excess` (T, 3) of texels."""
        cells = self._cells.copy()
        if excess is not None:
            for color in range(3):
                less = scipy.sparse.csr_array((excess[:, color], (row, column)), self._shape)
                cells[:, color] -= (self._rows @ less @ self._columns.T).toarray().ravel()
        cells = cells.astype(np.float32)
        error = self._full @ cells - self._banded @ (self._project @ cells)
        return math.sqrt(np.square(error).sum(axis=1).mean()) / self.scale if self.scale > 0.0 else 0.0


@lru_cache(harmonics.MAX_BANDS)
def _probes(bands: int) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Three matrices: radiance of cells to exit radiance of the imagined vertices, (P, cells); SH coefficients to the
    same, (P, K); radiance of cells to coefficients by least squares, (K, cells)."""
    full, cells, areas = _imagined()
    basis = harmonics.evaluate(cells, bands)
    weighted = (basis * areas[:, None]).T
    gram = weighted @ basis
    banded = (full @ basis.astype(np.float32)) @ np.linalg.inv(gram).astype(np.float32)
    return full, banded, weighted.astype(np.float32)


@lru_cache(1)
def _imagined() -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]:
    """The imagined vertices' exit radiance (P, cells) float32, directions and solid angles of the cells."""
    normals = fibonacci_sphere().astype(np.float32)
    walls = np.random.default_rng(0).normal(size=normals.shape).astype(np.float32)
    cells = projections.texel_directions(*GRID).reshape(-1, 3)
    areas = np.repeat(projections.row_solid_angles(*GRID).ravel(), GRID[1])
    toward = cells.T.astype(np.float32)
    full = np.maximum(normals @ toward, np.float32(0.0)) * (areas / np.pi).astype(np.float32)
    full[walls @ toward <= 0.0] = 0.0
    return full, cells, areas


def _around(brightness: Floats) -> Floats:
    """Luminance (H, W) around bright patches narrower than `_OPENING_DEG`, by a morphological opening."""
    height, width = brightness.shape
    size = 2 * math.ceil(0.5 * _OPENING_DEG / 180.0 * height) + 1
    size = min(size, height, width), min(size, width)
    mode = "nearest", "wrap"
    return scipy.ndimage.maximum_filter(scipy.ndimage.minimum_filter(brightness, size, mode=mode), size, mode=mode)


def _spots(row: Indices, column: Indices, excess: Radiance, shape: tuple[int, int], part_energy: float) -> Spots:
    """Spots to gather suns from: directions (P, 3), weights (P, 3) and variances (P,) of their width, rad^2.

    A texel is divided until a part holds at most `part_energy`; texels of fine images are pooled instead.
    """
    height, width = shape
    weights = excess * projections.row_solid_angles(height, width)[row]
    if height > _POOL_HEIGHT:
        toward = projections.texel_parts(row, column, height, width, 1)[0][:, 0]
        block = (row * _POOL_HEIGHT // height) * 2 * _POOL_HEIGHT + column * 2 * _POOL_HEIGHT // width
        label = np.unique(block, return_inverse=True)[1]
        toward, weights = _gathered(toward, weights, label)
        return toward, weights, np.full(len(toward), _variance(np.pi / _POOL_HEIGHT))
    near = np.zeros(shape, np.int8)
    near[row, column] = 1
    for axis, beyond in ((0, "constant"), (1, "wrap")):
        near = scipy.ndimage.convolve1d(near, [1, 1, 1], axis, mode=beyond)
    alone = (near[row, column] == 1) & (height * _POINT_DEG >= 180.0)
    parts = np.clip(np.ceil(np.sqrt(luminance(weights) / part_energy)), 1, PARTS).astype(int)
    parts[alone] = 1
    found = []
    for count in np.unique(parts):
        of = parts == count
        toward, area = projections.texel_parts(row[of], column[of], height, width, count)
        part = excess[of][:, None] * area[..., None]
        # A square as wide as the part is high; texels toward the poles are narrower than that.
        variance = np.where(alone[of], 0.0, _variance(np.pi / height / count))
        found.append((toward.reshape(-1, 3), part.reshape(-1, 3), np.repeat(variance, count * count)))
    toward, weights, variances = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
    return toward, weights, variances


def _variance(side: float) -> float:
    """Mean squared distance from the centre of a square with this side."""
    return side * side / 6.0


def _suns(spots: Spots, label: Integers) -> tuple[Suns, NDArray[np.float64]]:
    """Suns of clusters, brightest first, and the (S,) variances of their light."""
    toward, weights, variances = spots
    directions, gathered = _gathered(toward, weights, label)
    order = np.argsort(-luminance(gathered), kind="stable")
    bright = luminance(weights)
    apart = np.square(toward - directions[label]).sum(axis=1) + variances
    spread = np.bincount(label, bright * apart) / np.bincount(label, bright)
    return Suns(directions[order], gathered[order]), spread[order]


def _gathered(
    toward: Directions, weights: Radiance, label: Integers
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions (S, 3) to the centroids of luminance, and summed weights (S, 3), of spots by label 0..S - 1."""
    moment = toward * luminance(weights)[:, None]
    total = np.asarray(np.stack([np.bincount(label, values) for values in (*moment.T, *weights.T)], axis=1), np.float64)
    return total[:, :3] / np.linalg.norm(total[:, :3], axis=1, keepdims=True), total[:, 3:]


def clusters(spots: Spots, bands: int, scale: float, allowed: float, most: int) -> tuple[NDArray[np.int64], int, float]:
    """Gather P spots of light into clusters that may each shine as a point.

    bands: of the light without them. scale: root mean square radiance, to which errors are relative. allowed: sum of
    squared relative errors that may remain. most: clusters at most. Returns the cluster of each spot, (P,) int64 from
    0, their number, and the relative error of letting each shine as a point.

    The cluster with the largest error is halved at its centroid, across its longest axis, until the squares sum to
    `allowed` or there are `most`.
    """
    toward, weights, variance = spots
    bright, held, factor = luminance(weights), _SPREAD_HELD / bands, _EDGE_ERROR / scale**2

    def error_of(part: NDArray[np.int64]) -> float:
        """Squared relative error of a cluster that shines as one point."""
        away = np.square(_off(toward[part], bright[part])).sum(axis=1) + variance[part]
        spread = min(math.sqrt(0.5 * (bright[part] * away).sum() / bright[part].sum()), held)
        return factor * spread * float(np.square(weights[part].sum(axis=0)).sum())

    parts = [np.arange(len(toward))]
    errors = [error_of(parts[0])]
    while sum(errors) > allowed and len(parts) < most:
        worst = int(np.argmax(errors))
        part = parts[worst]
        off = _off(toward[part], bright[part])
        longest = np.linalg.eigh(np.einsum("n,ni,nj->ij", bright[part], off, off))[1][:, -1]
        ahead = np.einsum("ni,i->n", off, longest) > 0.0
        if ahead.all() or not ahead.any():  # a single spot, or several in one place
            break
        parts[worst : worst + 1] = part[ahead], part[~ahead]
        errors[worst : worst + 1] = map(error_of, parts[worst : worst + 2])
    label = np.zeros(len(toward), np.int64)
    for number, part in enumerate(parts):
        label[part] = number
    return label, len(parts), math.sqrt(sum(errors))


def _off(toward: Directions, bright: Floats) -> NDArray[np.float64]:
    """Offsets (P, 3) of spots from their centroid."""
    return np.asarray(toward - (bright[:, None] * toward).sum(axis=0) / bright.sum(), np.float64)
