"""The light ratio of every vertex, as a gain on display colours, and its application to splat colours.

Splats are blended in sRGB, light is linear. Above its toe the sRGB curve is 1.055 x^(1/2.4) - 0.055, so that light k
times as strong turns a display value c into g (c + 0.055) - 0.055, g = k^(1/2.4): an affine map. It goes through alpha
blending unchanged, even where single Gaussians are darker than black or brighter than white. So apply it to each
Gaussian without a clip, and interpolate its logarithm, the log gain b = log g.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.base.errors import InputError
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import shared
from splat2mesh.scene.color import BLACK, linear_from_srgb, srgb_from_linear
from splat2mesh.splats.splats import SH_C0

from ..albedo.division import SOFTNESS
from ..light.tonemap import SHOULDER_START

CURVE_OFFSET = 0.055
CURVE_POWER = 2.4
"""Of the sRGB curve, IEC 61966-2-1. The toe, below a display value of 0.04, is where the affine map is off: by at most
0.055 (g - 1) for a black that stays black, which the fit in views takes back."""

LEAST, MOST = BLACK, 1.0 / BLACK
"""Range of a light ratio: a display can show no more."""

BURNING = 1.0 - (1.0 - SHOULDER_START) * np.exp(-1.0)
"""Linear value above which the colour of a Gaussian itself is rolled off: to that the light ratio brings what calls for
1, so that nothing is compressed twice."""


class Usual(NamedTuple):
    """Typical values of a scene.

    soft: (3,) float64, the square of an irradiance that is dim in the light of the capture. ratio: (3,) float64, the
    light ratio of the whole scene. gain: (3,), its mean log gain, where it was found.
    """

    soft: Floats
    ratio: Floats
    gain: Floats | None = None

    @classmethod
    def of(cls, before: Radiance, after: Radiance, shares: Floats) -> "Usual":
        """That of irradiances (V, 3) in both lights, vertices weighing `shares`, (V,)."""
        total = shares @ before, shares @ after
        # A colour that the light of the capture lacked has no ratio: it stays as it is.
        ratio = np.divide(total[1], total[0], out=np.ones(3), where=total[0] > 0.0)
        return cls((SOFTNESS * np.median(before, axis=0)) ** 2, ratio)


def log_gain(
    captured: Radiance,  # (V, 3) linear colours as captured
    before: Radiance,  # (V, 3) irradiance in the light of the capture, unit of `captured`
    after: Radiance,  # (V, 3) irradiance in the new light, exposure applied
    shares: Floats | None = None,  # (V,) weights of the vertices in means, such as areas; equal by default
    usual: Usual | None = None,  # Usual of the scene that these vertices are a part of; their own by default
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Log gain of every vertex, (V, 3) float32, and its mean over the scene, (3,). Equal light gives zeros, to the bit.

    The light ratio is (S S' + e^2 r) / (S^2 + e^2), e = 0.1 median(S), r = mean(S') / mean(S). No surface sends out
    more than it receives: what a captured colour has beyond S is gloss or an error of the light, and changes by r.
    What would be shown brighter than 0.8 runs into 1, unless it was that bright before.
    Raises InputError for arrays that do not fit, or hold what is not finite or negative.
    """
    captured, before, after = (_checked(a, n) for a, n in ((captured, "colours"), (before, "before"), (after, "after")))
    if not captured.shape == before.shape == after.shape:
        raise InputError(
            "captured colours and both irradiances must agree in shape, found "
            f"{captured.shape}, {before.shape} and {after.shape}"
        )
    shares = np.ones(len(captured)) if shares is None else np.asarray(shares, np.float64)
    if not shares.sum() > 0.0:
        shares = np.ones(len(captured))
    soft, whole, mean = Usual.of(before, after, shares) if usual is None else usual
    ratio = whole + _own_part(captured, before, soft) * (after - before * whole)
    shown, start = ratio * captured, np.maximum(SHOULDER_START, captured)
    room = np.maximum(1.0 - start, BLACK)  # what was captured white stays white
    rolled = start - room * np.expm1(-np.maximum(shown - start, 0.0) / room)
    ratio = np.where(shown > start, rolled / np.maximum(captured, BLACK), ratio)
    logs = np.log(np.clip(ratio, LEAST, MOST)) / CURVE_POWER
    mean = shares @ logs / shares.sum() if mean is None else mean
    return logs.astype(np.float32), mean.astype(np.float32)


def linear_parts(
    captured: Radiance,  # (V, 3) linear colours as captured
    before: Radiance,  # (V, 3) irradiance in the light of the capture, unit of `captured`
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(own, usual), (V, 3) float64 both: the light ratio of `log_gain`, before its roll-off, is linear in new light.

    ratio = own * after + usual * r, with r = mean(after) / mean(before). Raises InputError as `log_gain` does.
    """
    captured, before = _checked(captured, "colours"), _checked(before, "before")
    own = _own_part(captured, before, (SOFTNESS * np.median(before, axis=0)) ** 2)
    return own, 1.0 - own * before


def relit_sh(
    sh: NDArray[np.float32],  # (N, K, 3) float32 colour coefficients of splats
    logs: NDArray[np.float32],  # (N, 3) log gain of each splat
    mean: NDArray[np.float32],  # (3,) log gain of the whole scene
) -> NDArray[np.float32]:
    """The coefficients in the new light, (N, K, 3) float32: splats whose log gain is 0 keep every bit.

    The diffuse part follows the affine map. The view-dependent part is reflected light: scale it with the light, so
    that no highlight stays lit in a shadow, but by no more than the scene's mean gain, since brightening it in a place
    that was dark amplifies noise.
    """
    result = np.empty_like(sh)
    offset = np.float32((0.5 + CURVE_OFFSET) / SH_C0)
    result[:, 0] = sh[:, 0] + np.expm1(logs) * (sh[:, 0] + offset)
    _scale_rest(len(sh), sh, np.exp(np.minimum(logs, np.maximum(mean, np.float32(0.0)))), result)
    return result


@shared
@kernel
def _scale_rest(begin: int, end: int, sh: Floats, gains: Floats, result: Floats) -> None:
    """All coefficients (N, K, 3) but the constant ones, times the gains (N, 3)."""
    for splat in range(begin, end):
        for k in range(1, sh.shape[1]):
            for color in range(3):
                result[splat, k, color] = sh[splat, k, color] * gains[splat, color]


def without_clipping(
    relit: NDArray[np.float32],  # (N, 3) float32 constant coefficients in the new light
    captured: NDArray[np.float32],  # (N, 3) float32 the same as captured
) -> NDArray[np.float32]:
    """Constant coefficients without clipping colours: (N, 3) float32, the same array if none clips.

    The light ratio rolls off what the mesh shows. A Gaussian that is brighter than the mesh at its place, as a stripe
    of pale wood is, or that the fit made so, would still clip. Its colour runs into 1 from BURNING on, by a hyperbola
    of continuous slope, unless it was that bright in the capture: what light has not brightened keeps its bits.
    """
    shown = np.float32(0.5) + np.float32(SH_C0) * relit
    rows, colors = np.nonzero((shown > srgb_from_linear(np.float32(BURNING))) & (relit > captured))
    if not len(rows):
        return relit
    before = linear_from_srgb(0.5 + SH_C0 * captured[rows, colors].astype(np.float64))
    start = np.maximum(BURNING, before)
    room, over = np.maximum(1.0 - start, BLACK), np.maximum(linear_from_srgb(shown[rows, colors]) - start, 0.0)
    rolled = srgb_from_linear(start + room * over / (room + over))
    result = relit.copy()
    result[rows, colors] = np.where(over > 0.0, (rolled - 0.5) / SH_C0, relit[rows, colors])
    return result


def _own_part(captured: Radiance, before: Radiance, soft: Floats) -> NDArray[np.float64]:
    """What each unit of new light (V, 3) adds to the light ratio there; the rest is the scene's own. It is S / (S^2 +
    e^2) for the share of a captured colour that does not exceed what arrived."""
    below = before * before + soft
    diffuse = np.where(captured > BLACK, np.minimum(before / np.maximum(captured, BLACK), 1.0), 1.0)
    return np.divide(before * diffuse, below, out=np.zeros_like(below), where=below > 0.0)


def _checked(values: ArrayLike, name: str) -> NDArray[np.float64]:
    values = np.asarray(values)
    if values.ndim != 2 or values.shape[1] != 3:
        raise InputError(f"relit splats need {name} of shape (V, 3), found {values.shape}")
    if not (np.isfinite(values).all() and (values >= 0.0).all()):
        raise InputError(f"relit splats need {name} that are finite and not negative, found {values.min()}")
    return values.astype(np.float64)
