"""A partly photographed capture light: the part that a captured sky fixes, the part that it bounds, and the free part.

Of every direction's light one part is the sky's radiance, one was clipped and is 1 or more, one was not seen. The
clipped and the unseen part are exponentials of separate spherical harmonics: a clipped sky is far brighter than its
surroundings, and a few harmonics cannot hold the step.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats
from splat2mesh.base.sphere import row_solid_angles, texel_directions
from splat2mesh.scene.color import linear_from_srgb, luminance, srgb_from_linear
from splat2mesh.scene.measured import CapturedSky

from ..light.environment import Environment
from ..sh import harmonics
from . import fit
from .division import weighted_median

UNSEEN_BANDS = 4
"""Bands of the logarithm of the invisible light, which is assumed to be smooth."""

EXCESS_BANDS = 4
"""Bands of the logarithm of the excess over 1 where the sky clipped."""

BANDS = UNSEEN_BANDS, EXCESS_BANDS

USUAL_ALBEDO = 0.2
"""Median albedo, in luminance, of what lies under an open sky: asphalt .12, grass and leaves .1 to .25, brick and
paving .2 to .35. It sets how far the clipped sky exceeds 1."""

LEAST_EXCESS, MOST_EXCESS = 0.02, 300.0
"""Range of that: what exceeds 1 by less is not worth its colour, and by more it is a sun, for which see `sun`."""

UNSEEN_WEIGHT, LEVEL_WEIGHT = 1000.0, 30.0
"""Factor on the prior of the invisible light and of the mean excess, against that of the excess's distribution."""

STRENGTH = 1e-2
"""Of the prior, against a mean over pairs of places. Under soft light, pairs of a garden's places show the errors of
its mesh more than the light: with 2e-4 everywhere, as without a sky, the patio's light was 67 degrees off and its relit
splat 3 dB worse than with the sky alone."""

GROUND = 0.2
"""Ratio of invisible light below the horizon to that above: the albedo of the ground around."""

LEAST_SUN_GAIN = 0.02
"""Relative fall of the cost for which a sun among the clipped is believed; without any, errors of a garden's mesh gave
up to 1%."""

LEAST_VISIBLE = 0.05
"""Least visible part of the upper hemisphere for a sky to be used: windows show less."""

LITTLE_VISIBLE = 0.25
"""Visible part below which the invisible part decides. Without views from inside, such a sky is used only beside a sun:
in two nooks with .06 visible, pairs under the sky made relit splats 1 to 8 dB worse than without it."""

LEAST_OPEN = 0.3
"""Mean part of the sky that the surfaces of a scene see, from which a captured sky is its light: a garden's see 0.59,
those of a room no more than its windows and the holes of its mesh let in."""

LEAST_BOUND = 0.02
"""Least visible part of the upper hemisphere for its mean to represent the invisible part."""


MOSTLY, LEAST_HEIGHT, LEAST_COMPARED = 0.5, 0.05, 0.03
"""To read the exposure off a captured sky: the part of a texel that binds, the sine of its height above the horizon,
where ground and trees show that no environment has, and steradians in all."""

BLUR_TEXELS, BLURRED_BESIDE = 2.0, 0.05
"""How far around what was clipped a sky's splats mix it with what stands before it, as the spread of a Gaussian, and
the clipped share there, blurred so, from which all of a texel may be a mixture."""

BEFORE_SKY = 0.15
"""Linear radiance of the branches and roofs that clipped sky is mixed with."""


class SkyParts(NamedTuple):
    """A sky's parts at directions (K, 3). known: (K, 3) radiance that binds, with 1 for what was clipped. unseen,
    clipped: (K, 3) shares of the direction; below the horizon the unseen counts as GROUND."""

    known: NDArray[np.float64]
    unseen: NDArray[np.float64]
    clipped: NDArray[np.float64]

    @classmethod
    def at(cls, sky: CapturedSky, directions: Directions) -> "SkyParts":
        """The parts of a CapturedSky around directions (K, 3) that share the sphere evenly, means over each's cell."""
        height, width = sky.bound.shape[:2]
        texels = texel_directions(height, width).reshape(-1, 3)
        areas = np.repeat(row_solid_angles(height, width), width)
        owner = scipy.spatial.cKDTree(directions).query(texels)[1]
        total = np.bincount(owner, areas, len(directions))

        def mean(values: Floats) -> NDArray[np.float64]:
            columns = values.reshape(-1, 3).astype(np.float64).T
            sums = np.stack([np.bincount(owner, areas * column, len(directions)) for column in columns], axis=1)
            return sums / np.maximum(total, 1e-12)[:, None]

        bound, clipped = mean(sky.bound), mean(sky.clipped)
        known = mean(sky.bound * sky.radiance) + clipped
        return cls(known, _unseen(bound, clipped, directions), clipped)

    @classmethod
    def looked_up(cls, sky: CapturedSky, directions: Directions) -> "SkyParts":
        """The parts at any directions (D, 3): those of the texel that each falls into."""
        height, width = sky.bound.shape[:2]
        x, y, z = np.asarray(directions, np.float64).T
        row = (0.5 - np.arctan2(y, np.hypot(x, z)) / np.pi) * height
        column = (0.5 - np.arctan2(x, z) / (2.0 * np.pi)) * width
        at = np.clip(row.astype(np.int64), 0, height - 1), column.astype(np.int64) % width
        bound, clipped = sky.bound[at].astype(np.float64), sky.clipped[at].astype(np.float64)
        return cls(bound * sky.radiance[at] + clipped, _unseen(bound, clipped, directions), clipped)


def unmixed(sky: CapturedSky) -> CapturedSky:
    """A CapturedSky whose texels beside clipped ones are mixtures, as splats blur them: part BEFORE_SKY, part clipped.

    Sky between branches was clipped in the pictures, but blurred with them it is not, and would bind as a dark sky.
    Splats mix in sRGB: what of a texel's display value exceeds that of BEFORE_SKY is the share that was clipped.
    """
    clipped, bound = sky.clipped.astype(np.float64), sky.bound.astype(np.float64)
    beside = scipy.ndimage.gaussian_filter(
        clipped, (BLUR_TEXELS, BLUR_TEXELS, 0.0), mode=("nearest", "wrap", "nearest")
    )
    shown, before = srgb_from_linear(np.clip(sky.radiance, 0.0, 1.0)), float(srgb_from_linear(np.float64(BEFORE_SKY)))
    share = np.clip((shown - before) / (1.0 - before), 0.0, 1.0) * np.minimum(beside / BLURRED_BESIDE, 1.0)
    rest = linear_from_srgb(np.clip((shown - share) / np.maximum(1.0 - share, 1e-3), 0.0, 1.0))
    radiance = np.where(share > 0.0, np.minimum(rest, sky.radiance), sky.radiance)
    parts = radiance, bound * (1.0 - share), clipped + bound * share
    return type(sky)(*(part.astype(np.float32) for part in parts))


class SkyLight:
    """S = sum over k of sky_vk (known_k + unseen_k exp(Y_k theta_u) + clipped_k exp(Y_k theta_c)) + bounce.

    theta: (M, 3), the UNSEEN_BANDS^2 coefficients of theta_u above the EXCESS_BANDS^2 of theta_c.
    """

    def __init__(
        self, sky: NDArray[np.float32], parts: SkyParts, directions: Directions, bounce: NDArray[np.float64]
    ) -> None:
        """sky: (N, K) of Samples. parts: SkyParts at the directions (K, 3). bounce: (N, 3)."""
        self._sky, self._bounce = sky, bounce + sky @ parts.known
        self._shares = parts.unseen.astype(np.float32), parts.clipped.astype(np.float32)
        self._bases = [harmonics.evaluate(directions, bands).astype(np.float32) for bands in BANDS]

    def __call__(self, theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Irradiance (N, 3) and the derivative (N, 3, M) of its logarithm."""
        received, slope = np.zeros(self._bounce.shape), np.zeros((*self._bounce.shape, len(theta)))
        for color in range(3):
            received[:, color], start = self._bounce[:, color], 0
            for basis, shares in zip(self._bases, self._shares, strict=True):
                part = slice(start, start + basis.shape[1])
                radiance = _exponential(basis, theta[part, color]).astype(np.float32) * shares[:, color]
                direct = self._sky @ np.column_stack([radiance, radiance[:, None] * basis])
                received[:, color] += direct[:, 0]
                slope[:, color, part], start = direct[:, 1:], part.stop
            received[:, color] = np.maximum(received[:, color], 1e-12)
            slope[:, color] /= received[:, color, None]
        return received, slope


def start_of(
    light: SkyLight,
    parts: SkyParts,  # that it is of
    directions: Directions,  # (K, 3)
    captured: NDArray[np.float64],  # (N, 3) colours of its places
    usual: Floats,  # (3,) radiance of a uniform light, where nothing was seen
) -> NDArray[np.float64]:
    """theta (M, 3) to begin with: the upper half of what was not seen is as bright as what was, before it was clipped,
    and of what was clipped as much exceeds 1, in all colours alike, as makes the median albedo USUAL_ALBEDO."""
    unit = 1.0 / np.sqrt(4.0 * np.pi)
    theta = np.zeros((UNSEEN_BANDS**2 + EXCESS_BANDS**2, 3))
    above = np.maximum(directions[:, 1:2], 0.0)
    weight = ((1.0 - parts.unseen) * above).sum(axis=0) / above.sum()
    mean = (parts.known * above).sum(axis=0) / above.sum() / np.maximum(weight, 1e-9)
    theta[0] = np.log(np.maximum(np.where(weight > LEAST_BOUND, mean, usual), 1e-6)) / unit
    low, high = np.log(LEAST_EXCESS), np.log(MOST_EXCESS)
    bright = luminance(captured)
    for _ in range(20):  # halves the range each time: a millionth of it is left
        theta[UNSEEN_BANDS**2] = 0.5 * (low + high) / unit
        darker = np.median(bright / luminance(light(theta)[0])) < USUAL_ALBEDO
        low, high = (low, 0.5 * (low + high)) if darker else (0.5 * (low + high), high)
    return theta


def radiance(
    parts: SkyParts, theta: NDArray[np.float64], directions: Directions
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(known, free): radiance (D, 3) that binds and that the two exponentials give, at directions with these parts."""
    free, start = np.zeros_like(parts.known), 0
    for bands, shares in zip(BANDS, (parts.unseen, parts.clipped), strict=True):
        free += shares * _exponential(harmonics.evaluate(directions, bands), theta[start : start + bands**2])
        start += bands**2
    return parts.known, free


def without_excess(parts: SkyParts, theta: NDArray[np.float64], directions: Directions) -> NDArray[np.float64]:
    """(D, 3) radiance at directions with these parts, as from `radiance`, but 1 where the sky clipped."""
    unseen = _exponential(harmonics.evaluate(directions, UNSEEN_BANDS), theta[: UNSEEN_BANDS**2])
    return parts.known + parts.unseen * unseen


def prior_of(of_bands: Callable[[int], NDArray[np.float64]]) -> NDArray[np.float64]:
    """(3 M, 3 M), colours outermost, of the prior `of_bands` gives an exponential by its bands, in units of fit's."""
    unseen, excess = UNSEEN_BANDS**2, EXCESS_BANDS**2
    prior = np.zeros((3, unseen + excess, 3, unseen + excess))
    prior[:, :unseen, :, :unseen] = UNSEEN_WEIGHT * of_bands(UNSEEN_BANDS).reshape(3, unseen, 3, unseen)
    prior[:, unseen:, :, unseen:] = of_bands(EXCESS_BANDS).reshape(3, excess, 3, excess)
    prior[:, unseen, :, unseen] *= LEVEL_WEIGHT
    return prior.reshape(3 * (unseen + excess), -1) * (STRENGTH / fit.STRENGTH)


def visible_part(sky: CapturedSky) -> float:
    """Visible part of the upper hemisphere, weighted as it lights level ground: in [0, 1]."""
    height, width = sky.bound.shape[:2]
    weight = np.maximum(texel_directions(height, width)[..., 1], 0.0) * row_solid_angles(height, width)
    return float(((sky.bound + sky.clipped).mean(axis=2) * weight).sum() / weight.sum())


def exposure_of(sky: CapturedSky, environment: Environment) -> np.float32 | None:
    """Captured colour per radiance of a known Environment: the median over the pixels of a CapturedSky that bind,
    weighted by the square of their height, since trees stand low; None where too few pixels bind."""
    height, width = sky.bound.shape[:2]
    directions = texel_directions(height, width)
    areas = np.repeat(row_solid_angles(height, width), width, axis=1)
    binds = (sky.bound.min(axis=2) > MOSTLY) & (directions[..., 1] > LEAST_HEIGHT) & (sky.radiance.min(axis=2) > 0.0)
    shown = environment.lookup(directions[binds])
    lit = luminance(shown) > 0.0
    if areas[binds][lit].sum() < LEAST_COMPARED:
        return None
    ratio = luminance(sky.radiance[binds][lit]) / luminance(shown[lit])
    return np.float32(weighted_median(ratio, areas[binds][lit] * directions[binds][lit, 1] ** 2))


def _unseen(bound: Floats, clipped: Floats, directions: Directions) -> NDArray[np.float64]:
    """Shares (D, 3) of directions that were not seen, less the light that the ground around does not send back."""
    below = np.where(directions[:, 1:2] < 0.0, GROUND, 1.0)
    return below * np.clip(1.0 - bound - clipped, 0.0, 1.0)


def _exponential(basis: Floats, theta: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.exp(np.clip(basis @ theta, -30.0, 30.0))
