"""A sun, or a lamp as narrow as one, beside the smooth capture light: found where it explains most.

Its shadows have edges that a few harmonics cannot hold. Directions around the brightest one of the smooth light are
rated by the gain of a Gauss-Newton step that adds light from there, with the rest free; then the best one is
fitted together with the rest.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Indices
from splat2mesh.scene.color import luminance

from ..light import projections
from ..sh import harmonics
from ..sh.sphere import fibonacci_sphere
from ..transfer.occluder import Occluder
from . import fit
from .samples import Samples

CAP_DEG = 25.0
"""Around the brightest direction of the smooth light: of suns at noon and sunset that was 1 to 7 degrees off."""

CANDIDATES = 8192
"""Over the sphere, of which some 380 are in the cap: 2.2 degrees apart."""

WIDTHS_DEG = (1.5, 3.0, 6.0)
"""Spreads of the lobes tried. Even under a sun 6 degrees often fit best: colours of splats are blurred."""

START = 0.3
"""Irradiance of a sun to begin with, over the mean irradiance."""

SUN_BRIGHTNESS, SUN_COLOR = 4.5, 1.0
"""Spread of the sun's log brightness and log colour in the prior."""

MIN_GAIN = 0.005
"""Relative fall of the cost for which a sun is believed: under a real one 3 to 5%, under soft light down to 0.3%."""


_LEAST_CURVATURE = 1e-9  # of the cost: a sun that no place sees gains nothing, and divides nothing by 0


class Sun(NamedTuple):
    """direction: (3,) unit, scene frame. width_deg: spread of its lobe. received: (N,) irradiance over pi of places
    by a sun of irradiance 1. irradiance: (3,) at right angles, or None before it is fitted."""

    direction: NDArray[np.float64]
    width_deg: float
    received: Floats
    irradiance: Floats | None = None


class SunnyLight:
    """A light and a sun: the parameters of the light, and below them the logarithm of the sun's irradiance."""

    def __init__(self, light: fit.Light, received: Floats) -> None:
        """light: of theta (M, 3), as `fit.solve` takes it. received: (N,) of a Sun."""
        self._light, self._received = light, received[:, None].astype(np.float64)

    def __call__(self, theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Irradiance (N, 3) and the derivative (N, 3, M + 1) of its logarithm."""
        received, slope = self._light(theta[:-1])
        sun = np.exp(np.clip(theta[-1], -30.0, 30.0)) * self._received
        whole = received + sun
        return whole, np.concatenate([slope * (received / whole)[:, :, None], (sun / whole)[:, :, None]], axis=2)


class SunlessLight(NamedTuple):
    """A light without a sun, as `fit.solve` takes it. light: of theta (M, 3). start: (M, 3). prior: (3 M, 3 M), colours
    outermost. found: its Fit, to SH coefficients of its logarithm."""

    light: fit.Light
    start: NDArray[np.float64]
    prior: NDArray[np.float64]
    found: fit.Fit


def with_sun(
    occluder: Occluder,
    places: Samples,
    log_captured: NDArray[np.float64],  # (N, 3) of the places
    alone: SunlessLight,
    least_gain: float | None = None,  # relative fall of the cost for which it is believed, MIN_GAIN by default
    brightness: Callable[[Directions], Floats] | None = None,  # (D, 3) -> (D,) luminance where a sun may stand, else 0
) -> tuple[NDArray[np.float64], Sun | None]:
    """(theta (M, 3), Sun): the light beside the best sun, and that; or the light alone and None."""
    light, start, prior, found = alone
    width, least_gain = len(start), MIN_GAIN if least_gain is None else least_gain
    sphere = fibonacci_sphere(CANDIDATES)
    bright = luminance(_harmonic(sphere, found.theta)) if brightness is None else brightness(sphere)
    sun = _candidate(occluder, places, log_captured, alone, sphere, bright)
    if sun is None:
        return found.theta, None
    received, _ = light(found.theta)
    first = np.full((1, 3), np.log(START * received.mean()))
    wider = np.zeros((3, width + 1, 3, width + 1))
    wider[:, :width, :, :width] = prior.reshape(3, width, 3, width)
    gray = np.full((3, 3), 1.0 / 3.0)
    wider[:, width, :, width] = gray / SUN_BRIGHTNESS**2 + (np.eye(3) - gray) / SUN_COLOR**2
    again = fit.solve(
        SunnyLight(light, sun.received),
        log_captured,
        places.pairs,
        places.weights,
        np.vstack([start, first]),
        wider.reshape(3 * width + 3, -1),
        np.vstack([found.theta, first]),
    )
    if again.cost > (1.0 - least_gain) * found.cost:
        return found.theta, None
    return again.theta[:-1], sun._replace(irradiance=np.exp(np.clip(again.theta[-1], -30.0, 30.0)))


def _harmonic(directions: Directions, theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance (D, 3) whose logarithm has SH coefficients theta (M, 3)."""
    basis = harmonics.evaluate(directions, int(np.sqrt(len(theta))))
    return np.exp(np.clip(basis @ theta, -30.0, 30.0))


def _candidate(
    occluder: Occluder,
    places: Samples,
    log_captured: NDArray[np.float64],
    alone: SunlessLight,
    sphere: Directions,
    bright: Floats,
) -> Sun | None:
    """The Sun, not fitted, whose addition would gain most; None where no place sees any."""
    light, _, prior, found = alone
    near = sphere[(sphere @ sphere[np.argmax(bright)] > np.cos(np.radians(CAP_DEG))) & (bright > 0.0)]
    if len(near) == 0:
        return None
    lit = lit_by(occluder, places.vertices, near)
    received, slope = light(found.theta)
    difference, robust = fit.differences(log_captured - np.log(received), places.pairs, places.weights, fit.SCALES[-1])
    free = np.linalg.inv(found.hessian + fit.STRENGTH * prior)
    angle = np.degrees(np.arccos(np.clip(near @ near.T, -1.0, 1.0)))
    best_gain, best = 0.0, None
    for width_deg in WIDTHS_DEG:
        lobes = np.exp(-0.5 * (angle / width_deg) ** 2).astype(np.float32)
        shading = lit @ (lobes / lobes.sum(axis=1, keepdims=True)).T
        gain = _gains(shading, received, slope, difference, robust, places.pairs, free)
        top = int(np.argmax(gain))
        if gain[top] > best_gain:
            best_gain, best = gain[top], Sun(near[top], width_deg, shading[:, top])
    return best


def lit_by(occluder: Occluder, vertices: Indices, directions: Directions) -> NDArray[np.float32]:
    """(N, S) float32: what white vertices send out under suns of irradiance 1, in the shadow of everything."""
    lit = np.maximum(occluder.normals[vertices] @ directions.T.astype(np.float32), np.float32(0.0))
    for start in range(0, len(vertices), 1024):
        block = lit[start : start + 1024]
        place, sun = np.nonzero(block)
        some = vertices[start : start + 1024]
        rays = np.hstack([occluder.origins[some][place], directions[sun].astype(np.float32)])
        block[place, sun] *= ~occluder.occluded(rays)
    return np.asarray(lit / np.float32(np.pi), np.float32)


def _gains(
    shading: NDArray[np.float32],
    received: NDArray[np.float64],
    slope: NDArray[np.float64],
    difference: NDArray[np.float64],
    robust: NDArray[np.float64],
    pairs: NDArray[np.int64],
    free: Floats,
) -> NDArray[np.float64]:
    """(S,) reduction of the cost, to second order, by the best irradiance of each sun, not negative.

    shading: (N, S). received, slope: of the light alone. free: (3 M, 3 M), inverse of its Gauss-Newton matrix: the
    light makes room for the sun (Schur complement).
    """
    count, width = slope.shape[0], slope.shape[2]
    pulls: list[NDArray[np.float64]] = []
    own: list[NDArray[np.float64]] = []
    across: list[NDArray[np.float64]] = []
    for color in range(3):
        change = np.divide(shading, received[:, color, None].astype(np.float32))
        pulls.append(fit.pulled(difference[:, color], robust, pairs, count) @ change)
        spread = fit.laplacian(robust, pairs, count, change)
        own.append(np.einsum("ns,ns->s", change, spread))
        across.append(np.ascontiguousarray(slope[:, color]).T @ spread)
    blocks = free.reshape(3, width, 3, width)
    matrix = np.zeros((shading.shape[1], 3, 3))
    for i in range(3):
        matrix[:, i, i] = own[i] + _LEAST_CURVATURE
        for j in range(3):
            matrix[:, i, j] -= (across[i] * (blocks[i, :, j] @ across[j])).sum(axis=0)
    gradient = np.stack(pulls, axis=1)
    step = np.maximum(np.linalg.solve(matrix, -gradient[:, :, None])[:, :, 0], 0.0)
    return -(gradient * step).sum(axis=1) - 0.5 * np.einsum("si,sij,sj->s", step, matrix, step)


def image_of(lamp: Sun, height: int, width: int) -> NDArray[np.float64]:
    """(height, width, 3) float64 radiance of a Sun, equirectangular."""
    cosine = projections.texel_directions(height, width) @ lamp.direction
    lobe = np.exp(-0.5 * (np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))) / lamp.width_deg) ** 2)
    area = projections.row_solid_angles(height, width).reshape(-1, 1)
    return (lobe / (lobe * area).sum())[:, :, None] * lamp.irradiance
