"""Albedo from captured colour and irradiance: a division that stays stable where almost no light was received."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.quantiles import weighted_quantile

DARKEST, LIGHTEST = 0.02, 0.95
"""Range of the albedo: soot to fresh snow. Values outside are errors of the light, and above 1 light would grow."""

SOFTNESS = 0.1
"""Share of the median irradiance below which the usual albedo weighs more than the division."""


class Prior(NamedTuple):
    """The regulariser of the division where little light arrives. albedo, irradiance: (3,) float32, by colour.

    albedo: that of a surface that received nothing. irradiance: where both weigh the same.
    """

    albedo: NDArray[np.float32]
    irradiance: NDArray[np.float32]


def albedo_of(
    captured: ArrayLike,  # (N, 3) linear exit radiance
    irradiance: ArrayLike,  # (N, 3) what white would send out, same unit, not negative
    prior: Prior | None = None,  # Prior of the scene, such as that of an Estimate; by default that of these very arrays
) -> NDArray[np.float32]:
    """Albedo (N, 3) float32 in [0.02, 0.95]: (C S + e^2 A0) / (S^2 + e^2), clipped.

    That is the least square of C - a S + noise with a Gaussian prior of mean A0: C / S where S is well above e, A0
    where S is well below. A row depends on its own values and the prior alone. Non-finite values count as 0.
    Raises InputError for arrays that do not fit and for a prior that is not positive.
    """
    captured, irradiance = checked(captured, "captured colours"), checked(irradiance, "irradiance")
    if captured.shape != irradiance.shape:
        raise InputError(
            f"captured colours and irradiance must agree in shape, found {captured.shape} and {irradiance.shape}"
        )
    prior = prior_of(captured, irradiance) if prior is None else prior
    usual, soft = (np.asarray(part, np.float32) for part in prior)
    if usual.shape != (3,) or soft.shape != (3,) or not ((usual > 0).all() and (soft > 0).all()):
        raise InputError(f"a prior needs an albedo and an irradiance above 0 in three colours, found {prior}")
    # Divided by e first: neither float32's range nor the unit of the light matters then.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        received, sent = irradiance / soft, captured / soft
        albedo = (sent * received + usual) / (received * received + np.float32(1.0))
        overflow = ~np.isfinite(albedo)
        albedo[overflow] = (captured / irradiance)[overflow]
    return np.clip(np.nan_to_num(albedo, nan=0.0), np.float32(DARKEST), np.float32(LIGHTEST), dtype=np.float32)


def prior_of(captured: ArrayLike, irradiance: ArrayLike, shares: ArrayLike | None = None) -> Prior:
    """The Prior of a scene: the median of C / S where S is not small, and SOFTNESS times the median of S.

    shares: (N,) weights of the rows, such as areas; equal by default. Black without data.
    """
    captured, irradiance = checked(captured, "captured colours"), checked(irradiance, "irradiance")
    shares = np.ones(len(captured)) if shares is None else np.asarray(shares, np.float64)
    usual, soft = np.full(3, DARKEST, np.float32), np.ones(3, np.float32)
    for color in range(3):
        sent, received = captured[:, color].astype(np.float64), irradiance[:, color].astype(np.float64)
        lit = (received > 0.0) & (shares > 0.0)
        if not lit.any():
            continue
        middle = weighted_quantile(received[lit], shares[lit])
        soft[color] = max(SOFTNESS * middle, float(np.finfo(np.float32).tiny))
        clear = lit & (received >= soft[color])
        ratio = weighted_quantile(sent[clear] / received[clear], shares[clear])
        usual[color] = np.clip(ratio, DARKEST, LIGHTEST)
    return Prior(usual, soft)


def checked(colors: ArrayLike, name: str) -> NDArray[np.float32]:
    """(N, 3) float32; non-finite and negative values become 0. Raises InputError for another shape."""
    colors = np.asarray(colors)
    if colors.ndim != 2 or colors.shape[1] != 3:
        raise InputError(f"{name} must have shape (N, 3), found {colors.shape}")
    with np.errstate(over="ignore"):
        colors = colors.astype(np.float32)
    valid = np.isfinite(colors) & (colors > 0.0)
    return colors if valid.all() else np.where(valid, colors, np.float32(0.0))
