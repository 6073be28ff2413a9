"""A scene as it was captured: the places whose colours show its light, the light its surfaces exchange, and how a given
light would light it.
"""

import math
import warnings
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Radiance
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.progress import Advance
from splat2mesh.base.quantiles import weighted_quantile
from splat2mesh.scene.color import luminance
from splat2mesh.scene.measured import CapturedSky

from ..light.environment import Environment
from ..transfer.occluder import Occluder
from ..transfer.transport import Transport
from . import samples
from .direct import direct_light
from .division import LIGHTEST, Prior, albedo_of, checked, prior_of
from .evidence import Evidence, LitPlaces
from .fitted import FITTED
from .posterior import PosteriorLight, doubt_db
from .said import Said
from .seen import SeenPoints
from .skylight import LEAST_OPEN, seen_sky
from .unseen import backs

BANDS, RAYS = 8, 64
BOUNCE_RAYS = RAYS // 2
"""Default settings of transfer and bounces; half the default rays of relight."""

MIN_PLACES = 64
"""Fewer are too few for the numbers of a light."""

SATURATED = 0.99
"""Linear colour from which a byte may have been clipped: its true value is not known."""

DARK = 0.002
"""Linear colour of little meaning: below the seventh step of an sRGB byte."""

HEIGHT = 128
WIDTH = 2 * HEIGHT
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
    whether a captured sky was used. spread: root mean square, over places, of the uncertainty of their log light.
    lights: the posterior's PosteriorLights, the likeliest first; none of a known light.
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
    spread: float = 0.0
    lights: tuple[PosteriorLight, ...] = ()

    @property
    def doubt_db(self) -> float:
        """What a wrong light costs results at most, in four of five captures."""
        return doubt_db(self.spread)


class CaptureEvidence(NamedTuple):
    """Evidence on a capture beside its colours. Each field is None, or empty, if unknown.

    sky: what the capture shows of its sky. looks: points seen from where the capture stood; then what they show counts,
    not area. hopeless: why the light cannot be estimated. said: what the user knows.
    """

    sky: CapturedSky | None = None
    looks: SeenPoints | None = None
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
        self.sky = evidence.sky if open_part > LEAST_OPEN else None
        self.usable &= ~backs(occluder, self.captured, visible)
        self.places = samples.take(occluder, self.areas, self.usable & (visible > samples.MIN_VISIBLE), seed)

    def _traced(self) -> Transport:
        from ..transfer.bounces import Interreflection, visible_fraction
        from ..transfer.visibility import raytraced_scene

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

    @cached_property
    def evidence(self) -> Evidence:
        """The Evidence of its places."""
        found, rows = self.places, self.places.vertices
        captured, bounced = self.captured[rows].astype(np.float64), self.bounce[rows].astype(np.float64)
        normals = self.occluder.normals[rows]
        places = LitPlaces(found.sky, found.directions, captured, bounced, normals, found.pairs, found.weights)
        return Evidence(places, None if self.sky is None else seen_sky(self.sky, found.directions), FITTED)

    def direct(self, environment: Environment) -> NDArray[np.float32]:
        """Direct light on the white scene, (V, 3) float32, not negative."""
        return direct_light(self.occluder, self.transport.transfer, environment, self.transport.sunlit)

    def result(
        self,
        environment: Environment,
        decided: float,
        direct: Radiance | None = None,
    ) -> Estimate:
        """The Estimate of a light. direct: (V, 3) of it, where it is known."""
        irradiance = (self.direct(environment) if direct is None else direct) + self.bounce
        prior = prior_of(self.captured, irradiance, np.where(self.usable, self.areas, 0.0))
        albedo = albedo_of(self.captured, irradiance, prior)
        described = described_light(environment)
        found = Estimate(albedo, irradiance, environment, prior, decided, True, "", *described)
        return found._replace(under_sky=self.sky is not None)

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
