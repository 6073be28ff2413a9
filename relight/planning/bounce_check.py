"""The error of bounced light as it was computed, by an independent estimate at many vertices, and what it calls for.

`first_bounce` gathers the light that the work found on all surfaces anew, by two sets of rays other than those of the
work. The product of what the work is off from either has no noise of its own.
"""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats

from ..transfer.first_bounce import first_bounce
from . import costs

if TYPE_CHECKING:
    from .sample import Sample

RAYS = 32
"""Of each set, from every vertex. Noise of so few cancels over thousands of vertices."""

MOST_ROUNDS = 2
"""How often bounce rays are traced anew."""

LEAST_ROOM = 0.5
"""Part of the tolerance that bounced light may always take up: where other errors fill it, less would hardly help."""


class BouncesToCheck(NamedTuple):
    """Of a plan whose bounces are not checked yet. others: all other errors. found: [(bounce rays, measured error)]."""

    others: float
    found: list[tuple[int, float]]


def bounced_error(
    sample: "Sample",
    albedo: NDArray[np.float32] | np.float32,
    direct: NDArray[np.float32],
    radiance: NDArray[np.float32],
    seed: int,
) -> float:
    """Error of what surfaces send to one another, relative to all light of a sample: relative L2.

    Leaves and grass that are volumes are not judged: rays from their surfaces do not estimate their light.

    Parameters
    ----------
    sample : Sample
        Its rows are compared.
    albedo : ndarray, (V, 3) float32, or 1
        Linear.
    direct, radiance : ndarray, (V, 3) float32
        Of all vertices: direct light on the white scene, exit radiance with bounces.
    seed : int
        Of the work; other rays are taken.
    """
    rows = sample.rows
    tint = np.broadcast_to(albedo, radiance.shape)[rows]
    found, off = radiance[rows] - tint * direct[rows], list[Floats]()
    for number in range(2):
        gathered = first_bounce(sample.occluder, radiance, RAYS, rows, seed + 1 + number)
        off.append((found - tint * gathered).astype(np.float64) * sample.solid[:, None])
    square = float(sample.weights @ (off[0] * off[1]).sum(axis=1))
    return math.sqrt(max(square, 0.0) / max(float(sample.mean_square(radiance[rows])), 1e-30))


def more_rays(bounces: BouncesToCheck, tolerance: float) -> int | None:
    """The number of bounce rays that keeps a plan to its tolerance, by the errors found so far; None to leave them.

    Noise falls as the law of `costs` says. With two errors, what did not fall that way is taken for no noise.
    """
    (rays, off), rest = bounces.found[-1], 0.0
    most = max(tolerance**2 - bounces.others**2, (LEAST_ROOM * tolerance) ** 2)
    if off**2 <= most or len(bounces.found) > MOST_ROUNDS:
        return None
    if len(bounces.found) > 1:
        fewer, before = bounces.found[-2]
        fell = (_noise(rays) / _noise(fewer)) ** 2
        rest = max(off**2 - fell * before**2, 0.0) / (1.0 - fell)
    for more in (each for each in costs.BOUNCE_NOISE if each > rays):
        if rest + (off**2 - rest) * (_noise(more) / _noise(rays)) ** 2 <= most:
            return more
    return None


def _noise(rays: int) -> float:
    """The law's noise of so many rays; those of a matrix that is kept may be more than plans take."""
    return costs.BOUNCE_NOISE[max(each for each in costs.BOUNCE_NOISE if each <= rays)]
