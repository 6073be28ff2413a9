"""A scene as it was captured: the places whose colours show its light, the light its surfaces exchange, and how a given
light would light it.
"""

import math
import warnings
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.progress import Advance
from splat2mesh.scene.color import luminance
from splat2mesh.scene.measured import CapturedSky

from ..light.environment import Environment
from ..transfer.occluder import Occluder
from ..transfer.transport import Transport
from . import fit, natural, samples, skylight
from .contrast import CONTRAST
from .direct import direct_light
from .division import LIGHTEST, Prior, albedo_of, checked, prior_of, weighted_median, weighted_quantile
from .patches import ColorPatches, patches_of
from .said import Said
from .seen import SeenPoints, looks_over

BANDS, RAYS, BOUNCE_RAYS = 8, 64, 32
"""Default settings of transfer and bounces; half the default rays of relight."""

USUAL_ALBEDO = 0.4
"""Median albedo, in luminance, where nothing says more."""

LIGHT_PART, BRIGHTER_ROUNDS = 0.97, 4
"""Part of the places that must not be lighter than the lightest surface, and rounds in which light is added for that:
a scene of dark surfaces and a few light ones has no median of 0.4."""

MIN_PLACES = 64
"""Fewer are too few for the numbers of a light."""

SATURATED = 0.99
"""Linear colour from which a byte may have been clipped: its true value is not known."""

DARK = 0.002
"""Linear colour of little meaning: below the seventh step of an sRGB byte."""

HEIGHT, WIDTH = 128, 256
"""Rows and columns of the estimated light's image: texels of 1.4 degrees hold the narrowest sun."""


class Estimate(NamedTuple):
    """Albedo and capture light of a scene of V vertices.

    albedo: (V, 3) float32 in [0.02, 0.95]. irradiance: (V, 3) float32, S in C = a S, in the unit of the captured
    colours. environment: the capture light, scene frame, in that unit, so that relighting by it gives back C. prior: of
    `albedo_of`, for other colours of the scene. separable: whether the light was separated; if not, `reason` says why,
    the albedo is the captured colour and the light uniform. evidence: in [0, 1], how far the scene, not the prior,
    decides which way the light comes from (of a known light: how bright it was). direction: (3,) unit, the mean of
    direction times luminance over the sphere, and its length concentration in [0, 1]: 0 uniform, 1 a single point.
    color: (3,) mean radiance of the light over its luminance. brightness: mean luminance of the light. under_sky:
    whether a captured sky was used. ambiguity: spread of the log irradiance over the lights that may have lit a place.
    """

    albedo: NDArray[np.float32]
    irradiance: NDArray[np.float32]
    environment: Environment
    prior: Prior
    evidence: float
    separable: bool
    reason: str
    direction: NDArray[np.float64]
    concentration: float
    color: NDArray[np.float64]
    brightness: float
    under_sky: bool = False
    ambiguity: float = 0.0


class CaptureEvidence(NamedTuple):
    """Evidence on a capture beside its colours. Each field is None, or empty, if unknown.

    sky: what the capture shows of its sky. looks: points seen from where the capture stood; then what they show counts,
    not area. volume: (V,) in [0, 1], how far each vertex is of leaves or grass. reflected: (K,) the shape of the light
    that gloss shows, of `reflected.guided`. hopeless: why the light cannot be estimated. said: what a person says.
    """

    sky: CapturedSky | None = None
    looks: SeenPoints | None = None
    volume: Floats | None = None
    reflected: Floats | None = None
    hopeless: str = ""
    said: Said = Said()


class CapturedScene:
    """A scene in the colours it was captured in, V vertices.

    areas: (V,) what each vertex counts: its area, or how large it was seen.
    """

    def __init__(
        self,
        occluder: Occluder,
        captured: ArrayLike,
        seed: int,
        advance: Advance,
        transport: Transport | None = None,
        evidence: CaptureEvidence | None = None,
    ) -> None:
        from ..transfer.bounces import visible_fraction

        evidence = evidence or CaptureEvidence()
        self.occluder, self.seed, self._advance = occluder, seed, advance
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
        self.transport = self._traced() if transport is None else transport
        self.bounce = self.transport.interreflection.bounce(self.captured)
        self.looks = evidence.looks
        self.areas = samples.vertex_areas(occluder) if self.looks is None else self.looks.sizes(count)
        peak = self.captured.max(axis=1)
        self.usable = (self.captured.min(axis=1) > DARK) & (peak < SATURATED)
        visible = visible_fraction(self.transport.transfer)
        open_part = float((self.areas * visible).sum() / max(float(self.areas.sum()), 1e-30))
        self.under_sky = evidence.sky is not None and open_part > skylight.LEAST_OPEN
        wanted = self.usable & (visible > samples.MIN_VISIBLE)
        if self.under_sky:
            flat = wanted & (self.roughness < samples.MAX_ROUGHNESS)
            wanted = flat if np.count_nonzero(flat) >= samples.SAMPLES else wanted
        self.places = samples.take(occluder, self.areas, wanted, seed)

    @cached_property
    def roughness(self) -> NDArray[np.float64]:
        """`samples.roughness` of the vertices, (V,)."""
        return samples.roughness(self.occluder)

    def _traced(self) -> Transport:
        from ..transfer.bounces import Interreflection, visible_fraction
        from ..transfer.raytraced import raytraced_scene

        transfer = raytraced_scene(self.occluder, BANDS, RAYS, self.seed, self._advance)
        visible = visible_fraction(transfer)
        return Transport(transfer, Interreflection(self.occluder, BOUNCE_RAYS, self.seed, visible, self._advance))

    def problem(self) -> str:
        """Why the light cannot be estimated, or an empty text."""
        if not self.captured.any():
            return "it is black"
        if len(self.places.vertices) < MIN_PLACES:
            return f"only {len(self.places.vertices)} places are lit, unclipped and open to the sky"
        return ""

    def bounced(self) -> NDArray[np.float64]:
        return self.bounce[self.places.vertices].astype(np.float64)

    def patches(self, volume: Floats | None) -> ColorPatches | None:
        """The ColorPatches of the surfaces in view, or None if they are too few."""
        looks = looks_over(self.occluder, self.areas, self.seed) if self.looks is None else self.looks
        content = self.captured, self.usable, self.transport.transfer, self.bounce
        return patches_of(looks, self.occluder, *content, volume)

    def start(self, natural_light: bool = False) -> NDArray[np.float64]:
        """(3,) radiance of a uniform light that makes the median albedo the usual one, half way to a grey world, or of
        the colour that natural light has there."""
        places = self.places
        level = np.array([weighted_median(c, np.ones(len(c))) for c in self.captured[places.vertices].T])
        level = natural.light_of(level) if natural_light else np.sqrt(level * luminance(level))
        visible, bounced = places.sky.sum(axis=1), luminance(self.bounced())
        radiance = (luminance(self.captured[places.vertices]) / USUAL_ALBEDO - bounced) / visible
        bright = max(float(np.median(radiance)), 0.25 * float(luminance(level)) / USUAL_ALBEDO)
        return level / luminance(level) * bright

    def fitted(self, light: fit.Light, start: NDArray[np.float64], prior: NDArray[np.float64]) -> fit.Fit:
        places = self.places
        return fit.solve(light, self.log_captured(), places.pairs, places.weights, start, prior)

    def log_captured(self) -> NDArray[np.float64]:
        return np.log(self.captured[self.places.vertices].astype(np.float64))

    def direct(self, environment: Environment) -> NDArray[np.float32]:
        """Direct light on the white scene, (V, 3) float32, not negative."""
        return direct_light(self.occluder, self.transport.transfer, environment, self.transport.sunlit)

    def direct_at_places(self, environment: Environment) -> NDArray[np.float32]:
        """The same at the places alone, (N, 3) float32."""
        known = self.transport
        return direct_light(self.occluder, known.transfer, environment, known.sunlit, self.places.vertices)

    def result(
        self, environment: Environment, evidence: float, direct: Radiance | None = None, brighter: bool = True
    ) -> Estimate:
        direct = self.direct(environment) if direct is None else direct
        shares = np.where(self.usable, self.areas, 0.0)
        gain = np.float32(self.brighter(direct) if brighter else 1.0)
        if gain > 1.0:
            environment = Environment(environment.radiance * gain, environment.name, environment.rotation_deg)
        irradiance = gain * direct + self.bounce
        prior = prior_of(self.captured, irradiance, shares)
        albedo = albedo_of(self.captured, irradiance, prior)
        return Estimate(albedo, irradiance, environment, prior, evidence, True, "", *described_light(environment))

    def brighter(self, direct: Radiance) -> float:
        """Factor, at least 1, by which the light must be brighter for all but a few places to be no lighter than a
        surface."""
        rows, gain = self.places.vertices, 1.0
        captured, bounce, direct = (a[rows].astype(np.float64) for a in (self.captured, self.bounce, direct))
        shares = np.ones(len(rows))
        for _ in range(BRIGHTER_ROUNDS):
            received = np.maximum(gain * direct + bounce, np.finfo(np.float32).tiny)
            lightest = weighted_quantile((captured / received).max(axis=1), shares, LIGHT_PART)
            gain *= max(lightest / LIGHTEST, 1.0)
        return gain

    def usual(self, exposure: np.float32, direct: Floats) -> np.float32:
        """The exposure, float32, nearest to this one whose median albedo a place may have. direct: (N,) luminance of
        the known light at the places. Where the sky is clipped all around, trees set the bound, and their light is too
        dark.
        """
        captured, bounced = luminance(self.captured[self.places.vertices]), luminance(self.bounced())
        lit = direct > 0.0
        bounds = [
            weighted_median((captured[lit] / albedo - bounced[lit]) / direct[lit], np.ones(np.count_nonzero(lit)))
            for albedo in (CONTRAST.albedos[-1], CONTRAST.albedos[0])
        ]
        return np.float32(np.clip(exposure, max(bounds[0], 1e-6), max(bounds[1], 1e-6)))

    def as_captured(self, reason: str, evidence: float = 0.0) -> Estimate:
        """The captured colours as albedo under a uniform light, scaled down where they are brighter than a surface."""
        quantile = weighted_quantile(self.captured.max(axis=1).astype(np.float64), np.ones(len(self.captured)), 0.98)
        level = np.float32(max(quantile / LIGHTEST, 1.0))
        irradiance = np.full_like(self.captured, level)
        environment = Environment(np.full((HEIGHT, WIDTH, 3), level, np.float32), "uniform")
        prior = prior_of(self.captured, irradiance)
        albedo = albedo_of(self.captured, irradiance, prior)
        return Estimate(albedo, irradiance, environment, prior, evidence, False, reason, *described_light(environment))


def described_light(environment: Environment) -> tuple[NDArray[np.float64], float, NDArray[np.float64], float]:
    """direction, concentration, color and brightness of an Estimate."""
    coefficients = environment.sh(2)
    mean = coefficients[0] / math.sqrt(4.0 * math.pi)
    bright = max(float(luminance(mean)), float(np.finfo(np.float32).tiny))
    y, z, x = luminance(coefficients[1:4]) * math.sqrt(4.0 * math.pi / 3.0) / (4.0 * math.pi)
    moment = np.array([x, y, z])  # the mean of direction times luminance
    length = float(np.linalg.norm(moment))
    direction = moment / length if length > 1e-6 * bright else np.array([0.0, 1.0, 0.0])
    return direction, min(length / bright, 1.0), mean / bright, bright
