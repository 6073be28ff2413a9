"""The number of rays that placed lamps and their first bounce need, measured on a sample of the vertices.

Two independent sets of rays differ by their noise, so no converged reference is traced.
"""

import math
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices

from ..lamps.emitters import Emitters
from ..lamps.tracing import ALONE, BLOCK, CHANCE_PART, lamplight, ordered
from ..transfer.bounces import Interreflection
from ..transfer.first_bounce import first_bounce
from ..transfer.neighbors import along_curve
from ..transfer.occluder import Occluder
from ..transfer.settings import BOUNCE_RAYS as MATRIX_RAYS
from .costs import BOUNCE_RAYS

SAMPLE = 1024
"""Vertices of the sample. Of half-shadows, which are on a tenth of them, it has a hundred."""

MANY = ALONE + CHANCE_PART * BOUNCE_RAYS[0]
"""Emitters beyond which some choice of rays makes vertices choose among them. The sample then consists of whole blocks
of vertices, which share a list of the brightest."""

BRIGHT = 90.0
"""Percentile of all light above which a vertex counts as if it had that much: the pool of a spot is overexposed where
the rest of the room is seen, and would hide the noise of its first bounce."""


class RayPlan(NamedTuple):
    """The rays for placed lamps, or for their first bounce, with their error and time.

    rays: for each vertex and lamp in half-shadows, or from each vertex in place of those of the matrix of bounces; 0
    where these are enough. error: of that light, relative to all light, root mean square over the sample. seconds: for
    the whole scene. curve: [(seconds, error, rays)], quickest first. within: whether the error keeps to the tolerance.
    share: of the direct light, that of lamps; None of a first bounce.
    """

    rays: int
    error: float
    seconds: float
    curve: list[tuple[float, float, int]]
    within: bool = True
    share: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """JSON-clean, for the report."""
        curve = [{"seconds": round(s, 3), "error": round(e, 5), "rays": r} for s, e, r in self.curve]
        share = {} if self.share is None else {"share": round(self.share, 4)}
        return {
            "rays": self.rays,
            **share,
            "predicted_error": round(self.error, 5),
            "predicted_seconds": round(self.seconds, 3),
            "within_tolerance": self.within,
            "curve": curve,
        }

    def table(self, count: int = 0) -> list[str]:
        """Lines of text, below those of a plan. count: of the lamps."""
        predicted = f"predicted: error {self.error:.2%}; {self.seconds:.2f} s"
        missed = [] if self.within else ["  above the tolerance: no number of rays that may be taken keeps to it"]
        if self.share is None:
            taken = f"{self.rays} rays from each vertex" if self.rays else "the rays that are there are enough"
            return [f"  first bounce: {taken}; {predicted}", *missed]
        lamps = f"{count} lamp{'s' * (count > 1)}"
        lines = [f"lamps: {lamps}, {self.share:.0%} of the direct light; {self.rays} rays in half-shadows"]
        lines += [f"  {predicted}", *missed, "  accuracy against time", f"  {'seconds':>9}{'error':>9}"]
        for seconds, error, rays in self.curve:
            lines.append(f"  {seconds:9.3f}{error:9.2%}  {rays} rays{' <' * (rays == self.rays)}")
        return lines


def plan_lamps(
    occluder: Occluder,
    emitters: Emitters,
    beside: NDArray[np.float32],
    tolerance: float,
    *,
    leaf: NDArray[np.float32] | None = None,
    least: float = 0.0,
    seed: int = 0,
) -> RayPlan:
    """Choose the fewest rays that keep to a tolerance.

    occluder, emitters, leaf, least, seed: as of `lamps.tracing.lamplight`, leaf (V,) of all vertices. beside: (V, 3)
    float32, what vertices receive of other light, irradiance over pi: an error counts as a part of all light.
    tolerance: relative error of light that is accepted.
    """
    count = len(occluder.origins)
    rows = _sample(count, seed)
    if len(emitters.kind) > MANY:  # whole blocks, as `lamplight` makes them of all
        blocks = np.array_split(along_curve(occluder.origins), np.arange(BLOCK, count, BLOCK))
        chosen = np.random.default_rng(seed).permutation(len(blocks))[: SAMPLE // BLOCK]
        rows = np.concatenate([blocks[each] for each in np.sort(chosen)])
    leaves, share = None if leaf is None else leaf[rows], [0.0]

    def gather(rays: int, seed: int) -> NDArray[np.float32]:
        return lamplight(occluder, emitters, rays, at=ordered(occluder, rows, leaves, seed), least=least)

    def whole(light: NDArray[np.float32]) -> float:
        share[0] = float(light.sum() / max(float((light + beside[rows]).sum()), sys.float_info.min))
        return max(math.sqrt(_square(light + beside[rows])), sys.float_info.min)

    curve: list[tuple[float, float, int]] = []
    _climb(curve, gather, whole, BOUNCE_RAYS, tolerance, seed, count / len(rows))
    seconds, error, rays = curve[-1]
    return RayPlan(rays, error, seconds, curve, error <= tolerance, share[0])


def plan_first_bounce(
    occluder: Occluder,
    sent: NDArray[np.float32],
    matrix: Interreflection,
    beside: NDArray[np.float32],
    tolerance: float,
    seed: int = 0,
) -> RayPlan:
    """Choose the fewest rays that keep to a tolerance; those of the matrix where they do.

    occluder: as `first_bounce` takes it. sent: (V, 3) float32, exit radiance of the surfaces in the direct light of the
    lamps. matrix: the bounces that are there. beside: (V, 3) float32, all other light that vertices receive, irradiance
    over pi: an error counts as a part of all light. tolerance: relative error that is accepted. seed: of the sample and
    of the rays.
    """
    count = len(occluder.origins)
    rows = _sample(count, seed)

    def gather(rays: int, seed: int) -> NDArray[np.float32]:
        return first_bounce(occluder, sent, rays, rows, seed)

    def whole(light: NDArray[np.float32]) -> float:
        each = np.sqrt(np.square(light + beside[rows], dtype=np.float64).mean(axis=1))
        return max(math.sqrt(_square(np.minimum(each, np.percentile(each, BRIGHT)))), sys.float_info.min)

    curve: list[tuple[float, float, int]] = []
    one, other = (gather(MATRIX_RAYS, seed + k) for k in range(2))
    mean, noise = (one + other) / np.float32(2.0), _square(one - other) / 2.0
    # The mean has half of the noise of either, which is no error of the matrix.
    off = max(_square(matrix.bounce(sent)[rows] - mean) - noise / 2.0, 0.0)
    curve.append((0.0, math.sqrt(off) / whole(mean), 0))
    if curve[0][1] > tolerance:
        _climb(curve, gather, whole, BOUNCE_RAYS[BOUNCE_RAYS.index(MATRIX_RAYS) :], tolerance, seed, count / len(rows))
    seconds, error, rays = curve[-1]
    return RayPlan(rays, error, seconds, curve, error <= tolerance)


def _climb(
    curve: list[tuple[float, float, int]],  # as of RayPlan, added to
    gather: Callable[[int, int], NDArray[np.float32]],  # light of the sample by so many rays of a seed, (N, 3)
    whole: Callable[[NDArray[np.float32]], float],  # size of all light beside such light
    choices: tuple[int, ...],
    tolerance: float,
    seed: int,
    scale: float,  # vertices of the scene for each of the sample
) -> None:
    """Take more and more rays, until they keep to a tolerance."""
    for rays in choices:
        start = time.perf_counter()
        one = gather(rays, seed)
        seconds = (time.perf_counter() - start) * scale
        other = gather(rays, seed + 1)
        error = math.sqrt(_square(one - other) / 2.0) / whole((one + other) / np.float32(2.0))
        curve.append((seconds, error, rays))
        if error <= tolerance:
            return


def _sample(count: int, seed: int) -> Indices:
    return np.sort(np.random.default_rng(seed).choice(count, min(SAMPLE, count), replace=False))


def _square(off: NDArray[np.floating]) -> float:
    return float(np.square(off).mean(dtype=np.float64))
