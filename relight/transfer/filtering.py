"""Neighbours share their rays: the noise of traced transfer is averaged along the surface, real differences stay.

The average is over visibility, not transfer: the line a + b . d of `sampling.gather` and its remainder are taken from
the neighbours, in world space, and the cosine about the vertex's own normal is applied afterwards. A neighbour counts
less the more its shadow differs from the vertex's own, relative to the noise expected from the number of rays and
the visible fraction. Every step is of one ring.
"""

import math

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices

from ..sh import harmonics
from . import FEW_BANDS
from .lobes import add_lobes, squared_lobe
from .neighbors import Neighbors, Rows
from .sampling import legendre_factors

NOISE = 0.078
NOISE_POWER = -1.48
"""Variance of a coefficient = 0.078 R^-1.48 f (1 - f) for R rays, f the visible fraction: mean over six meshes
(scripts/bench rays prints it), within a quarter for each of them, for each degree below 3 and for 8 to 256 rays."""

TOLERANCE = 4.0
"""Weight 1 / (1 + (q / t)^2) at a squared difference of q times the expected one; t = 4 (3 to 8 differ by 2%)."""

FLOOR = np.float32(0.01)
"""Least f (1 - f) assumed: a shadow of less than a ray or two cannot be distinguished from none."""

TWO_STEPS_RAYS = 8
MAX_RAYS = 512
"""Two steps while rays <= 8 B, one up to 512, none beyond: above it the bias outweighs the noise in low bands."""

_COLUMNS = 16  # averaged at a time: a cache line of each neighbour, and a small copy of all


def steps_for(rays: int, bands: int) -> int:
    """The number of steps of `average` worth their bias at a number of rays per vertex (scripts/bench rays)."""
    if rays > MAX_RAYS:
        return 0
    return 2 if rays <= TWO_STEPS_RAYS * bands else 1


def average(
    neighbors: Neighbors | Rows,  # N nodes of V vertices
    normals: NDArray[np.float32],  # (N, 3) float32, unit
    model: NDArray[np.float32],  # (N, 4) float32 of `sampling.gather`, changed
    rest: NDArray[np.float32],  # (V, K) float32 of the same, changed; only rows of vertices that stand for nodes count
    rays: int,  # per node, of which they were made
    steps: int,
) -> None:
    """Average the model and the rest of every node over its ring, `steps` times, in place.

    Where all nodes of a ring see everything, or nothing, not a bit changes. Sums run over sorted rows: the result
    does not depend on the order of vertices or faces, nor on the number of threads.
    """
    count, bands = len(model), min(FEW_BANDS, math.isqrt(rest.shape[1]))
    noise = NOISE * rays**NOISE_POWER * bands**2  # variance of all that is compared, except for f (1 - f)
    accepted = np.float32(noise * TOLERANCE)
    lobe = (harmonics.lambert_coefficients(bands) / np.pi).astype(np.float32)
    tables = legendre_factors(bands), lobe, squared_lobe(bands)
    ring = Rows(neighbors.vertices, neighbors.starts, neighbors.columns, neighbors.weights)
    guide, old = np.zeros((count, bands**2), np.float32), np.zeros((count, _COLUMNS), np.float32)
    spread, new_spread = np.zeros(count, np.float32), np.zeros(count, np.float32)
    weights, own = np.zeros_like(neighbors.weights), np.zeros(count, np.float32)
    for step in range(steps):
        in_slices(_guides, count, normals, model, rest, ring, *tables, guide)
        if step == 0:
            in_slices(_partial_shadow, count, ring, guide, spread)
        in_slices(_weigh, count, ring, guide, spread, accepted, weights, own, new_spread)
        spread, new_spread = new_spread, spread
        for first in range(0, 4 + rest.shape[1], _COLUMNS):
            in_slices(_take, count, model, rest, ring, first, old)
            in_slices(_blend, count, ring, weights, own, old, model, rest, first)


@kernel
def _guides(
    begin: int,
    end: int,
    normals: NDArray[np.float32],
    model: NDArray[np.float32],
    rest: NDArray[np.float32],
    ring: Rows,
    norms: NDArray[np.float32],
    lobe: NDArray[np.float32],
    squared: NDArray[np.float32],
    guide: NDArray[np.float32],
) -> None:
    """The loss of transfer to shadows, T - A, in the lowest degrees."""
    for i in range(begin, end):
        for k in range(guide.shape[1]):
            guide[i, k] = rest[ring.vertices[i], k]
        add_lobes(i, normals, model[i, 0] - np.float32(1), model, norms, lobe, squared, guide)


@kernel
def _partial_shadow(
    begin: int,
    end: int,
    ring: Rows,
    guide: NDArray[np.float32],
    spread: NDArray[np.float32],
) -> None:
    """f (1 - f) of the visible fraction f, averaged over the ring since f of a few rays says little; see FLOOR."""
    scale = np.float32(math.sqrt(4.0 * math.pi))
    for i in range(begin, end):
        weight, total = np.float32(1), guide[i, 0]
        for at in range(ring.starts[i], ring.starts[i + 1]):
            weight += ring.weights[at]
            total += ring.weights[at] * guide[ring.columns[at], 0]
        hidden = min(max(-total / weight * scale, np.float32(0)), np.float32(1))
        spread[i] = hidden * (np.float32(1) - hidden) + FLOOR


@kernel
def _weigh(
    begin: int,
    end: int,
    ring: Rows,
    guide: NDArray[np.float32],
    spread: NDArray[np.float32],
    accepted: np.float32,
    weights: NDArray[np.float32],
    own: NDArray[np.float32],
    new_spread: NDArray[np.float32],
) -> None:
    """Weights of the neighbours and of the node itself, which sum to 1, and the variance of their mean."""
    for i in range(begin, end):
        total = np.float32(1)
        for at in range(ring.starts[i], ring.starts[i + 1]):
            j, square = ring.columns[at], np.float32(0)
            for k in range(guide.shape[1]):
                difference = guide[i, k] - guide[j, k]
                square += difference * difference
            excess = square / (accepted * (spread[i] + spread[j]))
            weights[at] = ring.weights[at] / (np.float32(1) + excess * excess)
            total += weights[at]
        own[i] = np.float32(1) / total
        new_spread[i] = spread[i] * own[i] * own[i]
        for at in range(ring.starts[i], ring.starts[i + 1]):
            share = weights[at] * own[i]
            new_spread[i] += spread[ring.columns[at]] * share * share


@kernel
def _take(
    begin: int,
    end: int,
    model: NDArray[np.float32],
    rest: NDArray[np.float32],
    ring: Rows,
    first: int,
    old: NDArray[np.float32],
) -> None:
    """Copy _COLUMNS columns of the model and the rest side by side, from column `first` on; zeros beyond the end."""
    width = rest.shape[1] + 4
    for i in range(begin, end):
        for k in range(_COLUMNS):
            column = first + k
            if column < 4:
                old[i, k] = model[i, column]
            else:
                old[i, k] = rest[ring.vertices[i], column - 4] if column < width else np.float32(0)


@kernel
def _blend(
    begin: int,
    end: int,
    ring: Rows,
    weights: NDArray[np.float32],
    own: NDArray[np.float32],
    old: NDArray[np.float32],
    model: NDArray[np.float32],
    rest: NDArray[np.float32],
    first: int,
) -> None:
    """Add the weighted differences to the neighbours: where they agree, not a bit changes."""
    width = rest.shape[1] + 4
    change = np.zeros(_COLUMNS, np.float32)
    for i in range(begin, end):
        change[:] = np.float32(0)
        for at in range(ring.starts[i], ring.starts[i + 1]):
            share, j = weights[at] * own[i], ring.columns[at]
            for k in range(_COLUMNS):
                change[k] += share * (old[j, k] - old[i, k])
        for k in range(min(_COLUMNS, width - first)):
            column, value = first + k, old[i, k] + change[k]
            if column < 4:
                model[i, column] = value
            else:
                rest[ring.vertices[i], column - 4] = value
