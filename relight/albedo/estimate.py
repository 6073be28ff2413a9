"""The light that a scene was captured in and the albedo of its surfaces, both from the captured colours.

C = a S, S = D(light) + B C: what a surface receives from others is what they were seen to send, so that only the
light from outside is unknown. Unit: that of C; the albedo's absolute scale is a prior's.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.progress import Advance
from splat2mesh.scene.color import luminance

from ..light import projections
from ..light.environment import Environment
from ..sh import harmonics
from ..transfer.occluder import Occluder
from ..transfer.transport import Transport
from . import fit, natural, skylight, sun
from .captured import HEIGHT, WIDTH, CapturedScene, CaptureEvidence, Estimate
from .division import Prior, albedo_of
from .reflected import guided
from .rims import evened
from .tint import balanced
from .under_sky import beside_alone, light_under_sky

LIGHT_BANDS = 5
"""Of the logarithm of the light. Albedo error by bands 3 to 7: on a trained object .18 .15 .14 .14 .14, on
fourteen scenes .18 .16 .155 .156 .156. Beyond 5, light from where nothing looks becomes erratic."""

MIN_EVIDENCE = 0.5
"""Below it the light is not separated from the albedo. Objects and scenes have .86 to .99, discs, spheres and cubes .71
to .88, rolling ground and three walls that meet .2 to .3, two walls .15, planes 0."""


_BRIGHT_DIPOLE = np.zeros((3 * LIGHT_BANDS**2, 3))
"""Which way the light comes from, in brightness alone: coefficients 1 to 3, all colours alike."""
for _color in range(3):
    _BRIGHT_DIPOLE[_color * LIGHT_BANDS**2 + np.arange(1, 4), np.arange(3)] = 1.0 / math.sqrt(3.0)


def estimate(
    occluder: Occluder,
    captured: ArrayLike,  # (V, 3) linear exit radiance as captured, any unit
    seed: int = 0,
    advance: Advance = lambda count: None,  # called with the number of vertices done, twice for each
    transport: Transport | None = None,  # existing results for the white scene
    evidence: CaptureEvidence | None = None,  # facts of the capture beside its colours
) -> Estimate:
    """Estimate albedo and light of a scene captured in unknown light.

    The unclipped part of a captured sky counts as measured, the clipped part as at least 1; if views from inside exist,
    the contrast of colours determines the excess. If little of the sky and no sun is visible, the light is the mean of
    the estimates with the sky and from the scene alone. Deterministic; the order of vertices and chunks affects only
    the last bits. Non-finite colours count as black. Raises InputError unless `captured` is (V, 3).
    """
    given = evidence or CaptureEvidence()
    scene, sky, volume = CapturedScene(occluder, captured, seed, advance, transport, given), given.sky, given.volume
    problem = given.hopeless or scene.problem()
    if problem:
        return scene.as_captured(problem)
    if sky is not None and scene.under_sky:
        seen, lit = skylight.visible_part(sky), light_under_sky(scene, sky, volume)
        if lit is None or not lit.sure:
            alone = estimate(occluder, captured, seed, advance, scene.transport)
            if lit is None or not alone.separable:
                return alone
            lit = beside_alone(scene, lit, alone.environment)
        light_of_day = lit.environment if given.looks is None else balanced(scene, sky, lit.environment, volume)
        result = scene.result(light_of_day, seen, brighter=False)
        result = result._replace(under_sky=True, ambiguity=lit.ambiguity)
        return evened(scene, result, volume) if lit.edged else result
    basis = harmonics.evaluate(scene.places.directions, LIGHT_BANDS)
    light = fit.SmoothLight(scene.places.sky, basis, scene.bounced())
    start = np.zeros((LIGHT_BANDS**2, 3))
    start[0] = np.log(scene.start(natural_light=True)) / fit.UNIT
    prior = fit.prior_of(LIGHT_BANDS, natural.PRECISION)
    shown = None if given.reflected is None else guided(scene, light, start, given.reflected)
    if shown is not None:
        found, prior, start = shown
    else:
        found = scene.fitted(light, start, prior)
    decided = fit.evidence(found, prior, _BRIGHT_DIPOLE)
    if decided < MIN_EVIDENCE:
        return scene.as_captured("its surfaces face too few directions to separate light from colour", decided)
    sunless = sun.SunlessLight(light, start, prior, found)
    theta, lamp = sun.with_sun(occluder, scene.places, scene.log_captured(), sunless)
    return scene.result(Environment(_image(theta, lamp), "estimated"), decided)


def with_known_light(
    occluder: Occluder,
    captured: ArrayLike,
    environment: Environment,
    seed: int = 0,
    advance: Advance = lambda count: None,
    transport: Transport | None = None,
    evidence: CaptureEvidence | None = None,
) -> Estimate:
    """Albedo of a scene captured under a known Environment, whose exposure in each colour is found: an Estimate.

    Where a captured sky shows enough of that light, it determines the exposure. Arguments and errors as of `estimate`.
    """
    given = evidence or CaptureEvidence()
    scene = CapturedScene(occluder, captured, seed, advance, transport, given)
    problem = scene.problem()
    direct = scene.direct(environment)
    received = direct[scene.places.vertices]
    if not problem and not (np.median(received, axis=0) > 0.0).all():
        problem = f"the light {environment.name} does not reach it in all three colours"
    if problem:
        return scene.as_captured(problem)
    known = given.sky if scene.under_sky else None
    measured = None if known is None else skylight.exposure_of(known, environment)
    if known is not None and measured is not None:
        measured = scene.usual(measured, luminance(received))
        shown = Environment(environment.radiance * measured, environment.name, environment.rotation_deg)
        result = scene.result(shown, skylight.visible_part(known), direct * measured, brighter=False)
        return result._replace(under_sky=True)
    light = fit.KnownLight(received, scene.bounced(), fit.UNIT)
    start = np.log(scene.start() / np.median(received, axis=0))[None] / fit.UNIT
    prior = fit.prior_of(1)
    found = scene.fitted(light, start, prior)
    gain = np.exp(fit.UNIT * found.theta[0])
    scaled = Environment(environment.radiance * gain.astype(np.float32), environment.name, environment.rotation_deg)
    decided = fit.evidence(found, prior, np.full((3, 1), 1.0 / math.sqrt(3.0)))
    return scene.result(scaled, decided, direct * gain.astype(np.float32))


def under_light(
    occluder: Occluder,
    captured: ArrayLike,
    environment: Environment,
    prior: Prior | None,
    seed: int = 0,
    transport: Transport | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Albedo and irradiance, (V, 3) float32 each, of part of a scene whose light and Prior were estimated before.

    environment: that of an Estimate, which is in the unit of the captured colours. Other arguments as of `estimate`.
    """
    scene = CapturedScene(occluder, captured, seed, lambda count: None, transport)
    irradiance = scene.direct(environment) + scene.bounce
    return albedo_of(scene.captured, irradiance, prior), irradiance


def _image(theta: NDArray[np.float64], lamp: sun.Sun | None = None) -> NDArray[np.float32]:
    """(H, W, 3) float32 radiance of the logarithm's coefficients (K, 3), and of a Sun beside it."""
    directions = projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3)
    exponent = harmonics.evaluate(directions, math.isqrt(len(theta))) @ theta
    radiance = np.exp(np.clip(exponent, -30.0, 30.0)).reshape(HEIGHT, WIDTH, 3)
    return (radiance if lamp is None else radiance + sun.image_of(lamp, HEIGHT, WIDTH)).astype(np.float32)
