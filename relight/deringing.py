"""Light in few bands without ringing: the least window that keeps an unshadowed white surface from going black.

The harmonics of a small bright source swing below zero, so that surfaces which face away from it get negative light.
A factor for each degree, 1 for the mean, damps the swings (Sloan, "Deringing Spherical Harmonics", SIGGRAPH Asia 2017).
Sloan picks one number, the width of a fixed window. Here every degree has a factor of its own: non-negative exit
radiance in a direction is linear in the factors, so the least change of the light is a small quadratic programme, which
is solved exactly. It touches only the degrees that this light's own minima call for.
"""

from functools import lru_cache

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import cKDTree

from splat2mesh.errors import InputError

from . import sh
from .suns import fibonacci_sphere

_DIRECTIONS = 4096  # of the dense check, 3.2 degrees apart: a sixth of the narrowest swing of 10 bands
_REFINEMENTS = 8  # each to a third of the step: 3.2 degrees to 0.0005, where a minimum is flat to 1e-10
_NEAR_ZERO = 0.02  # of the mean: minima of the check below this may pass below zero between its directions
_ROUNDS = 50  # of new constraints; a sun over black takes 2 to 5
_MARGIN = 2e-6  # of the mean, to which minima are raised: refined ones may be off by a quarter of it along a valley


def dering(coefficients):
    """Radiance coefficients (K, C) of the same light, windowed until no unshadowed white surface gets less than 0.

    One window for all colours: windows of their own would tint what a white sun lights. Light that does so already
    comes back as the same array; the mean never changes. A colour of no energy takes no part. Transfer with
    shadows can still go below zero, as it can for light that is positive everywhere. Raises InputError for
    coefficients that are not (K, C) and finite.
    """
    if np.ndim(coefficients) != 2 or not np.isfinite(coefficients).all():
        raise InputError(f"expected finite SH coefficients (K, C), found shape {np.shape(coefficients)}")
    factors = window(coefficients)
    if (factors == 1.0).all():
        return coefficients
    degree, _ = sh.degrees_and_orders(sh.bands_of(coefficients))
    return coefficients * factors[degree][:, None]


def window(coefficients):
    """Factors (B,) float64 by degree of `dering`: in [0, 1], 1 for degree 0 and for all of light that does not ring."""
    bands = sh.bands_of(coefficients)
    degree, _ = sh.degrees_and_orders(bands)
    factors = np.ones(bands)
    # Exit radiance of a white surface over its mean, colour by colour.
    exit_radiance = sh.convolve(np.asarray(coefficients, np.float64))
    exit_radiance = exit_radiance[:, exit_radiance[0] > 0.0]
    exit_radiance = exit_radiance / (exit_radiance[0] * sh.evaluate(np.array([[0.0, 0.0, 1.0]]), 1)[0, 0])
    power = np.zeros(bands)
    np.add.at(power, degree, np.square(exit_radiance).sum(axis=1))
    active = np.flatnonzero((power > 0.0) & (np.arange(bands) > 0))
    if not len(active):
        return factors
    # min |x| with x = sqrt(power) (factors - 1), subject to G x >= h.
    scale = 1.0 / np.sqrt(power[active])
    rows = [np.diag(scale), -np.diag(scale)]
    least = [np.full(len(active), -1.0), np.zeros(len(active))]
    for _ in range(_ROUNDS):
        lowest, by_degree = _minima(exit_radiance, factors)
        below = lowest < 0.0
        if not below.any():
            break
        rows.append(by_degree[below][:, active] * scale)
        least.append(_MARGIN - by_degree[below].sum(axis=1))
        change = _least_distance(np.concatenate(rows), np.concatenate(least))
        factors[active] = np.clip(1.0 + scale * change, 0.0, 1.0)
    return factors


def _minima(exit_radiance, factors):
    """Values (N,) of windowed exit radiance at its local minima about and below zero, and their parts by degree."""
    bands = len(factors)
    degree, _ = sh.degrees_and_orders(bands)
    windowed = exit_radiance * factors[degree][:, None]
    grid, neighbors = _grid()
    values = sh.evaluate(grid, bands) @ windowed
    found, parts = [np.zeros(0)], [np.zeros((0, bands))]
    for color, value in enumerate(values.T):
        lowest = (value < _NEAR_ZERO) & (value <= value[neighbors].min(axis=1))
        toward = _refined(grid[lowest], windowed[:, color])
        terms = sh.evaluate(toward, bands) * exit_radiance[:, color]
        by_degree = np.stack([terms[:, degree == index].sum(axis=1) for index in range(bands)], axis=1)
        found.append(by_degree @ factors)
        parts.append(by_degree)
    return np.concatenate(found), np.concatenate(parts)


@lru_cache(1)
def _grid():
    """Directions (N, 3) of the dense check, and of each the six nearest, (N, 6) indices."""
    grid = fibonacci_sphere(_DIRECTIONS)
    return grid, cKDTree(grid).query(grid, 7)[1][:, 1:]


def _refined(directions, coefficients):
    """Directions (N, 3) moved downhill to local minima: the best of a 5 x 5 patch, which shrinks."""
    bands = sh.bands_of(coefficients)
    step = np.sqrt(4.0 * np.pi / _DIRECTIONS) / 2.0
    offsets = np.stack(np.meshgrid(np.arange(-2, 3), np.arange(-2, 3)), axis=-1).reshape(-1, 2)
    for _ in range(_REFINEMENTS):
        helper = np.where(np.abs(directions[:, :1]) < 0.7, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
        right = np.cross(directions, helper)
        right /= np.linalg.norm(right, axis=1, keepdims=True)
        tangents = np.stack([right, np.cross(directions, right)], axis=1)
        tried = directions[:, None] + step * np.einsum("oa,nak->nok", offsets, tangents)
        tried /= np.linalg.norm(tried, axis=2, keepdims=True)
        values = sh.evaluate(tried.reshape(-1, 3), bands) @ coefficients
        best = values.reshape(len(directions), len(offsets)).argmin(axis=1)
        directions = tried[np.arange(len(directions)), best]
        step /= 3.0
    return directions


def _least_distance(rows, least):
    """The shortest x with rows @ x >= least. Source: Lawson, Hanson, "Solving Least Squares Problems", 23.4 (LDP)."""
    system = np.vstack([rows.T, least])
    target = np.zeros(len(system))
    target[-1] = 1.0
    residual = system @ nnls(system, target)[0] - target
    return -residual[:-1] / residual[-1]
