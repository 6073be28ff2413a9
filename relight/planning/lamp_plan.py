"""The number of rays that placed lamps need, measured on a sample of the vertices, and their contribution and cost."""

import sys
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..lamps.choosing import ALONE, BLOCK
from ..lamps.emitters import Emitters
from ..lamps.tracing import CHANCE_PART, LitVertices, lamplight
from ..transfer.neighbors import along_curve
from ..transfer.occluder import Occluder
from .costs import BOUNCE_RAYS

SAMPLE = 1024
"""Vertices of the sample. Of half-shadows, which are on a tenth of them, it has a hundred."""

REFERENCE = SAMPLE

MANY = ALONE + CHANCE_PART * BOUNCE_RAYS[0]
"""Emitters beyond which some choice of rays makes vertices choose among them. The sample then consists of whole blocks
of vertices, which share a list of the brightest, and its reference takes every emitter at each vertex."""

BLOCKS, JUDGED, MANY_PAIRS = 96, 4, 2**22
"""Blocks in the sample, vertices in each that have a reference, and how many pairs of vertex and emitter that has at
most. With 13 blocks and all of their vertices the error of 10,000 lamps was predicted as .028, and was .037."""

MANY_REFERENCE = 64
"""Rays of that reference in half-shadows."""


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
    rng = np.random.default_rng(seed)
    lamps = len(emitters.kind)
    many = lamps > MANY
    if many:
        rows, judged = _blocks(occluder, lamps, rng)
    else:
        rows = np.sort(rng.choice(count, min(SAMPLE, count), replace=False))
        judged = np.arange(len(rows))
    at, known = (LitVertices(some, None if leaf is None else leaf[some]) for some in (rows, rows[judged]))
    finest = MANY_REFERENCE if many else REFERENCE
    true = lamplight(occluder, emitters, finest, at=known, least=least, seed=seed + 1, every=many)
    beside = beside[rows[judged]]
    whole = float(np.sqrt(np.square(true + beside).mean(dtype=np.float64)))
    curve = []
    for rays in BOUNCE_RAYS:
        start = time.perf_counter()
        found = lamplight(occluder, emitters, rays, at=at, least=least, seed=seed)
        seconds = (time.perf_counter() - start) * count / len(rows)
        squares = np.square(found[judged] - true).mean(axis=1, dtype=np.float64)
        doubt = float(squares.std()) / len(squares) ** 0.5 if many else 0.0  # few errors are large
        error = (float(squares.mean()) + doubt) ** 0.5 / max(whole, sys.float_info.min)
        curve.append((seconds, error, rays))
        if error < tolerance / 4.0:
            break
    kept = next((step for step in curve if step[1] <= tolerance), curve[-1])
    share = float(true.sum() / max(float((true + beside).sum()), sys.float_info.min))
    return RayPlan(kept[2], kept[1], kept[0], curve, kept[1] <= tolerance, share)


def _blocks(occluder: Occluder, lamps: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Vertices in whole blocks as `lamplight` makes them of all, and which of these vertices have a reference."""
    order = along_curve(occluder.origins)
    blocks = -(-len(order) // BLOCK)
    chosen = rng.choice(blocks, min(BLOCKS, blocks), replace=False)
    each = min(max(MANY_PAIRS // (lamps * len(chosen)), 1), JUDGED)
    rows: list[NDArray[np.int64]] = []
    judged: list[NDArray[np.int64]] = []
    for block in np.sort(chosen):
        start = sum(len(each) for each in rows)
        rows.append(order[BLOCK * block : BLOCK * (block + 1)])
        judged.append(start + rng.choice(len(rows[-1]), min(each, len(rows[-1])), replace=False))
    return np.concatenate(rows).astype(np.int64), np.concatenate(judged).astype(np.int64)
