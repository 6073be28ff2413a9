"""The response of every vertex to any light: the light ratio of relit splats as a linear map of the light.

ratio_c = exposure * (sum_j direct_jc rest_jc + sum_j spread_jc whole_jc + own_c * suns_c) + lamps * steady_c: `rest`
and `whole` are the light's coefficients about +y without and with its suns, `suns` the light of suns on a white
surface, `lamps` the factor on the lamps of a room. `direct` is direct light. `spread` is bounced light and the share of
the whole scene's change: both vary slowly with direction, so suns need no shadows of their own there. In a room all
light but that of suns enters by windows, with any number of bounces; there `direct` also holds bounced light beyond the
bands of `spread`.

Harmonics are about the vertical axis, so that turning the light rotates pairs of coefficients, one line in any engine.
Coefficient i = l (l + 1) + m is that of our basis at the direction (z, x, y) instead of (x, y, z): the polar axis is
+y, the azimuth is the longitude atan2(x, z). m > 0 goes with cos(m longitude), m < 0 with sin(|m| longitude).
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Coefficients, Directions, Floats

from ..albedo.division import DARKEST
from ..sh import harmonics
from ..splats.light_ratio import linear_parts
from ..transfer.bounces import transfer_with_bounces

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..engine.relighter import Relighter
    from ..engine.relit_room import RelitRoom
    from ..transfer.settings import Settings

BANDS, SPREAD_BANDS = 10, 4
"""Bands of direct and of bounced light: on a tabletop, 4 bands leave .2% of the bounced light."""

LAMPS = BANDS**2 + SPREAD_BANDS**2
"""Index of the coefficient of lamps, after those of the environment."""

COEFFICIENTS = LAMPS + 1


POLAR = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
"""The rotation (x, y, z) -> (z, x, y)."""


class Response(NamedTuple):
    """values: (V, COEFFICIENTS, 3) float32, direct, spread, steady. own: (V, 3) float32, light ratio per light on a
    white surface: one over the irradiance of the capture, softened. mean: (SPREAD_BANDS^2 + 1, 3) the light ratio of
    the scene, by light and by lamps.
    """

    values: NDArray[np.float32]
    own: NDArray[np.float32]
    mean: NDArray[np.float64]


def response_of(
    relighter: "Relighter",
    appearance: "Appearance",
    settings: "Settings",
    shares: Floats,
    room: "RelitRoom | None" = None,
) -> Response:
    """The Response of a scene's vertices.

    relighter: Relighter. appearance: its Appearance. settings: Settings with BANDS bands. shares: (V,) areas, the
    weights of vertices in the mean. room: RelitRoom of a closed room whose light was separated, or None.
    """
    captured, before = appearance.captured, appearance.irradiance
    own, usual = linear_parts(captured, before)
    weight = shares / np.maximum(shares @ before, 1e-12)[:, None]  # (3, V): of vertices in the light ratio of the scene
    albedo = np.ones(captured.shape, np.float32) if appearance.albedo is None else appearance.albedo
    bright = np.maximum(albedo, np.float32(DARKEST))  # the divisor of relit splats
    values = np.zeros((len(before), COEFFICIENTS, 3), np.float32)
    mean = np.zeros((SPREAD_BANDS**2 + 1, 3))
    lamps: Floats = np.zeros_like(captured)
    seen: Floats = (albedo / bright).astype(np.float32)
    if room is None or room.lets_in:
        straight = relighter.precomputed.transfer(settings)[0][:, : BANDS**2]
        few = SPREAD_BANDS**2 if room is None else BANDS**2
        if settings.bounce_rays:
            matrix = relighter.precomputed.interreflection(settings.bounce_rays, straight[:, :few])
            sent = transfer_with_bounces(straight[:, :few], albedo, matrix, settings.bounce_tolerance)[0]
        else:
            sent = straight[:, :few, None] * albedo[:, None]
        for j in range(BANDS**2):
            local = straight[:, j, None] * (seen if room is None else albedo)
            if room is not None:
                local = room.changes(local, settings)[0] / bright
            local = own * local
            values[:, j] = local
            if j >= few:
                continue
            whole = sent[:, j] if room is None else np.add(*room.changes(sent[:, j], settings))
            whole = whole / bright
            usually = np.einsum("cv,vc->c", weight, whole, dtype=np.float64)
            whole = own * whole + usual * usually
            if j < SPREAD_BANDS**2:
                mean[j] = usually
                values[:, BANDS**2 + j] = whole - local
            else:
                values[:, j] = whole
        for first, bands in ((0, BANDS), (BANDS**2, SPREAD_BANDS)):
            part = slice(first, first + bands**2)
            about = harmonics.rotation_matrix(POLAR, bands).astype(np.float32)
            values[:, part] = np.einsum("jk,vkc->vjc", about, values[:, part], optimize=True)
        mean[:-1] = harmonics.rotation_matrix(POLAR, SPREAD_BANDS) @ mean[:-1]
    if room is not None:
        lamps = room.lamps(settings) / bright
        mean[-1] = np.einsum("cv,vc->c", weight, lamps, dtype=np.float64)
        values[:, LAMPS] = own * lamps + usual * mean[-1]
        seen = room.changes(albedo, settings)[0] / bright if room.lets_in else np.zeros_like(seen)
    return Response(values, (own * seen).astype(np.float32), mean)


def assumed_response(appearance: "Appearance", shares: Floats, room: "RelitRoom") -> Response:
    """The Response of a room without a known way in for the environment: the coefficient of the mean radiance takes the
    share of the captured light that is assumed to come from outside, and lamps take the rest (`RelitRoom.assumed`).

    appearance, shares, room: as of `response_of`; the exposure of a light is `assumed_exposure`.
    """
    look, before = appearance, np.asarray(appearance.irradiance, np.float64)
    own, usual = linear_parts(look.captured, before)
    weight = shares / np.maximum(shares @ before, 1e-12)[:, None]
    inside = np.full_like(before, 1.0 - room.outside)
    outside = np.full_like(before, room.outside)
    if look.room is not None:
        glowing, shared = look.room.glow.any(axis=1), room.lamp_factor
        several = any(factor != shared for factor in room.lamp_factors)
        if several:  # what all lamps share is a factor beside it
            inside *= _over(room.with_its_own_light(), look.captured)
        inside[glowing], outside[glowing] = 1.0, 0.0
        if any(factor != 1.0 for factor in room.lamp_factors):
            lamps = room.with_its_own_light() if several else look.room.by_lamps + look.room.glow
            inside[glowing] = _over(lamps, look.captured)[glowing]
            outside[glowing] = room.outside * _over(look.room.by_lamps, look.captured)[glowing]
    values = np.zeros((len(before), COEFFICIENTS, 3), np.float32)
    mean = np.zeros((SPREAD_BANDS**2 + 1, 3))
    for place, row, share in ((BANDS**2, 0, outside / np.sqrt(4.0 * np.pi)), (LAMPS, -1, inside)):
        mean[row] = np.einsum("cv,vc->c", weight, before * share)
        values[:, place] = own * before * share + usual * mean[row]
    return Response(values, np.zeros_like(values[:, 0]), mean)


def _over(colors: Floats, captured: Floats) -> Floats:
    """Colours (V, 3) as factors on the captured ones; 1 on black."""
    return np.divide(colors, captured, out=np.ones(captured.shape), where=captured > 0.0)


def light_vector(rest: Coefficients, whole: Coefficients, lamps: float = 0.0) -> NDArray[np.float64]:
    """(COEFFICIENTS, 3) that multiplies the values: coefficients about +y without suns, those with suns, and the factor
    on lamps."""
    return np.concatenate([rest[: BANDS**2], whole[: SPREAD_BANDS**2], np.full((1, 3), lamps)])


def evaluate(directions: Directions, bands: int) -> Floats:
    """Values of the basis about +y, (N, K), in directions (N, 3)."""
    return harmonics.evaluate(np.asarray(directions) @ POLAR.T, bands)


def about_y(coefficients: Coefficients) -> NDArray[np.float64]:
    """Coefficients (..., K, C) about +y of those (..., K, C) in our basis."""
    return harmonics.rotation_matrix(POLAR, harmonics.bands_of(coefficients)) @ coefficients


def turned(coefficients: Coefficients, angle_deg: float) -> NDArray[np.float64]:
    """Coefficients (K, C) about +y of light turned by an active Ry(+angle)."""
    _, order = harmonics.degrees_and_orders(harmonics.bands_of(coefficients))
    angle = order * np.radians(angle_deg)
    mirrored = coefficients[np.arange(len(order)) - 2 * order]
    return np.cos(angle)[:, None] * coefficients - np.sin(angle)[:, None] * mirrored
