"""Transfer in twelve numbers a vertex, for any light: nine grey coefficients of three bands, and a tint.

A shader of any engine holds it in three vec4. Exit radiance c = albedo_c * tint_c * sum over j of grey_j L_jc.
"""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import BLACK

from ..albedo.captured import BOUNCE_RAYS, RAYS
from ..options import LightingOptions
from ..transfer import FEW_BANDS
from ..transfer.bounces import Interreflection, transfer_with_bounces
from ..transfer.settings import BOUNCES, SHADOWS, Settings
from .relighter import Relighter


def nine_coefficients(
    relighter: Relighter,
    albedo: NDArray[np.float32] | None,  # (V, 3) linear, None for white
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Grey coefficients (V, 9) and tint (V, 3) of every vertex, bounces included: see `nine_and_tint`.

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
        return Settings("analytic" if method == "raytraced" else method, FEW_BANDS)
    return Settings(method, FEW_BANDS, options.rays or RAYS, bounce_rays=BOUNCE_RAYS if BOUNCES in effects else 0)


def with_received(
    transfer: NDArray[np.float32],  # (V, K) of the white scene, K >= 9
    albedo: NDArray[np.float32] | None,  # (V, 3) linear; white without
    interreflection: Interreflection | None = None,  # for bounces
) -> NDArray[np.float32]:
    """The light that every vertex receives from each of nine coefficients, with bounces, (V, 9, 3) float32.

    Exit radiance is this times the albedo; it holds that of other vertices only.
    """
    transfer = np.ascontiguousarray(np.asarray(transfer, np.float32)[:, : FEW_BANDS**2])
    received = np.repeat(transfer[:, :, None], 3, axis=2)
    if interreflection is None or albedo is None:
        return received
    sent, _ = transfer_with_bounces(transfer, albedo, interreflection)
    return received + interreflection.bounce(sent.reshape(len(sent), -1)).reshape(sent.shape)


def nine_and_tint(
    received: NDArray[np.float32],  # (V, 9, 3)
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Grey coefficients (V, 9) and tint (V, 3) in [0, 1], its largest channel 1, float32.

    The tint is the colour of the light that a constant sky sends, so that under one the result is exact; the grey
    coefficients are then the nearest in the sense of least squares. All lie within +-0.64: no vertex receives more
    than 1 under a sky of radiance 1, so |T_j| <= max |Y_j|, of three bands at most sqrt(5 / pi) / 2 = 0.631.
    """
    received = np.asarray(received, np.float64)
    sky = np.maximum(received[:, 0], 0.0)
    largest = sky.max(axis=1, keepdims=True)
    tint = np.where(largest > BLACK, sky / np.maximum(largest, BLACK), 1.0)
    grey = np.einsum("vjc,vc->vj", received, tint) / np.square(tint).sum(axis=1)[:, None]
    return grey.astype(np.float32), tint.astype(np.float32)
