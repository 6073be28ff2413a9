"""The capture light that makes albedos agree: robust least squares over pairs of places, IRLS Gauss-Newton.

log C = log a + log S. Neighbours mostly share a material, so under the right light log C - log S mostly agrees
between them, and where it does not, it differs widely. Geman and McClure's function counts a wide difference as an
edge of the albedo, whatever its height.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Radiance

from ..sh import harmonics

SCALES = (1.0, 0.5, 0.3)
"""Differences of log albedo beyond which two places are of two materials, from coarse to fine."""

STEPS = 8
"""Gauss-Newton steps at each scale, at most."""

STRENGTH = 2e-4
"""Weight of the prior against a mean over pairs: it decides only where the scene does not."""

BRIGHTNESS, COLOR = 2.0, 0.25
"""Spread of the light's log brightness and log colour in the prior. Scenes in lights of strong colour like 0.4 better
(error with one gain .17 against .20 at 0.1), but the whites of a real capture turned to cyan with it."""

CONTRAST_COLOR = 3.0
"""Stiffness of the prior on changes of the light's colour with direction, over that on changes of its brightness."""

UNIT = 1.0 / math.sqrt(4.0 * math.pi)
"""Log radiance of the first coefficient."""

_SMALL_STEP = 1e-4  # of log radiance: no colour changes visibly
_DAMPING = (1e-6, 1e3)  # of Levenberg and Marquardt, least and most, as parts of the diagonal


Light: TypeAlias = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
"""theta (M, 3) -> irradiance (N, 3) of places, and the derivative (N, 3, M) of its logarithm."""


class Fit(NamedTuple):
    """theta: (M, 3). cost: float, at the finest scale. hessian: (3 M, 3 M) of the data alone, colours outermost."""

    theta: NDArray[np.float64]
    cost: float
    hessian: NDArray[np.float64]


class SmoothLight:
    """S = sum over k of sky_vk exp(Y_k theta) + bounce: radiance as the exponential of spherical harmonics."""

    def __init__(self, sky: Floats, basis: Floats, bounce: Floats) -> None:
        """sky: (N, K). basis: (K, M). bounce: (N, 3)."""
        self._sky, self._basis, self._bounce = sky, basis.astype(np.float32), bounce

    def __call__(self, theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Irradiance (N, 3) and the derivative (N, 3, M) of its logarithm."""
        received = np.zeros(self._bounce.shape)
        slope = np.zeros((*self._bounce.shape, len(theta)))
        for color in range(3):
            radiance = np.exp(np.clip(self._basis @ theta[:, color], -30.0, 30.0)).astype(np.float32)
            direct = self._sky @ np.column_stack([radiance, radiance[:, None] * self._basis])
            received[:, color] = np.maximum(direct[:, 0] + self._bounce[:, color], 1e-12)
            slope[:, color] = direct[:, 1:] / received[:, color, None]
        return received, slope


class KnownLight:
    """S = exp(unit theta_0) D + bounce: a light known except for its exposure, in each colour."""

    def __init__(self, direct: Radiance, bounce: Radiance, unit: float) -> None:
        """direct, bounce: (N, 3). unit: log radiance per unit of theta."""
        self._unit = unit
        self._direct, self._bounce = direct.astype(np.float64), bounce.astype(np.float64)

    def __call__(self, theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Irradiance (N, 3) and the derivative (N, 3, 1) of its logarithm."""
        direct = np.exp(np.clip(self._unit * theta[0], -30.0, 30.0)) * self._direct
        received = np.maximum(direct + self._bounce, 1e-12)
        return received, self._unit * (direct / received)[:, :, None]


def solve(
    light: Light,  # theta (M, 3) -> irradiance (N, 3), derivative of its logarithm (N, 3, M)
    log_captured: NDArray[np.float64],  # (N, 3)
    pairs: NDArray[np.int64],  # (P, 2) of places
    weights: NDArray[np.float64],  # (P,)
    start: NDArray[np.float64],  # theta (M, 3) that the prior pulls towards
    prior: NDArray[np.float64],  # (3 M, 3 M) of (theta - start)^T prior (theta - start), colours outermost
    begin: NDArray[np.float64] | None = None,  # (M, 3) to begin with at the finer scales; without, the start, at all
) -> Fit:
    """The Fit that minimises sum w rho(|difference of log albedo| / scale) + STRENGTH * prior."""
    theta = (start if begin is None else begin).copy()
    pull = STRENGTH * prior

    def log_albedo_of(theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        received, slope = light(theta)
        return log_captured - np.log(received), slope

    def cost_of(log_albedo: NDArray[np.float64], theta: NDArray[np.float64], scale: float) -> float:
        difference = log_albedo[pairs[:, 0]] - log_albedo[pairs[:, 1]]
        square = (difference * difference).sum(axis=1) / scale**2
        off = (theta - start).T.ravel()
        return float(weights @ (square / (1.0 + square)) + off @ pull @ off)

    log_albedo, slope = log_albedo_of(theta)
    for scale in SCALES if begin is None else SCALES[1:]:
        cost, damping = cost_of(log_albedo, theta, scale), _DAMPING[0]
        for _ in range(STEPS):
            hessian, gradient = _normal(*differences(log_albedo, pairs, weights, scale), slope, pairs)
            hessian, gradient = hessian + pull, gradient + pull @ (theta - start).T.ravel()
            while damping <= _DAMPING[1]:
                damped = hessian + damping * np.diag(np.diag(hessian))
                step = np.linalg.solve(damped, -gradient).reshape(3, -1).T
                tried = log_albedo_of(theta + step)
                new_cost = cost_of(tried[0], theta + step, scale)
                if new_cost < cost:
                    break
                damping = max(10.0 * damping, 1e-3)
            else:
                break
            (log_albedo, slope), theta, gain, cost = tried, theta + step, cost - new_cost, new_cost
            damping = max(damping / 10.0, _DAMPING[0])
            if np.abs(step).max() < _SMALL_STEP or gain < 1e-5 * cost:
                break
    hessian, _ = _normal(*differences(log_albedo, pairs, weights, SCALES[-1]), slope, pairs)
    return Fit(theta, cost, hessian)


def prior_of(bands: int, of_color: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """(3 K, 3 K) of the quadratic prior on logarithmic coefficients, colours outermost.

    Brightness and colour of the mean are bounded; a coefficient of degree l is pulled to 0 with weight l. of_color:
    (3, 3) of the prior on the log colour of the mean; without it all hues are alike.
    """
    width = bands**2
    degree, _ = harmonics.degrees_and_orders(bands)
    gray = np.full((3, 3), 1.0 / 3.0)
    color = np.eye(3) - gray
    mean = (gray / BRIGHTNESS**2 + (color / COLOR**2 if of_color is None else of_color)) * UNIT**2
    matrix = np.kron(gray + CONTRAST_COLOR * color, np.diag(degree))
    at = np.arange(3) * width
    matrix[np.ix_(at, at)] = mean
    return matrix


def evidence(
    found: Fit,
    prior: NDArray[np.float64],  # (3 M, 3 M) as in `solve`
    directions: NDArray[np.float64],  # (3 M, D) orthonormal columns: the directions of interest
) -> float:
    """How much the data say, in [0, 1]: 1 less what they leave of the prior's variance along the least known of
    these directions. 0: all is prior. Other parameters are free, and uncertain with them."""
    spread = np.linalg.inv(found.hessian + STRENGTH * prior)
    before = directions.T @ np.linalg.inv(STRENGTH * prior) @ directions
    after = directions.T @ spread @ directions
    left = np.linalg.eigvals(np.linalg.solve(before, after)).real.max()
    return float(np.clip(1.0 - left, 0.0, 1.0))


def differences(
    log_albedo: NDArray[np.float64], pairs: NDArray[np.int64], weights: NDArray[np.float64], scale: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Differences (P, 3) of the pairs and their weights (P,) under the robust function, over the squared scale."""
    difference = log_albedo[pairs[:, 0]] - log_albedo[pairs[:, 1]]
    square = (difference * difference).sum(axis=1) / scale**2
    return difference, weights / (1.0 + square) ** 2 / scale**2


def laplacian(robust: NDArray[np.float64], pairs: NDArray[np.int64], count: int, values: Floats) -> Floats:
    """(N, D): the weighted graph's Laplacian times values (N, D). It stands for the pairs, of which there are more."""
    across = scipy.sparse.coo_array((robust, pairs.T), (count, count)).tocsr()
    across = (across + across.T).astype(values.dtype)
    own = np.asarray(across.sum(axis=1)).ravel()
    return own[:, None] * values - across @ values


def pulled(
    difference: NDArray[np.float64], robust: NDArray[np.float64], pairs: NDArray[np.int64], count: int
) -> NDArray[np.float64]:
    """(N,): how the robust sum changes with the logarithm of each place's irradiance, in one colour."""
    force = robust * difference
    gained, lost = (np.asarray(np.bincount(pairs[:, end], force, count), np.float64) for end in (1, 0))
    return gained - lost


def _normal(
    difference: NDArray[np.float64], robust: NDArray[np.float64], slope: NDArray[np.float64], pairs: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss-Newton's matrix and gradient of the robust sum, colours outermost.

    einsum, since the threads of BLAS gain nothing here, and on a busy machine wait for each other a hundred times
    as long.
    """
    count, _, width = slope.shape
    hessian, gradient = np.zeros((3 * width, 3 * width)), np.zeros(3 * width)
    for color in range(3):
        block = slice(color * width, (color + 1) * width)
        each = np.ascontiguousarray(slope[:, color])
        hessian[block, block] = np.einsum("ni,nj->ij", each, laplacian(robust, pairs, count, each))
        gradient[block] = np.einsum("n,ni->i", pulled(difference[:, color], robust, pairs, count), each)
    return hessian, gradient
