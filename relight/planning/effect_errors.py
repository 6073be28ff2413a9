"""The contribution of each effect to the light of a scene, measured on a sample: relative errors without it.

All are relative L2 of exit radiance over vertices and colours, the largest over TURNS rotations of the light.
"""

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Indices, Points, Radiance

from ..light.environment import Environment, Suns
from ..sh import harmonics
from ..sh.harmonics import MAX_BANDS
from ..transfer import FEW_BANDS
from ..transfer.facing import met_in_front
from .costs import FOLLOWED
from .sample import SCAN_VERTICES, TURNS, Sample, basis, cells_of, turned

PATHS = 24
"""Random paths from each vertex that measure bounced light, without matrix or transfer. The product of two halves of
them is the squared size of each bounce without bias from noise."""

DARK = 1e-3
"""Errors are relative to at least this part of the light of unshadowed surfaces: darkness has no relative error."""


CLOSER = 4
"""Times as many directions in which the sample looks before a check against it fails: its own noise, in the shade of
needles, was most of what rays were blamed for, and no number of them made it less."""


WIDE_PART = 16
"""One vertex in so many, but at most SCAN_VERTICES, show the error of suns as points, and that of bounced light. In a
room that the sun enters through a window, 384 vertices gave .006 for .028."""

RAYS = 4
"""To each patch of light that shines as a point, all over it, in two halves whose product has no noise."""

QUARTERS = TURNS // 2
"""Rotations of the light, a quarter turn apart."""

FEW = 16
"""Suns that every vertex of the sample looks at in each rotation; the more there are, the fewer of them look."""


class EffectErrors:
    """The contributions of effects to the light on a sample of a scene: the errors of leaving them out.

    sample: Sample. albedo: (V, 3) or None for white. total: (TURNS,) norms of all light, over which errors are.
    """

    def __init__(
        self, sample: Sample, environment: Environment, albedo: Radiance | None = None, bouncing: bool = False
    ) -> None:
        self.sample, self._albedo = sample, albedo
        self._tint: Floats | float = 1.0 if albedo is None else albedo[sample.rows][:, None, :]
        self._directions = len(sample.directions)
        self._basis = basis(self._directions)
        self._project = self._basis.T * (4.0 * np.pi / self._directions)
        self._light = turned(cells_of(environment.radiance), self._directions)
        self._full = self._through(sample.seen, self._light)
        self.seen_transfer = sample.seen.astype(np.float64) @ self._basis
        self._closer: Floats | None = None
        self._known: dict[Any, Any] = {}  # what is derived from all light, and from each image
        self.bounced: Bounced | None = None
        if bouncing:
            assert albedo is not None  # white surfaces are given as such
            coefficients = np.tensordot(self._project, self._light, axes=(1, 0))
            self.bounced = Bounced(sample, albedo, coefficients)
        open_norm = self._norm(self._through(sample.open, self._light))
        self.total = np.maximum(self._all_light(), np.maximum(DARK * open_norm, 1e-30))

    @cached_property
    def shadows(self) -> float:
        """Error of leaving out the shadows.

        By the sample, and by the scan: what that finds hidden counts as much as the sample's hidden light does.
        """
        missing = self._norm(self._through(self.sample.open, self._light) - self._full)
        return max(float((missing / self.total).max()), self.sample.hidden * self._ambience)

    def truncation(self, bands: int, image: Radiance | None = None) -> float:
        """Error of keeping only so many bands: of all the light, or of an `image` of the rest beside suns."""
        return self._rest(image)[2][bands - 1]

    def open_truncation(self, bands: int, image: Radiance | None = None) -> float:
        """Like `truncation`, on a scene without shadows."""
        key = "open", id(image)
        if key not in self._known:
            light, coefficients = self._rest(image)[:2]
            self._known[key] = self._losses(self._through(self.sample.open, light), self._open_transfer, coefficients)
        return self._known[key][bands - 1]

    def ray_noise(self, deviation: float, bands: int, image: Radiance | None = None) -> float:
        """Error of radiance when every coefficient of a half hidden vertex is off by `deviation`."""
        return float(deviation * self._rest(image)[3][bands - 1])

    @cached_property
    def bounces(self) -> NDArray[np.float64]:
        """(FOLLOWED,) error of stopping after 0, 1, .. bounces; zeros where none were followed."""
        if self.bounced is None:
            return np.zeros(FOLLOWED)
        tails = self.bounced.halves[:, ::-1].cumsum(axis=1)[:, ::-1]
        norms = np.array([self._halves_norm(tails[:, depth]) for depth in range(FOLLOWED)])
        return (norms / self.total).max(axis=1)

    def changed(self, seen: Floats) -> float:
        """Error of the visibility `seen`, (S, D), against that of the sample."""
        return float((self._norm(self._through(seen - self.sample.seen, self._light)) / self.total).max())

    @cached_property
    def leafy(self) -> float:
        """The light of leaves and grass over all, where the sample has them as volumes."""
        light = self._full * (1.0 - self.sample.solid)[:, None, None]
        return float((self._norm(light) / self.total).max())

    def check(self, transfer: Floats, image: Radiance | None = None) -> float:
        """Error of a transfer (S, K) of the sample's rows, in its own bands."""
        known = self.seen_transfer if self._closer is None else self._closer
        off = transfer.astype(np.float64) - known[:, : transfer.shape[1]]
        radiance = np.tensordot(off, self.coefficients(image)[: transfer.shape[1]], axes=(1, 0))
        return float((self._norm(radiance) / self.total).max())

    def sun_width(self, suns: Suns, variances: Floats) -> float:
        """Error of suns of the unrotated light, as points, where their patches have these variances."""
        wide = self.sample.wider(self._wide)
        tint = 1.0 if self._albedo is None else self._albedo[wide.rows]
        return width_error(wide, tint, suns, variances, self.total)

    def wide(self, light: NDArray[np.float32]) -> Sample:
        """More vertices than the sample, where light (V, 3) is: noise of bounced light is on few of them."""
        every = self.sample.wider(len(self.sample.occluder.origins))
        return every.lit(self._wide, np.square(light[every.rows], dtype=np.float64).sum(axis=1))

    @property
    def _wide(self) -> int:
        return min(SCAN_VERTICES, max(len(self.sample.rows), len(self.sample.occluder.origins) // WIDE_PART))

    def look_closer(self) -> bool:
        """Have `check` know the sample by CLOSER times as many directions; False where it does already."""
        if self._closer is not None:
            return False
        finer = self.sample.finer(CLOSER)
        self._closer = finer.seen.astype(np.float64) @ basis(len(finer.directions))
        return True

    def coefficients(self, image: Radiance | None = None) -> NDArray[np.float64]:
        """Coefficients of the light, or of its rest, in all rotations and bands: (K, TURNS, 3)."""
        return self._rest(image)[1]

    @cached_property
    def _open_transfer(self) -> NDArray[np.float64]:
        return self.sample.open.astype(np.float64) @ self._basis

    @cached_property
    def _ambience(self) -> float:
        """Hidden light of the sample over the hidden share of an even sky, at least 1; 1 where nothing is hidden."""
        hidden = self.sample.open - self.sample.seen
        even = math.sqrt(float(self.sample.mean_square(hidden.sum(axis=1, keepdims=True))))
        if not even > 0.0:
            return 1.0
        return max(1.0, float((self._norm(self._through(hidden, self._light)) / self.total).max()) / even)

    def _rest(
        self, image: Radiance | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], list[float], NDArray[np.float64]]:
        """Radiance, coefficients, truncations, sensitivity: of all light, or of an image."""
        key = id(image)
        if key not in self._known:
            light = self._light if image is None else turned(cells_of(image), self._directions)
            coefficients = np.tensordot(self._project, light, axes=(1, 0))
            errors = self._losses(self._through(self.sample.seen, light), self.seen_transfer, coefficients)
            self._known[key] = light, coefficients, errors, self._sensitivity(coefficients)
        return self._known[key]

    def _sensitivity(self, coefficients: Floats) -> NDArray[np.float64]:
        """(B,) error of radiance in 1, 2, .. bands per deviation of the coefficients of a half hidden vertex."""
        f = np.clip(self.seen_transfer[:, 0] * np.sqrt(4.0 * np.pi), 0.0, 1.0)
        tint = 1.0 if self._albedo is None else np.square(self._albedo[self.sample.rows]).mean(axis=1)
        spread = float(self.sample.weights @ (f * (1.0 - f) * tint * np.square(self.sample.solid)))
        square = np.cumsum(np.square(coefficients).sum(axis=2), axis=0)[np.arange(1, MAX_BANDS + 1) ** 2 - 1]
        return np.sqrt(spread * square / self.total**2).max(axis=1)

    def _losses(self, full: Floats, transfer: Floats, coefficients: Floats) -> list[float]:
        """[error of keeping 1, 2, .. bands] of light whose exit radiance in full is (S, TURNS, 3)."""
        off, errors = full, []
        for bands in range(1, MAX_BANDS + 1):
            band = slice((bands - 1) ** 2, bands**2)
            off = off - np.tensordot(transfer[:, band], coefficients[band], axes=(1, 0))
            errors.append(float((self._norm(off) / self.total).max()))
        return errors

    def _through(self, cosines: Floats, light: Floats) -> NDArray[np.float32]:
        """Exit radiance (S, TURNS, 3) of white vertices."""
        return (cosines @ light.reshape(self._directions, -1).astype(np.float32)).reshape(-1, TURNS, 3)

    def _norm(self, radiance: Floats) -> NDArray[np.float64]:
        """(TURNS,) norms of exit radiance (S, TURNS, 3) of white vertices, in the scene's colours."""
        return np.sqrt(self.sample.mean_square(radiance * self._tint))

    def _halves_norm(self, halves: Floats) -> NDArray[np.float64]:
        """(TURNS,) norms of the light that two halves (2, S, TURNS, 3) estimate, without bias from their noise."""
        tint = self._tint
        product = (halves[0] * tint * halves[1] * tint).sum(axis=2)
        return np.sqrt(np.maximum(np.tensordot(self.sample.weights, product, axes=(0, 0)), 0.0))

    def _all_light(self) -> NDArray[np.float64]:
        """(TURNS,) norms of direct and bounced light."""
        if self.bounced is None:
            return self._norm(self._full)
        halves = [self._full + half.sum(axis=0) for half in self.bounced.halves]
        return self._halves_norm(np.stack(halves))


class Bounced:
    """Light that reaches the vertices of a sample from other surfaces, for TURNS rotations.

    halves: (2, FOLLOWED, S, TURNS, 3), exit radiance of white vertices after 1.. bounces, by half of the paths.
    """

    def __init__(
        self,
        sample: Sample,
        albedo: Radiance,  # (V, 3) linear
        coefficients: Floats,  # (K, TURNS, 3) of the light, at least FEW_BANDS bands
    ) -> None:
        count, turns = len(sample.rows), coefficients.shape[1]
        coefficients = coefficients[: FEW_BANDS**2].reshape(FEW_BANDS**2, -1)
        random = np.random.default_rng(0)
        self.halves = np.zeros((2, FOLLOWED, count, turns, 3))
        occluder = sample.occluder
        start = np.repeat(np.arange(count), PATHS)
        half = np.tile(np.arange(PATHS) % 2, count)
        position, normal = occluder.origins[sample.rows[start]], occluder.normals[sample.rows[start]]
        weight = np.ones((len(start), 3)) / (PATHS / 2)
        for depth in range(FOLLOWED + 1):
            toward = _cosine(normal, random)
            hits = occluder.first_hits(np.concatenate([position, toward], axis=1, dtype=np.float32))
            _, face, uv, _ = hits
            if depth:
                free = face < 0
                light = np.maximum(harmonics.evaluate(toward[free], FEW_BANDS) @ coefficients, 0.0).reshape(
                    -1, turns, 3
                )
                at = half[free], np.full(free.sum(), depth - 1), start[free]
                np.add.at(self.halves, at, light * weight[free][:, None])
            met = np.flatnonzero(met_in_front(occluder, hits, toward))
            corners = occluder.faces[face[met]].astype(np.int64)
            shares = np.stack([1.0 - uv[met].sum(axis=1), *uv[met].T], axis=1)
            outward = np.einsum("ik,ikc->ic", shares, occluder.normals[corners])
            if not len(met):
                break
            start, half = start[met], half[met]
            position = np.einsum("ik,ikc->ic", shares, occluder.origins[corners]).astype(np.float32)
            normal = outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
            weight = weight[met] * np.einsum("ik,ikc->ic", shares, albedo[corners])


def _cosine(normals: Directions, random: np.random.Generator) -> NDArray[np.float32]:
    """Cosine-distributed directions about unit normals: a point of the sphere added to each."""
    toward = random.normal(size=normals.shape)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    toward = normals + 0.9999 * toward
    return (toward / np.linalg.norm(toward, axis=1, keepdims=True)).astype(np.float32)


def width_error(
    sample: Sample, tint: Floats | float, suns: Suns, variances: Floats, total: NDArray[np.float64]
) -> float:
    """Relative L2 error of exit radiance, in the worst of four rotations of the light, of suns that shine as points.

    sample: Sample. tint: (S, 3) albedo of its rows, or 1. suns: Suns of the unrotated light. variances: of their
    patches, as `sun_split.Rest` has them; patches are treated as discs. total: (TURNS,) norms of all light.
    The split of suns estimates it for walls that may stand anywhere; in the shade of needles it is up to eight times
    larger.
    """
    if not len(suns):
        return 0.0
    step = min(QUARTERS, 1 + len(suns) // FEW, len(sample.rows))
    tint = np.broadcast_to(np.asarray(tint, np.float64), (len(sample.rows), 3))
    worst = 0.0
    for quarter in range(QUARTERS):
        rows = np.arange(quarter % step, len(sample.rows), step)
        turned = suns.rotated(360.0 * quarter / QUARTERS)
        halves = _off(sample, rows, turned, variances) * tint[rows]
        share = sample.weights[rows] * np.square(sample.solid[rows])
        among = total[quarter * TURNS // QUARTERS] ** 2 * sample.weights[rows].sum()
        worst = max(worst, float(share @ (halves[0] * halves[1]).sum(axis=1) / among))
    return math.sqrt(worst)


def _off(sample: Sample, rows: Indices, suns: Suns, variances: Floats) -> NDArray[np.float64]:
    """By how much two halves of the rays say that exit radiance of white rows is off: (2, R, 3)."""
    cosine = sample.normals[rows] @ suns.directions.T
    row, sun = np.nonzero(cosine > 0.0)
    off = np.zeros((2, len(rows), 3))
    toward = suns.directions[sun]
    sent = (cosine[row, sun] / np.pi)[:, None] * suns.weights[sun]
    origins = sample.occluder.origins[sample.rows[rows[row]]]
    point = _free(sample, origins, toward)
    side = np.cross(toward, np.where(np.abs(toward[:, 1:2]) < 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]]))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(toward, side)
    start = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, len(row))
    for ray in range(RAYS):
        radius = np.sqrt(2.0 * variances[sun] * (ray + 0.5) / RAYS)[:, None]
        angle = (start + ray * np.pi * (3.0 - math.sqrt(5.0)))[:, None]
        aim = toward + radius * (np.cos(angle) * side + np.sin(angle) * other)
        differs = _free(sample, origins, aim / np.linalg.norm(aim, axis=1, keepdims=True)) - point
        for color in range(3):
            off[ray % 2, :, color] += np.bincount(row, differs * sent[:, color], len(rows)) * (2.0 / RAYS)
    return off


def _free(sample: Sample, origins: Points, toward: Directions) -> NDArray[np.float64]:
    """(N,) 1.0 where a ray meets nothing."""
    rays = np.concatenate([origins, toward.astype(np.float32)], axis=1)
    return 1.0 - sample.occluder.occluded(rays).astype(np.float64)
