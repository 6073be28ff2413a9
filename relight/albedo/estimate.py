"""The light that a scene was captured in and the albedo of its surfaces, both from the captured colours.

C = a S, S = D(light) + B C: what a surface receives from others is what they were seen to send, so that only the
light from outside is unknown. Unit: that of C; the albedo's absolute scale is a prior's.
"""

import math
import warnings
from typing import NamedTuple

import numpy as np

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.color import luminance

from ..light import projections
from ..light.environment import Environment
from ..sh import harmonics
from . import contrast, fit, samples, skylight, sun
from .direct import direct_light
from .division import LIGHTEST, Prior, albedo_of, checked, prior_of, weighted_median, weighted_quantile
from .seen import looks_over

LIGHT_BANDS = 5
"""Of the logarithm of the light. Albedo error by bands 3 to 7: on a trained object .18 .15 .14 .14 .14, on
fourteen scenes .18 .16 .155 .156 .156. Beyond 5, light from where nothing looks becomes erratic."""

BANDS, RAYS, BOUNCE_RAYS = 8, 64, 32
"""Of the transfer and the bounces where none are given; half the rays that relight takes by default."""

USUAL_ALBEDO = 0.4
"""Median albedo, in luminance, where nothing says more."""

BRIGHTNESS, COLOR = 2.0, 0.25
"""Spread of the light's log brightness and log colour in the prior. Scenes in lights of strong colour like 0.4 better
(error with one gain .17 against .20 at 0.1), but the whites of a real capture turned to cyan with it."""

CONTRAST_COLOR = 3.0
"""How much stiffer the prior is for changes of the light's colour with direction than for those of its brightness."""

LIGHT_PART, BRIGHTER_ROUNDS = 0.97, 4
"""Part of the places that must not be lighter than the lightest surface, and rounds in which light is added for that:
a scene of dark surfaces and a few light ones has no median of 0.4."""

MIN_EVIDENCE = 0.5
"""Below it the light is not told apart from the albedo. Objects and scenes have .86 to .99, discs, spheres and
cubes .71 to .88, rolling ground and three walls that meet .2 to .3, two walls .15, planes 0."""

MIN_PLACES = 64
"""Fewer are too few for the numbers of a light."""

SATURATED = 0.99
"""Linear colour from which a byte may have been clipped: its true value is not known."""

DARK = 0.002
"""Linear colour of little meaning: below the seventh step of an sRGB byte."""

HEIGHT, WIDTH = 128, 256
"""Of the estimated light's image: texels of 1.4 degrees hold the narrowest sun."""


_UNIT = 1.0 / math.sqrt(4.0 * math.pi)  # log radiance of the first coefficient

_BRIGHT_DIPOLE = np.zeros((3 * LIGHT_BANDS**2, 3))
"""Which way the light comes from, in brightness alone: coefficients 1 to 3, all colours alike."""
for _color in range(3):
    _BRIGHT_DIPOLE[_color * LIGHT_BANDS**2 + np.arange(1, 4), np.arange(3)] = 1.0 / math.sqrt(3.0)


class Estimate(NamedTuple):
    """Albedo and capture light of a scene of V vertices.

    albedo: (V, 3) float32 in [0.02, 0.95]. irradiance: (V, 3) float32, S in C = a S, in the unit of the captured
    colours. environment: the capture light, scene frame, in that unit, so that relighting by it gives back C.
    prior: of `albedo_of`, for other colours of the scene. separable: whether the light was told apart; if not,
    `reason` says why, the albedo is the captured colour and the light uniform. evidence: in [0, 1], how far the
    scene, not the prior, decides which way the light comes from (of a known light: how bright it was).
    direction: (3,) unit, the mean of direction times luminance over the sphere, and its length
    concentration in [0, 1]: 0 uniform, 1 a single point. color: (3,) mean radiance of the light over its luminance.
    brightness: mean luminance of the light. under_sky: whether a captured sky was used.
    """

    albedo: np.ndarray
    irradiance: np.ndarray
    environment: Environment
    prior: Prior
    evidence: float
    separable: bool
    reason: str
    direction: np.ndarray
    concentration: float
    color: np.ndarray
    brightness: float
    under_sky: bool = False


def estimate(
    occluder,  # Occluder
    captured,  # (V, 3) linear exit radiance as captured, any unit
    seed=0,
    advance=lambda count: None,  # called with the number of vertices done, twice for each
    transfer=None,  # (V, K) of the white scene, where there is one already
    interreflection=None,  # Interreflection, likewise
    sky=None,  # CapturedSky, where the capture saw its light
    hopeless="",  # why the light cannot be told, where that is known
    looks=None,  # Looks from where the capture stood: then it is what they show that counts, not area
    volume=None,  # (V,) in [0, 1], how far each vertex is of leaves or grass
    sunlit=None,  # Suns -> their light on the white scene, as `direct_light` takes it
):
    """Albedo and light of a scene captured in unknown light: an Estimate.

    Of a captured sky, what was not clipped is taken as it is, and what was is at least 1; where it was looked at from
    within, the contrast of colours tells how much more. Deterministic; depends on no
    order of vertices or chunks but in the last bits. Colours that are not finite count as black. Raises InputError
    unless `captured` is (V, 3).
    """
    scene = _Scene(occluder, captured, seed, advance, transfer, interreflection, sky is not None, looks, sunlit)
    problem = hopeless or scene.problem()
    if problem:
        return scene.as_captured(problem)
    if scene.under_sky:
        found = _under_sky(scene, sky, volume)
        if found is None:
            return estimate(occluder, captured, seed, advance, scene.transfer, scene.interreflection, sunlit=sunlit)
        return found._replace(under_sky=True)
    basis = harmonics.evaluate(scene.places.directions, LIGHT_BANDS)
    light = fit.SmoothLight(scene.places.sky, basis, scene.bounced())
    start = np.zeros((LIGHT_BANDS**2, 3))
    start[0] = np.log(scene.start()) / _UNIT
    prior = _prior(LIGHT_BANDS)
    found = scene.fitted(light, start, prior)
    evidence = fit.evidence(found, prior, _BRIGHT_DIPOLE)
    if evidence < MIN_EVIDENCE:
        return scene.as_captured("its surfaces face too few ways to tell its light from its colours", evidence)
    theta, lamp = sun.with_sun(occluder, scene.places, light, scene.log_captured(), found, start, prior)
    return scene.result(Environment(_image(theta, lamp), "estimated"), evidence)


def _under_sky(scene, sky, volume=None):
    """The Estimate of a _Scene that was captured under a CapturedSky; None where that shows little, nobody stood
    within, and no sun is told by its shadows. volume: as in `estimate`."""
    places, told, sky = scene.places, skylight.told_by_sky(sky), skylight.unmixed(sky)
    parts = skylight.SkyParts.at(sky, places.directions)
    light = skylight.SkyLight(places.sky, parts, places.directions, scene.bounced())
    colors = scene.captured[places.vertices].astype(np.float64)
    begin = light, parts, places.directions, colors, scene.start()
    start = skylight.start_of(*begin)
    within, little = scene.looks is not None, told < skylight.LITTLE_TOLD
    patches = scene.patches(volume) if within or little else None
    if patches is not None:
        environment, sunny = _by_contrast(patches, sky, parts, start, places)
        return scene.result(environment, told, brighter=False) if within or sunny else None
    if little:
        return None
    prior = skylight.prior_of(_prior)
    found = scene.fitted(light, start, prior)

    def radiance(directions, theta):
        return skylight.radiance(skylight.SkyParts.looked_up(sky, directions), theta, directions)

    theta, lamp = sun.with_sun(
        *(scene.occluder, places, light, scene.log_captured(), found, start, prior),
        least_gain=skylight.LEAST_SUN_GAIN,
        brightness=lambda directions: luminance(radiance(directions, found.theta)[1]),
    )
    known, free = radiance(projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3), theta)
    image = (known + free).reshape(HEIGHT, WIDTH, 3)
    if lamp is not None:
        image += _sun_image(lamp)
    return scene.result(Environment(image.astype(np.float32), "estimated"), told, brighter=False)


def _by_contrast(patches, sky, parts, start, places):
    """The Environment of what a CapturedSky binds, and beyond it of what the contrast of Patches tells; and whether
    that is a sun."""
    directions = places.directions
    bound = luminance(skylight.without_excess(parts, start, directions))
    above = directions[:, 1] > 0.0
    unseen = np.where(above, parts.unseen.mean(axis=1), 0.0)
    found = contrast.brightness_of(patches, directions, bound, parts.clipped.mean(axis=1), unseen)
    texels = projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3)
    parts = skylight.SkyParts.looked_up(sky, texels)
    image = skylight.without_excess(parts, start, texels)
    region = parts.clipped + (parts.unseen * (texels[:, 1:2] > 0.0) if found.beyond else 0.0)
    image += region * found.excess * np.exp(texels @ found.lean)[:, None]
    image = image.reshape(HEIGHT, WIDTH, 3)
    if found.sun is not None:
        image += _sun_image(sun.Sun(found.sun, contrast.SUN_WIDTH_DEG, None, np.full(3, found.irradiance)))
    return Environment(image.astype(np.float32), "estimated"), found.sun is not None


def with_known_light(
    occluder,
    captured,
    environment,
    seed=0,
    advance=lambda count: None,
    transfer=None,
    interreflection=None,
    sky=None,
    looks=None,
    sunlit=None,
):
    """Albedo of a scene captured under a known Environment, whose exposure in each colour is found: an Estimate.

    Where a captured sky shows enough of that light, it tells the exposure. Arguments and errors as of `estimate`.
    """
    scene = _Scene(occluder, captured, seed, advance, transfer, interreflection, sky is not None, looks, sunlit)
    problem = scene.problem()
    direct = scene.direct(environment)
    received = direct[scene.places.vertices]
    if not problem and not (np.median(received, axis=0) > 0.0).all():
        problem = f"the light {environment.name} does not reach it in all three colours"
    if problem:
        return scene.as_captured(problem)
    measured = skylight.exposure_of(sky, environment) if scene.under_sky else None
    if measured is not None:
        measured = scene.usual(measured, luminance(received))
        shown = Environment(environment.radiance * measured, environment.name, environment.rotation_deg)
        result = scene.result(shown, skylight.told_by_sky(sky), direct * measured, brighter=False)
        return result._replace(under_sky=True)
    light = fit.KnownLight(received, scene.bounced(), _UNIT)
    start = np.log(scene.start() / np.median(received, axis=0))[None] / _UNIT
    prior = _prior(1)
    found = scene.fitted(light, start, prior)
    gain = np.exp(_UNIT * found.theta[0])
    scaled = Environment(environment.radiance * gain.astype(np.float32), environment.name, environment.rotation_deg)
    evidence = fit.evidence(found, prior, np.full((3, 1), 1.0 / math.sqrt(3.0)))
    return scene.result(scaled, evidence, direct * gain.astype(np.float32))


def under_light(occluder, captured, environment, prior, seed=0, transfer=None, interreflection=None, sunlit=None):
    """Albedo and irradiance, (V, 3) float32 each, of part of a scene whose light and Prior were told before.

    environment: that of an Estimate, which is in the unit of the captured colours. Other arguments as of `estimate`.
    """
    scene = _Scene(occluder, captured, seed, lambda count: None, transfer, interreflection, sunlit=sunlit)
    irradiance = scene.direct(environment) + scene.bounce
    return albedo_of(scene.captured, irradiance, prior), irradiance


class _Scene:
    """What both ways share: the places, the light that surfaces send each other, and the result.

    areas: (V,) what each vertex counts: its area, or how large it was seen.
    """

    def __init__(
        self, occluder, captured, seed, advance, transfer, interreflection, sky=False, looks=None, sunlit=None
    ):
        from ..transfer.bounces import Interreflection, visible_fraction
        from ..transfer.raytraced import raytraced_scene

        self.occluder, self.seed, self._advance, self._sunlit = occluder, seed, advance, sunlit
        count = len(occluder.origins)
        captured = np.asarray(captured)
        self.captured = checked(captured, "captured colours")
        if len(self.captured) != count:
            raise InputError(f"captured colours must be ({count}, 3), one for each vertex, found {captured.shape}")
        bad = int((~np.isfinite(captured)).any(axis=1).sum())
        if bad:
            warnings.warn(
                f"{bad} of {count} captured colours are not finite: taken as black", DataWarning, stacklevel=4
            )
        self.transfer = raytraced_scene(occluder, BANDS, RAYS, seed, advance) if transfer is None else transfer
        if interreflection is None:
            visible = visible_fraction(self.transfer)
            interreflection = Interreflection(occluder, BOUNCE_RAYS, seed, visible, advance)
        self.interreflection = interreflection
        self.bounce = interreflection.bounce(self.captured)
        self.looks = looks
        self.areas = samples.vertex_areas(occluder) if looks is None else looks.sizes(count)
        peak = self.captured.max(axis=1)
        self.usable = (self.captured.min(axis=1) > DARK) & (peak < SATURATED)
        visible = visible_fraction(self.transfer)
        open_part = float((self.areas * visible).sum() / max(float(self.areas.sum()), 1e-30))
        self.under_sky = sky and open_part > skylight.LEAST_OPEN
        wanted = self.usable & (visible > samples.MIN_VISIBLE)
        if self.under_sky:
            flat = wanted & (samples.roughness(occluder) < samples.MAX_ROUGHNESS)
            wanted = flat if np.count_nonzero(flat) >= samples.SAMPLES else wanted
        self.places = samples.take(occluder, self.areas, wanted, seed)

    def problem(self):
        """Why nothing can be told, or an empty text."""
        if not self.captured.any():
            return "it is black"
        if len(self.places.vertices) < MIN_PLACES:
            return f"only {len(self.places.vertices)} places are lit, unclipped and open to the sky"
        return ""

    def bounced(self):
        return self.bounce[self.places.vertices].astype(np.float64)

    def patches(self, volume):
        """The Patches of what was looked at, or None where they are too few."""
        looks = looks_over(self.occluder, self.areas, self.seed) if self.looks is None else self.looks
        content = self.captured, self.usable, self.transfer, self.bounce
        return contrast.patches_of(looks, self.occluder, *content, volume)

    def start(self):
        """(3,) radiance of a uniform light that makes the median albedo the usual one, half way to a grey world."""
        places = self.places
        level = np.array([weighted_median(c, np.ones(len(c))) for c in self.captured[places.vertices].T])
        level = np.sqrt(level * luminance(level))
        visible, bounced = places.sky.sum(axis=1), luminance(self.bounced())
        radiance = (luminance(self.captured[places.vertices]) / USUAL_ALBEDO - bounced) / visible
        bright = max(float(np.median(radiance)), 0.25 * float(luminance(level)) / USUAL_ALBEDO)
        return level / luminance(level) * bright

    def fitted(self, light, start, prior):
        places = self.places
        return fit.solve(light, self.log_captured(), places.pairs, places.weights, start, prior)

    def log_captured(self):
        return np.log(self.captured[self.places.vertices].astype(np.float64))

    def direct(self, environment):
        """Direct light on the white scene, (V, 3) float32, not negative."""
        return direct_light(self.occluder, self.transfer, environment, self._sunlit)

    def result(self, environment, evidence, direct=None, brighter=True):
        direct = self.direct(environment) if direct is None else direct
        shares = np.where(self.usable, self.areas, 0.0)
        gain = np.float32(self.brighter(direct) if brighter else 1.0)
        if gain > 1.0:
            environment = Environment(environment.radiance * gain, environment.name, environment.rotation_deg)
        irradiance = gain * direct + self.bounce
        prior = prior_of(self.captured, irradiance, shares)
        albedo = albedo_of(self.captured, irradiance, prior)
        return Estimate(albedo, irradiance, environment, prior, evidence, True, "", *_described(environment))

    def brighter(self, direct):
        """How much brighter, at least 1, the light must be for all but a few places to be no lighter than a surface."""
        rows, gain = self.places.vertices, 1.0
        captured, bounce, direct = (a[rows].astype(np.float64) for a in (self.captured, self.bounce, direct))
        shares = np.ones(len(rows))
        for _ in range(BRIGHTER_ROUNDS):
            received = np.maximum(gain * direct + bounce, np.finfo(np.float32).tiny)
            lightest = weighted_quantile((captured / received).max(axis=1), shares, LIGHT_PART)
            gain *= max(lightest / LIGHTEST, 1.0)
        return gain

    def usual(self, exposure, direct):
        """The exposure, float32, nearest to this one whose median albedo a place may have. direct: (N,) luminance of
        the known light at the places. Of a sky clipped all around trees are what binds: they tell too dark a light.
        """
        captured, bounced = luminance(self.captured[self.places.vertices]), luminance(self.bounced())
        lit = direct > 0.0
        bounds = [
            weighted_median((captured[lit] / albedo - bounced[lit]) / direct[lit], np.ones(np.count_nonzero(lit)))
            for albedo in (contrast.ALBEDOS[-1], contrast.ALBEDOS[0])
        ]
        return np.float32(np.clip(exposure, max(bounds[0], 1e-6), max(bounds[1], 1e-6)))

    def as_captured(self, reason, evidence=0.0):
        """The captured colours as albedo under a uniform light, scaled down where they are brighter than a surface."""
        level = weighted_quantile(self.captured.max(axis=1).astype(np.float64), np.ones(len(self.captured)), 0.98)
        level = np.float32(max(level / LIGHTEST, 1.0))
        irradiance = np.full_like(self.captured, level)
        environment = Environment(np.full((HEIGHT, WIDTH, 3), level, np.float32), "uniform")
        prior = prior_of(self.captured, irradiance)
        albedo = albedo_of(self.captured, irradiance, prior)
        return Estimate(albedo, irradiance, environment, prior, evidence, False, reason, *_described(environment))


def _prior(bands):
    """(3 K, 3 K) of the quadratic prior on logarithmic coefficients, colours outermost.

    Brightness and colour of the mean are bounded; a coefficient of degree l is pulled to 0 with weight l.
    """
    width = bands**2
    degree, _ = harmonics.degrees_and_orders(bands)
    gray = np.full((3, 3), 1.0 / 3.0)
    color = np.eye(3) - gray
    mean = (gray / BRIGHTNESS**2 + color / COLOR**2) * _UNIT**2
    matrix = np.kron(gray + CONTRAST_COLOR * color, np.diag(degree))
    at = np.arange(3) * width
    matrix[np.ix_(at, at)] = mean
    return matrix


def _image(theta, lamp=None):
    """(H, W, 3) float32 radiance of the logarithm's coefficients (K, 3), and of a Sun beside it."""
    directions = projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3)
    exponent = harmonics.evaluate(directions, math.isqrt(len(theta))) @ theta
    radiance = np.exp(np.clip(exponent, -30.0, 30.0)).reshape(HEIGHT, WIDTH, 3)
    return (radiance if lamp is None else radiance + _sun_image(lamp)).astype(np.float32)


def _sun_image(lamp):
    """(H, W, 3) float64 radiance of a Sun."""
    cosine = projections.texel_directions(HEIGHT, WIDTH) @ lamp.direction
    lobe = np.exp(-0.5 * (np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))) / lamp.width_deg) ** 2)
    area = projections.row_solid_angles(HEIGHT, WIDTH).reshape(-1, 1)
    return (lobe / (lobe * area).sum())[:, :, None] * lamp.irradiance


def _described(environment):
    """direction, concentration, color and brightness of an Estimate."""
    coefficients = environment.sh(2)
    mean = coefficients[0] / math.sqrt(4.0 * math.pi)
    bright = max(float(luminance(mean)), np.finfo(np.float32).tiny)
    y, z, x = luminance(coefficients[1:4]) * math.sqrt(4.0 * math.pi / 3.0) / (4.0 * math.pi)
    moment = np.array([x, y, z])  # the mean of direction times luminance
    length = float(np.linalg.norm(moment))
    direction = moment / length if length > 1e-6 * bright else np.array([0.0, 1.0, 0.0])
    return direction, min(length / bright, 1.0), mean / bright, bright
