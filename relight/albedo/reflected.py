"""The light of the capture where gloss shows it: reflections show its shape, shading confirms it and its contrast."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Coefficients

from ..light import projections
from ..sh import harmonics
from . import fit, natural
from .captured import HEIGHT, WIDTH, CapturedScene

CONTRASTS = (0.5, 1.0, 1.5, 2.0)
"""Root mean square of the light about its mean, relative to that: reflections determine it up to a factor."""

STIFFNESS = 10.0
"""Weight of the prior about a light from reflections, against the prior about a uniform light."""

LEAST_GAIN = 0.01
"""Of the cost, relative: how much better the shading must agree with the reflections than with a uniform light. A table
of glazed objects gained .04."""

DARKEST = 0.25
"""Share of the mean radiance below which a shape fades towards 0 and stays positive."""


def guided(
    scene: CapturedScene, light: fit.Light, start: NDArray[np.float64], shape: Coefficients
) -> tuple[fit.Fit, NDArray[np.float64], NDArray[np.float64]] | None:
    """The Fit about a light that reflections show, with the start and prior it was found with.

    start: (K, 3) theta of a uniform light. shape: (K,) SH coefficients of luminance, mean 0, any scale. None where the
    shading of the scene does not agree with it.
    """
    bands = harmonics.bands_of(start)
    prior = STIFFNESS * fit.prior_of(bands, natural.PRECISION)
    plain = scene.fitted(light, start, prior)
    best = None
    for contrast in CONTRASTS:
        begin = start + log_shape(shape, contrast, bands)[:, None]
        found = scene.fitted(light, begin, prior)
        if best is None or found.cost < best[0].cost:
            best = found, prior, begin
    assert best is not None
    return best if best[0].cost < (1.0 - LEAST_GAIN) * plain.cost else None


def log_shape(shape: Coefficients, contrast: float, bands: int) -> NDArray[np.float64]:
    """(B^2,) SH coefficients of the logarithm of a positive light of mean 1 with this shape (K,) and contrast."""
    directions = projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3)
    weights = np.repeat(np.sin((np.arange(HEIGHT) + 0.5) / HEIGHT * np.pi), WIDTH)
    weights /= weights.sum()
    about = harmonics.evaluate(directions, harmonics.bands_of(shape)) @ np.asarray(shape, np.float64)
    about -= weights @ about
    radiance = 1.0 + contrast * about / max(float(np.sqrt(weights @ about**2)), 1e-30)
    radiance = np.where(radiance > DARKEST, radiance, DARKEST * np.exp(np.clip(radiance / DARKEST - 1.0, -4.0, 0.0)))
    basis = harmonics.evaluate(directions, bands)
    return 4 * np.pi * (basis * weights[:, None]).T @ np.log(radiance / (weights @ radiance))
