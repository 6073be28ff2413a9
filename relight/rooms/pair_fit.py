"""Emitters of a room that make albedos agree: robust least squares over pairs of places, IRLS Gauss-Newton.

log C = log a + log S. Neighbours mostly share a material, so under the right light log C - log S mostly agrees
between them, and where it does not, it differs widely. Geman and McClure's function counts a wide difference as an
edge of the albedo, whatever its height.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats

SCALES = (1.0, 0.5, 0.3)
"""Differences of log albedo beyond which two places are of two materials, from coarse to fine."""

STEPS = 8
"""Gauss-Newton steps at each scale, at most."""

STRENGTH = 2e-4
"""Weight of the prior against a mean over pairs: it decides only where the scene does not."""

_SMALL_STEP = 1e-4  # of log radiance: no colour changes visibly
_DAMPING = (1e-6, 1e3)  # of Levenberg and Marquardt, least and most, as parts of the diagonal


Light: TypeAlias = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
"""theta (M, 3) -> irradiance (N, 3) of places, and the derivative (N, 3, M) of its logarithm."""


class Fit(NamedTuple):
    """theta: (M, 3). cost: float, at the finest scale. hessian: (3 M, 3 M) of the data alone, colours outermost."""

    theta: NDArray[np.float64]
    cost: float
    hessian: NDArray[np.float64]


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
