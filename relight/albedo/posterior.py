"""The captured light given all cues: natural light as the prior, with and without a sun, and the mean of what remains.

The log radiance of the light is a sum of harmonics; a sun is one more function, a narrow lobe. Gauss-Newton with
Levenberg and Marquardt's damping finds the most probable light of each kind; Laplace's approximation weighs them.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Mask, Vector
from splat2mesh.scene.color import luminance

from ..sh import harmonics
from .evidence import LUMA, Cue, Evidence
from .fitted import FITTED
from .natural import AXES, NaturalLight, log_radiance

STEPS, LEAST_GAIN = 14, 0.1
"""Gauss-Newton steps at most, and gain in nats below which they end."""

LARGEST_STEP = 1.0
"""Of log radiance: beyond it the linearisation is worthless."""

DAMPING = 1e-3, 1e4
"""Least and most damping, as parts of the diagonal."""

SUN_WIDTH_DEG = 5.0
"""Spread of a sun's lobe: directions of the places are 6 degrees apart."""

SUN_SHARES = (0.2, 0.4, 0.6)
"""Of the mean direct light, that are tried for a sun."""

APART_DEG, SUNS = 15.0, 2
"""Least angle between suns that are fitted, and how many are."""

HEIGHT, HEIGHT_COLOR = 3.0, 0.5
"""Spread of the log radiance that a sun adds at its middle, or a region of the sky, and of its colour."""

MOSTLY = 0.5
"""Part of a direction that was seen without a sun, where none stands."""

CEILING_DB = 28.0
"""PSNR of a relit splat whose light is known, to whose error that of the light adds."""

AROUND_DEG = 35.0
"""Suns are sought so near to the brightest direction of the light without one."""


class Region(NamedTuple):
    """A part of the sky that is brighter, or darker, than harmonics have it: that was clipped, or seen unclipped.

    directions: (K, 3). share: (K,) of each in it. log_height: (3,) log radiance that it adds.
    """

    directions: Directions
    share: NDArray[np.float64]
    log_height: NDArray[np.float64]

    def at(self, directions: Directions) -> NDArray[np.float64]:
        """(D, 3) log radiance that it adds at directions (D, 3)."""
        nearest = scipy.spatial.cKDTree(self.directions).query(directions)[1]
        return self.share[nearest][:, None] * self.log_height


class SunLobe(NamedTuple):
    """A sun. direction: (3,) unit, scene frame. log_height: (3,) log radiance that it adds at its middle."""

    direction: NDArray[np.float64]
    log_height: NDArray[np.float64]

    def at(self, directions: Directions) -> NDArray[np.float64]:
        """(D, 3) log radiance that it adds at directions (D, 3)."""
        return _lobe(directions, self.direction)[:, None] * self.log_height


class Refinement(NamedTuple):
    """What refines a light. log_factor: (K,) that it adds to the log radiance around directions (K, 3)."""

    directions: Directions
    log_factor: NDArray[np.float64]

    def at(self, directions: Directions) -> NDArray[np.float64]:
        """(D, 1) log factor at directions (D, 3), blended over the four nearest."""
        away, near = scipy.spatial.cKDTree(self.directions).query(directions, 4)
        weights = np.exp(-len(self.directions) * (away / 2.0) ** 2)
        return np.asarray((self.log_factor[near] * weights).sum(axis=1, keepdims=True) / weights.sum(axis=1)[:, None])


class PosteriorLight(NamedTuple):
    """A light that may have lit the capture.

    coefficients: (K, 3) harmonics of its log radiance, beside the regions of the sky, the sun, a SunLobe or None, and
    its Refinement, or None. nats: of its cues and prior. share: of the posterior. decided: in [0, 1], how far the
    capture, not the prior, says which way it comes from. variances: (N,) of the log luminance that places receive.
    """

    coefficients: NDArray[np.float64]
    regions: tuple[Region, ...]
    sun: SunLobe | None
    nats: dict[str, float]
    share: float
    decided: float
    variances: NDArray[np.float64]
    refinement: Refinement | None = None

    def radiance(self, directions: Directions) -> NDArray[np.float64]:
        """(D, 3) at directions (D, 3)."""
        logs = log_radiance(self.coefficients, directions)
        for part in (*self.regions, *(part for part in (self.sun, self.refinement) if part is not None)):
            logs = logs + part.at(directions)
        return np.asarray(np.exp(np.clip(logs, -30.0, 30.0)))


class _Optimum(NamedTuple):
    parameters: NDArray[np.float64]  # (M, 3)
    cues: dict[str, Cue]
    nats: float
    curvature: NDArray[np.float64]  # (3 M, 3 M)
    precision: NDArray[np.float64]  # (3 M, 3 M) of the prior
    evidence: float  # nats, with the volume of the posterior over that of the prior


def lights_of(
    evidence: Evidence,
    prior: NaturalLight,
    sun: Vector | None = None,  # (3,) unit direction where it is known
    sunless: bool = False,  # whether the sky is known to hide it
) -> list[PosteriorLight]:
    """The lights that may have lit a capture, the likeliest first; shares sum to 1."""
    directions, shares = evidence.places.directions, evidence.sky_shares()
    basis = np.column_stack([harmonics.evaluate(directions, prior.bands), shares])
    start = np.vstack([prior.mean, np.zeros((shares.shape[1], 3))])
    start[0] += _level(evidence, basis @ start)
    precision = _with_heights(prior.precision, shares.shape[1])
    smooth = _solved(evidence, basis, start, precision, start)
    found: list[tuple[SunLobe | None, _Optimum]] = [(None, smooth)]
    if not sunless:
        wider = _with_heights(precision, 1)
        for direction, share, height in _suns(evidence, np.exp(basis @ smooth.parameters), sun):
            lobes = np.column_stack([basis, _lobe(directions, direction)])
            begin = np.vstack([smooth.parameters, np.full((1, 3), height)])
            begin[0] += np.log(1.0 - share) * np.sqrt(4.0 * np.pi)
            best = _solved(evidence, lobes, np.vstack([start, np.zeros((1, 3))]), wider, begin)
            found.append((SunLobe(np.asarray(direction, np.float64), best.parameters[-1]), best))
    if sun is not None and len(found) > 1:
        found = found[1:]
    odds = -np.array([each.evidence for _, each in found])
    shares = np.exp(odds - odds.max())
    lights = [
        _described(evidence, basis, lobe, each, float(share))
        for (lobe, each), share in zip(found, shares / shares.sum(), strict=True)
    ]
    return sorted(lights, key=lambda light: -light.share)


def mean_radiance(lights: list[PosteriorLight], directions: Directions) -> NDArray[np.float64]:
    """(D, 3) radiance of the posterior's mean at directions (D, 3)."""
    return np.asarray(sum(light.share * light.radiance(directions) for light in lights))


def spread(evidence: Evidence, lights: list[PosteriorLight]) -> float:
    """Root mean square, over places, of the uncertainty of their log light, its mean over places aside."""
    directions = evidence.places.directions
    logs = [np.log(luminance(evidence.received(np.log(light.radiance(directions))).total)) for light in lights]
    shares = np.array([light.share for light in lights])
    about = np.array([each - each.mean() for each in logs])
    across = shares @ (about - shares @ about) ** 2
    return float(np.sqrt(np.mean(across + shares @ np.array([light.variances for light in lights]))))


def doubt_db(spread: float) -> float:
    """What a wrong light costs a result of CEILING_DB at most in four of five captures of this spread, in dB."""
    return 10.0 * math.log10(1.0 + (FITTED.doubt * spread) ** 2 / 10.0 ** (-CEILING_DB / 10.0))


def _level(evidence: Evidence, log_light: NDArray[np.float64]) -> float:
    """To add to the mean harmonic, so that the median direct light makes the median albedo usual."""
    places = evidence.places
    direct = luminance(places.sky @ np.exp(log_light).astype(np.float32))
    wanted = np.median(luminance(places.captured)) / evidence.usual_albedo
    return float(np.log(wanted / max(float(np.median(direct)), 1e-9)) * np.sqrt(4.0 * np.pi))


def _solved(
    evidence: Evidence,
    basis: Floats,  # (K, M)
    center: NDArray[np.float64],  # (M, 3) of the prior
    precision: NDArray[np.float64],  # (3 M, 3 M)
    begin: NDArray[np.float64],  # (M, 3)
) -> _Optimum:
    """The most probable parameters."""

    def prior(parameters: NDArray[np.float64]) -> Cue:
        off = (parameters - center).T.ravel()
        return Cue(0.5 * float(off @ precision @ off), precision @ off, precision)

    def all_cues(parameters: NDArray[np.float64]) -> dict[str, Cue]:
        return {**evidence.cues(basis @ parameters, basis), "prior": prior(parameters)}

    def nats(parameters: NDArray[np.float64]) -> float:
        cues = evidence.cues(basis @ parameters)
        return sum(cue.nats for cue in cues.values()) + prior(parameters).nats

    parameters, damping = begin, DAMPING[0]
    cues = all_cues(parameters)
    for _ in range(STEPS):
        total = sum(cue.nats for cue in cues.values())
        gradient, curvature = _sums(cues)
        while damping < DAMPING[1]:
            step = np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), -gradient).reshape(3, -1).T
            step *= min(1.0, LARGEST_STEP / max(float(np.abs(basis @ step).max()), 1e-9))
            after = nats(parameters + step)
            if after < total:
                break
            damping = max(10.0 * damping, 1e-2)
        else:
            break
        parameters, damping = parameters + step, max(damping / 10.0, DAMPING[0])
        cues = all_cues(parameters)
        if total - after < LEAST_GAIN:
            break
    _, curvature = _sums(cues)
    total = sum(cue.nats for cue in cues.values())
    volume = 0.5 * (np.linalg.slogdet(curvature)[1] - np.linalg.slogdet(precision)[1])
    return _Optimum(parameters, cues, total, curvature, precision, total + volume)


def _sums(cues: dict[str, Cue]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gradient (3 M,) and curvature (3 M, 3 M) of all cues."""
    width = len(np.atleast_1d(cues["prior"].gradient))
    gradient, curvature = np.zeros(width), np.zeros((width, width))
    for cue in cues.values():
        gradient += cue.gradient
        curvature += cue.hessian
    return gradient, curvature


def _suns(evidence: Evidence, radiance: NDArray[np.float64], known: Vector | None) -> list[tuple[Vector, float, float]]:
    """The likeliest suns beside a light (K, 3): direction, share of the mean direct light, log height."""
    places, light = evidence.places, np.asarray(luminance(radiance), np.float64)
    directions = places.directions
    if known is not None:
        near = np.array([int(np.argmax(directions @ known))])
    else:
        near = np.flatnonzero(_open_to_suns(evidence, directions, light))
    if not len(near):
        return []
    lobes = np.stack([_lobe(directions, direction) for direction in directions[near]], axis=1)
    size = lobes.sum(axis=0)
    suns = places.sky @ (lobes / size).astype(np.float32)
    rest, bounced = places.sky @ light.astype(np.float32), luminance(places.bounced)
    tried = []
    for share in SUN_SHARES:
        strength = share * float(rest.mean()) / np.maximum(suns.mean(axis=0), 1e-9)
        nats = evidence.shading((1.0 - share) * rest[:, None] + suns * strength + bounced[:, None])
        for row in np.argsort(nats)[:SUNS]:
            over = strength[row] / size[row] / max((1.0 - share) * light[near[row]], 1e-9)
            tried.append((float(nats[row]), int(near[row]), share, float(np.log1p(over))))
    chosen: list[tuple[int, float, float]] = []
    for _, row, share, height in sorted(tried):
        if all(directions[row] @ directions[other] < np.cos(np.radians(APART_DEG)) for other, _, _ in chosen):
            chosen.append((row, share, height))
    return [(directions[row] if known is None else known, share, height) for row, share, height in chosen[:SUNS]]


def _open_to_suns(evidence: Evidence, directions: Directions, light: NDArray[np.float64]) -> Mask:
    """(K,) bool: above the horizon, around the brightest of these, and where no sky was seen without a sun."""
    free = directions[:, 1] > 0.0
    if evidence.sky is not None:
        free &= evidence.sky_shares()[:, 1] < MOSTLY
    if not free.any():
        return free
    brightest = directions[np.argmax(np.where(free, light, 0.0))]
    return np.asarray(free & (directions @ brightest > np.cos(np.radians(AROUND_DEG))))


def _with_heights(precision: NDArray[np.float64], more: int) -> NDArray[np.float64]:
    """A prior's precision (3 M, 3 M) with that of log heights as so many more parameters of each colour."""
    count = len(precision) // 3
    wider = np.zeros((3, count + more, 3, count + more))
    wider[:, :count, :, :count] = precision.reshape(3, count, 3, count)
    for row in range(count, count + more):
        wider[:, row, :, row] = np.outer(LUMA, LUMA) / HEIGHT**2 + AXES[1:].T @ AXES[1:] / HEIGHT_COLOR**2
    return wider.reshape(3 * (count + more), -1)


def _lobe(directions: Directions, middle: Vector) -> NDArray[np.float64]:
    """(D,) a lobe of height 1 about a direction."""
    angle = np.degrees(np.arccos(np.clip(directions @ middle, -1.0, 1.0)))
    return np.asarray(np.exp(-0.5 * (angle / SUN_WIDTH_DEG) ** 2))


def _described(evidence: Evidence, basis: Floats, lobe: SunLobe | None, best: _Optimum, share: float) -> PosteriorLight:
    directions = evidence.places.directions
    if lobe is not None:
        basis = np.column_stack([basis, _lobe(directions, lobe.direction)])
    change = evidence.received(basis @ best.parameters, basis).of_luminance()
    change = change - change.mean(axis=0)
    variances = np.einsum("nm,mn->n", change, np.linalg.solve(best.curvature, change.T))
    shares = evidence.sky_shares()
    smooth = best.parameters[: len(best.parameters) - (lobe is not None)].copy()
    smooth[0] += evidence.lacking(basis @ best.parameters) * np.sqrt(4.0 * np.pi)
    bands = len(smooth) - shares.shape[1]
    regions = tuple(Region(directions, *each) for each in zip(shares.T, smooth[bands:], strict=True))
    nats = {name: cue.nats for name, cue in best.cues.items()}
    return PosteriorLight(smooth[:bands], regions, lobe, nats, share, _decided(best), variances)


def _decided(best: _Optimum) -> float:
    """1 less what the capture leaves of the prior's variance along the least known axis of the light's direction."""
    count = len(best.parameters)
    dipole = np.zeros((3 * count, 3))
    for color in range(3):
        dipole[color * count + np.arange(1, 4), np.arange(3)] = 1.0 / np.sqrt(3.0)
    before, after = (dipole.T @ np.linalg.solve(matrix, dipole) for matrix in (best.precision, best.curvature))
    return float(np.clip(1.0 - np.linalg.eigvals(np.linalg.solve(before, after)).real.max(), 0.0, 1.0))
