"""How many rays placed lamps call for, measured on a sample of the vertices, and what they contribute and cost."""

import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..lamps.emitters import Emitters
from ..lamps.tracing import lamplight
from ..transfer.occluder import Occluder

SAMPLE = 1024
"""Vertices of the sample. Of half-shadows, which are on a tenth of them, it has a hundred."""

CHOICES = 8, 16, 32, 64, 128, 256
REFERENCE = 1024

LEAST_LIGHT = 1e-9


class LampPlan(NamedTuple):
    """What placed lamps call for.

    rays: for each vertex and lamp in half-shadows. share: of the direct light, theirs. error: relative root mean square
    of that light, over the sample. seconds: for the whole scene. curve: [(seconds, error, rays)], quickest first.
    """

    rays: int
    share: float
    error: float
    seconds: float
    curve: list[tuple[float, float, int]]

    def as_dict(self) -> dict[str, Any]:
        """JSON-clean, for the report."""
        curve = [{"seconds": round(s, 3), "error": round(e, 5), "rays": r} for s, e, r in self.curve]
        return {
            "rays": self.rays,
            "share": round(self.share, 4),
            "predicted_error": round(self.error, 5),
            "predicted_seconds": round(self.seconds, 3),
            "curve": curve,
        }

    def table(self, count: int) -> list[str]:
        """Lines of text, below those of a plan."""
        lamps = f"{count} lamp{'s' * (count > 1)}"
        lines = [f"lamps: {lamps}, {self.share:.0%} of the direct light; {self.rays} rays in half-shadows"]
        lines.append(f"  predicted: error {self.error:.2%}; {self.seconds:.2f} s")
        lines += ["  accuracy against time", f"  {'seconds':>9}{'error':>9}"]
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
) -> LampPlan:
    """Choose the fewest rays that keep to a tolerance.

    Parameters
    ----------
    occluder, emitters, leaf, least, seed
        As of `lamps.tracing.lamplight`, leaf (V,) of all vertices.
    beside : (V, 3) float32
        What vertices receive of other light, irradiance over pi: an error counts as a part of all light.
    tolerance : float
        Relative error of light that is accepted.
    """
    count = len(occluder.origins)
    rng = np.random.default_rng(seed)
    rows = np.sort(rng.choice(count, min(SAMPLE, count), replace=False))
    more: dict[str, Any] = {"rows": rows, "leaf": None if leaf is None else leaf[rows], "least": least}
    true = lamplight(occluder, emitters, REFERENCE, seed=seed + 1, **more)
    whole = float(np.sqrt(np.square(true + beside[rows]).mean(dtype=np.float64)))
    curve = []
    for rays in CHOICES:
        start = time.perf_counter()
        found = lamplight(occluder, emitters, rays, seed=seed, **more)
        seconds = (time.perf_counter() - start) * count / len(rows)
        error = float(np.sqrt(np.square(found - true).mean(dtype=np.float64))) / max(whole, LEAST_LIGHT)
        curve.append((seconds, error, rays))
        if error < tolerance / 4.0:
            break
    kept = next((step for step in curve if step[1] <= tolerance), curve[-1])
    share = float(true.sum() / max(float((true + beside[rows]).sum()), LEAST_LIGHT))
    return LampPlan(kept[2], share, kept[1], kept[0], curve)
