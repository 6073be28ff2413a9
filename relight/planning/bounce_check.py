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
from ..transfer.settings import BOUNCE_RAYS
from . import costs

if TYPE_CHECKING:
    from .sample import Sample

RAYS = BOUNCE_RAYS
"""Of each set, from every vertex. Few vertices have most of the error: on 1,639 of a patio a check by 32 rays finds
.009 to .018 where 256 find .015, by 64 .013 to .016, by 128 .012 to .015."""

MOST_ROUNDS = 2
"""How often bounce rays are traced anew."""

LEAST_ROOM = 0.5
"""Part of the tolerance that bounced light may always take up: where other errors fill it, less would hardly help."""


class BounceErrors(NamedTuple):
    """Relative L2 errors of bounced light, over all light. whole: of what surfaces send to one another. noise: the part
    of it that more bounce rays mend; the rest is that of the sky that every vertex sees, which scales them."""

    whole: float
    noise: float


def bounce_errors(
    sample: "Sample",
    albedo: NDArray[np.float32] | np.float32,
    direct: NDArray[np.float32],
    radiance: NDArray[np.float32],
    hidden: NDArray[np.float32],
    seed: int,
) -> BounceErrors:
    """The BounceErrors of light that was computed, at the rows of a sample.

    Rays from the surfaces of leaves and grass tell nothing of what these hide as volumes: all but noise is taken to be
    as large there, for the share that is a surface, as elsewhere.

    sample: its rows are compared. albedo: (V, 3) float32, or 1, linear. direct, radiance: (V, 3) float32, of all
    vertices: direct light on the white scene, exit radiance with bounces. hidden: (V,) float32, share of the cosine
    lobe of every vertex that bounces were scaled to. seed: of the work; other rays are taken.
    """
    rows = sample.rows
    tint = np.broadcast_to(albedo, radiance.shape)[rows]
    found, light = radiance[rows] - tint * direct[rows], sample.weights * np.square(radiance[rows]).sum(axis=1)
    shares = np.zeros((2, len(rows)), np.float32)
    sets = [first_bounce(sample.occluder, radiance, RAYS, rows, seed + 1 + k, met=shares[k]) for k in range(2)]
    met = np.maximum(shares.sum(axis=0), 1.0 / RAYS)[:, None] / 2.0  # of both: else the scale leans with the light
    whole, noise = list[Floats](), list[Floats]()
    for gathered, share in zip(sets, shares, strict=True):
        whole.append((found - tint * gathered).astype(np.float64))
        noise.append((found * share[:, None] - tint * gathered * hidden[rows, None]) / met.astype(np.float64))
    wholes, noises = (sample.weights * (one * other).sum(axis=1) for one, other in (whole, noise))
    solid, total = sample.solid == 1.0, max(float(light.sum()), 1e-30)
    rest = max(float((wholes - noises)[solid].sum()), 0.0) / max(float(light[solid].sum()), 1e-30)
    rest *= float(light @ np.square(sample.solid))
    square = max(float(noises.sum()), 0.0)
    return BounceErrors(math.sqrt((square + rest) / total), math.sqrt(square / total))


def more_rays(rays: int, found: BounceErrors, others: float, tolerance: float) -> int | None:
    """The least number of bounce rays that keeps a plan to its tolerance, where so many left the errors `found` and all
    others are `others`; None where they suffice, or none does. Noise falls as the law of `costs` says."""
    most = max(tolerance**2 - others**2, (LEAST_ROOM * tolerance) ** 2)
    noise = min(found.noise, found.whole) ** 2
    rest = found.whole**2 - noise
    if rest + noise <= most:
        return None
    for more in (each for each in costs.BOUNCE_RAYS if each > rays):
        if rest + noise * (costs.bounce_noise(more) / costs.bounce_noise(rays)) ** 2 <= most:
            return more
    return None
