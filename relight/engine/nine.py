"""The transfer that shaders of other programs can hold: for any light, so it is not planned for one."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError

from ..options import LightingOptions
from ..transfer.nine import nine_and_tint, with_received
from ..transfer.settings import BOUNCES, SHADOWS, Settings
from .relighter import Relighter

BANDS = 3

RAYS, BOUNCE_RAYS = 64, 32
"""Settings of the estimate of the captured light, whose traced results serve here."""


def nine_coefficients(
    relighter: Relighter,
    albedo: NDArray[np.float32] | None,  # (V, 3) linear, None for white
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Grey coefficients (V, 9) and tint (V, 3) of every vertex, bounces included: see `transfer.nine.nine_and_tint`.

    Raises InputError for a method that has no transfer.
    """
    settings = _settings(relighter.options)
    if not settings.bounce_rays or albedo is None:
        transfer, _ = relighter.precomputed.transfer(settings)
        return nine_and_tint(with_received(transfer, None))
    known = relighter.transport(settings)
    return nine_and_tint(with_received(known.transfer, albedo, known.interreflection))


def _settings(options: LightingOptions) -> Settings:
    method, effects = options.fixed_method or "raytraced", options.chosen_effects
    if method == "blinn-phong":
        raise InputError("`live`: the method blinn-phong has no transfer; leave it at auto")
    if SHADOWS not in effects:
        return Settings("analytic" if method == "raytraced" else method, BANDS)
    return Settings(method, BANDS, options.rays or RAYS, bounce_rays=BOUNCE_RAYS if BOUNCES in effects else 0)
