"""What the light of every vertex becomes under any light: the light ratio of relit splats as a linear map of the light.

ratio_c = exposure * (sum_j direct_jc rest_jc + sum_j spread_jc whole_jc + own_c * suns_c): `rest` and `whole` are the
light's coefficients about +y without and with its suns, `suns` what they bring onto a white surface. `direct` is light
that arrives straight, `spread` what other surfaces pass on and the share that the whole scene's change has: both vary
slowly with direction, so that suns need no shadows of their own there.
"""

from typing import NamedTuple

import numpy as np

from ..engine.appearance import LEAST_ALBEDO
from ..sh import harmonics
from ..splats.light_ratio import linear_parts
from ..transfer.bounces import transfer_with_bounces
from .harmonics import POLAR

BANDS, SPREAD_BANDS = 10, 4
"""Bands of light that arrives straight and of light passed on: of what bounces on a tabletop 4 bands leave .2%."""

COEFFICIENTS = BANDS**2 + SPREAD_BANDS**2


class Response(NamedTuple):
    """values: (V, COEFFICIENTS, 3) float32, direct then spread. own: (V, 3) float32, light ratio per light on a white
    surface: one over the irradiance of the capture, softened. mean: (SPREAD_BANDS^2, 3) the light ratio of the scene.
    """

    values: np.ndarray
    own: np.ndarray
    mean: np.ndarray


def response_of(relighter, appearance, settings, shares):
    """The Response of a scene's vertices.

    relighter: Relighter. appearance: its Appearance. settings: Settings with BANDS bands. shares: (V,) areas, the
    weights of vertices in the mean.
    """
    straight = relighter.precomputed.transfer(settings)[0][:, : BANDS**2]
    captured, before = appearance.captured, appearance.irradiance
    own, usual = linear_parts(captured, before)
    if appearance.trust is not None:  # as `drawn_to_none`, of which this is the linear part
        trust = appearance.trust[:, None].astype(np.float64)
        own, usual = own * trust, usual * trust + 1.0 - trust
    albedo = appearance.albedo
    albedo = np.ones(captured.shape, np.float32) if albedo is None else albedo
    few = SPREAD_BANDS**2
    received = np.repeat(straight[:, :few, None], 3, axis=2)
    seen = albedo / np.maximum(albedo, np.float32(LEAST_ALBEDO))  # darker surfaces are divided by that, as relit splats
    received *= seen[:, None]
    passed_on = np.zeros_like(received)
    if settings.bounce_rays:
        matrix = relighter.precomputed.interreflection(settings.bounce_rays, straight)
        total, _ = transfer_with_bounces(straight[:, :few], albedo, matrix, settings.bounce_tolerance)
        total /= np.maximum(albedo, np.float32(LEAST_ALBEDO))[:, None]
        passed_on, received = total - received, total
    mean = np.einsum("v,vkc->kc", shares, received, dtype=np.float64) / np.maximum(shares @ before, 1e-12)
    passed_on *= own[:, None].astype(np.float32)
    passed_on += (usual[:, None] * mean).astype(np.float32)
    values = np.zeros((len(before), COEFFICIENTS, 3), np.float32)
    own = (own * seen).astype(np.float32)
    about = harmonics.rotation_matrix(POLAR, BANDS).astype(np.float32)
    values[:, : BANDS**2] = (straight @ about.T)[:, :, None] * own[:, None]
    about = harmonics.rotation_matrix(POLAR, SPREAD_BANDS).astype(np.float32)
    values[:, BANDS**2 :] = np.einsum("jk,vkc->vjc", about, passed_on)
    return Response(values, own, harmonics.rotation_matrix(POLAR, SPREAD_BANDS) @ mean)


def light_vector(rest, whole):
    """(COEFFICIENTS, 3) that the values are multiplied with: coefficients about +y without suns, and with them."""
    return np.concatenate([rest[: BANDS**2], whole[: SPREAD_BANDS**2]])
