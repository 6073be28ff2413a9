"""Contribution and cost of gloss, for a plan: measured on the scene; the fit is timed by one pass."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.scene.color import linear_from_srgb, luminance

from .harmonicsfit import STEPS
from .material import Gloss
from .reflections import Reflections


class GlossPlan(NamedTuple):
    """The gloss of a scene.

    surface: share of the surface's nodes that is glossy. light: share of what pictures show of the captured light that
    is reflected. reflectance, alpha: medians over glossy surfaces, of luminance at normal incidence and of roughness.
    seconds: for the first light, after gloss is measured.
    """

    surface: float
    light: float
    reflectance: float
    alpha: float
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        """JSON-clean, for the report."""
        return {name: round(value, 4) for name, value in self._asdict().items()}

    def table(self) -> list[str]:
        """Lines of text, below those of a plan."""
        what = f"reflectance {self.reflectance:.3f}, alpha {self.alpha:.2f}"
        return [
            f"gloss: {self.surface:.0%} of the surface, {what}; {self.light:.1%} of what is seen",
            f"  predicted: {self.seconds:.2f} s",
        ]


def plan_gloss(
    make: Callable[[], Reflections], gloss: Gloss, light: Floats, radiance: Radiance
) -> tuple[Reflections, GlossPlan]:
    """The Reflections that `make` returns, and the GlossPlan of them.

    light: (K, 3) SH coefficients of the captured light. radiance: (V, 3) captured colours, linear.
    """
    start = time.perf_counter()
    reflections = make()
    reflected = reflections.reflected(light, radiance)
    traced = time.perf_counter() - start
    start = time.perf_counter()
    pictures = reflections.pictures()
    one_pass = time.perf_counter() - start
    shown = sum(float(luminance(linear_from_srgb(np.clip(picture, 0.0, None))).sum()) for picture in pictures)
    part = sum(float(luminance(each).sum()) for each in reflected)
    rows = gloss.glossy
    return reflections, GlossPlan(
        float(rows.mean()),
        part / max(shown, 1e-30),
        float(np.median(luminance(gloss.reflectance[rows]))),
        float(np.median(gloss.alpha[rows])),
        traced + one_pass * (2 * STEPS + 2),
    )
