"""Predict the cost of settings and the noise of their rays, by laws with measured constants.

Times are multiples of the time of one shadow ray, which the sample measures, so they carry over to other machines as
far as the ratio of NumPy to Embree does. `scripts/bench frontier` prints predicted against measured times.
"""

import math

from ..transfer import consensus
from ..transfer.bounce_blend import STRATIFIED
from ..transfer.filtering import NOISE, NOISE_POWER, steps_for
from ..transfer.settings import Settings

# Of a vertex, in shadow rays.
RAY = 1.0  # that is traced, for shadows or for bounces
DIRECTION = 0.1  # of each ray, traced or predicted: its direction, and its sums in few bands
RAY_COEFFICIENT = 0.0016  # per ray and coefficient, in the sums
VERTEX = 9.0  # neighbours, and what is done once
COEFFICIENT = 0.24  # averaging and completing, per coefficient
CALLS = 1.5e5  # in all: threads that wake, and what is done once whatever the settings
LIGHT_COEFFICIENT = 4.5e3  # in all, per coefficient: the light's harmonics, .05 s in 8 bands
SUN_RAY = RAY / 2.0  # per sun: half of them stand before a vertex
BOUNCE = 0.02  # per bounce ray and bounce
FOLLOWED = 4  # bounces that matter: in a garden four darken the shadow of an object by a tenth

RAYS = tuple(2**power for power in range(2, 12))
"""Rays per vertex to choose from: 4 to 2,048."""

BOUNCE_RAYS = RAYS[1:8]
"""Rays per vertex that gather bounced light or the half-shadows of lamps, to choose from: 8 to 512."""

BOUNCE_NOISE, BOUNCE_POWER = 0.275, -(1.0 + STRATIFIED[1]) / 2.0
"""Error of bounced light by rays per vertex, a law, over all light and the root of the share that bounced: the fewer
rays meet anything, the noisier. It falls as stratified rays let it. Through the middle of .068 of 8 to .0054 of
512: upper end of three scenes with shares of .06 to .15, without the average over rings (a corner with .33 has two
thirds), times what that leaves of it on a patio and in a parlour; on objects it leaves less. `bounce_check` finds what
it is."""


def bounce_error(rays: int, share: float) -> float:
    """Error, over all light, of bouncing a share of it by so many rays per vertex; without rays it is missing."""
    return min(share, bounce_noise(rays) * share**0.5) if rays else share


def bounce_noise(rays: int) -> float:
    """The law for so many rays."""
    return float(BOUNCE_NOISE * rays**BOUNCE_POWER)


def seconds(
    settings: Settings,
    vertices: int,
    shadowed_vertices: int,
    ray_s: float,
    suns: int,
    traced_share: float = 1.0,
    there: tuple[bool, bool] = (False, False),
    unsure: float = 1.0,
) -> tuple[float, float]:
    """(once, each): seconds for the scene, and for every light or angle; suns are found by then.

    traced_share: of the vertices, that light is traced for. there: whether transfer and bounces are there already.
    unsure: share of the rays that are traced, where neighbours do not agree on the others.
    """
    coefficients, traced = settings.bands**2, traced_share * vertices
    rays, once = shadowed_vertices * settings.rays, CALLS + LIGHT_COEFFICIENT * settings.bands**2
    if settings.rays and not there[0]:
        shot = RAY * (unsure if consensus.worth(settings.rays, shadowed_vertices) else 1.0)
        once += rays * (shot + DIRECTION + RAY_COEFFICIENT * coefficients)
        once += (VERTEX + COEFFICIENT * coefficients) * vertices
    if not there[1]:
        once += RAY * settings.bounce_rays * traced
    each = SUN_RAY * suns * traced + BOUNCE * settings.bounce_rays * FOLLOWED * traced
    return once * ray_s, each * ray_s


def noise(rays: int, bands: int) -> float:
    """Standard deviation of one coefficient for a vertex that sees half of the sky in patches: times sqrt(f (1 - f)).

    The law of `filtering` for single vertices, and what averaging over neighbours leaves of it, which was fitted to
    five meshes (scripts/bench rays): .38 with 8 rays, all of it with a thousand. Where neighbours predict some
    of the rays there is up to a tenth more of it (`scripts/bench rays --spare`), which the check finds.
    """
    left = min(max(0.19 * rays**0.31 * (3.0 / bands) ** 0.17, 0.38), 1.0) if steps_for(rays, bands) else 1.0
    return math.sqrt(NOISE * rays**NOISE_POWER) * left
