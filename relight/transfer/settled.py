"""Light with all bounces, by a part of the rays until it settles, then by all of them once, and what that changes.

A few bounces are combined so that what is left unsettled is least: reduced rank extrapolation (Eddy 1979; Mesina
1977), which for linear equations is GMRES (Saad, Schultz 1986). What all rays change is settled by a part again: the
mistake of that part then counts only on a small change (iterative refinement).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Floats
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import read_only

from .bounces import DEFAULT_MAX_BOUNCES, Interreflection
from .checks import check_shape, checked_albedo

THINNING = 4
"""One ray in so many carries light until it settles."""

LEAST_FALL = 0.7
"""Light that bounces is taken to keep at least this share from bounce to bounce: pockets among leaves show late. Chosen
with THINNING on two scenes, the example garden and lounge."""

DIGITS = 6
"""Decimals of the weights of bounces: coarser than the roundings in which scenes that are cut into chunks differ."""


def settled(
    direct: NDArray[np.float32],  # (V, 3) exit radiance of the white scene in direct light
    albedo: ArrayLike,  # (V, 3) linear, in [0, 1]
    interreflection: Interreflection,
    tolerance: float,
    max_bounces: int = DEFAULT_MAX_BOUNCES,
) -> tuple[NDArray[np.float32], list[float]]:
    """The same as `bounces.with_bounces`, to within its noise: exit radiance (V, 3) float32, and what each bounce gave
    over all light so far, for those computed one by one.

    Raises InputError for arrays that do not fit.
    """
    check_shape("the direct light", direct, (len(interreflection.hits), 3))
    albedo = checked_albedo(albedo, len(interreflection.hits))
    shares, sent = interreflection.shares, albedo * np.asarray(direct, np.float32)

    def settle(source: NDArray[np.float32], whole: float) -> tuple[NDArray[np.float32], list[float]]:
        """(V, 3) light of a source (V, 3), and each bounce over the light so far; whole: norm of all other light."""
        steps, given, weights = [source], list[float](), np.ones((1, 3))
        products = np.zeros((max_bounces + 1, max_bounces + 1, 3))
        products[0, 0] = _products(shares, source, source)
        while len(given) < max_bounces:
            steps.append(albedo * interreflection.bounce(steps[-1], THINNING))
            for k, step in enumerate(steps):
                products[k, len(steps) - 1] = products[len(steps) - 1, k] = _products(shares, step, steps[-1])
            last, before = (float(np.sqrt(products[k, k].sum())) for k in (len(steps) - 1, len(steps) - 2))
            given.append(last / max(float(np.sqrt(products.sum())), np.finfo(np.float64).tiny))
            weights, left = _weights(products[: len(steps), : len(steps)])
            falls = max(last / before if before > 0.0 else 0.0, LEAST_FALL)
            if last == 0.0 or (falls < 1.0 and left * falls / (1.0 - falls) < tolerance * max(whole, last)):
                break
        after = np.cumsum(weights[::-1], axis=0)[::-1].astype(np.float32)  # a sum up to bounce j holds all before it
        found = np.zeros_like(source)
        for weight, step in zip(after, steps, strict=True):
            found += weight * step
        return found, given

    whole = float(np.sqrt(_products(shares, sent, sent).sum()))
    light, given = settle(sent, whole)
    change = sent + albedo * interreflection.bounce(light) - light
    change, _ = settle(change, whole)
    light += change
    return np.maximum(light, sent, out=light), given


def _products(shares: Floats, one: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.float64]:
    """(3,) sums of products of (V, 3), each row counted by its share (V,)."""
    sums = np.zeros(3)
    _sum_products(read_only(shares, np.float64), read_only(one), read_only(other), sums)
    return sums


@kernel
def _sum_products(
    shares: NDArray[np.float64], one: NDArray[np.float32], other: NDArray[np.float32], sums: NDArray[np.float64]
) -> None:
    for v in range(len(shares)):
        for c in range(3):
            sums[c] += shares[v] * np.float64(one[v, c]) * np.float64(other[v, c])


def _weights(products: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """(K, 3) weights of sums of bounces, of sum 1, for which the last bounce of their sum is least, and its norm."""
    count = len(products)
    weights, left = np.zeros((count, 3)), 0.0
    for channel in range(3):
        matrix = products[:, :, channel]
        scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
        used = np.flatnonzero(scale > 1e-9 * scale.max(initial=0.0))
        if not len(used):
            weights[-1, channel] = 1.0
            continue
        part = matrix[np.ix_(used, used)] / np.outer(scale[used], scale[used])
        solution = np.linalg.solve(part + 1e-9 * np.eye(len(used)), 1.0 / scale[used]) / scale[used]
        found = np.round(solution / solution.sum(), DIGITS)
        weights[used, channel] = found / found.sum()
        left += max(float(weights[:, channel] @ matrix @ weights[:, channel]), 0.0)
    return weights, float(np.sqrt(left))
