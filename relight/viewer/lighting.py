"""Answer the wishes of a session from the engine, in the order in which the user wants to see the results.

The only module of the viewer that knows the engine. It runs in the worker process (`worker`) and answers
each wish with a few results: first the light, then the transfers with which the window shades at once, then slower
results. It knows nothing of windows.
"""

import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance
from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.scene import Scene

from ..engine.relighter import Relighter
from ..light import WIDTH
from ..light.environment import Environment
from ..light.projections import pooled
from ..live.response import SPREAD_BANDS
from ..options import LightingOptions
from ..planning.choice import SAFETY
from ..planning.planner import SAMPLE_VERTICES
from ..sh import harmonics
from ..transfer.analytic import analytic
from ..transfer.checks import checked_albedo
from ..transfer.settings import BOUNCES, SHADOWS, SUN, VOLUME, Settings

if TYPE_CHECKING:
    from ..planning.plan import Plan
    from ..transfer.occluder import Occluder
    from ..transfer.store import Cache
    from ..transfer.volume import Foliage

SPARE = 8
"""What is kept for a return: relighters and plans by tolerance, and exact answers of a Bench, 2.4 to 3.6 MB each for
100,000 vertices."""

SAMPLE_RAYS = 1024
"""Rays from each of these vertices that gather bounced light: a quarter of the noise of the engine's 64."""


SKY_WIDTH = 2 * WIDTH
"""Most columns of the sky behind the scene."""


STAGES = {
    "environment": "loading the light",
    "plan": "planning",
    "rays": "tracing shadows",
    "check": "checking the plan",
    "light": "splitting off suns",
    "sunlight": "tracing suns",
    "bounce rays": "tracing bounces",
}
"""Names of the engine's stages on the panel; others keep their names."""


class LightWish(NamedTuple):
    """The light that the window wants. environment, albedo: names. effects: frozenset of
    `relight.transfer.settings.EFFECTS`.
    """

    environment: str
    angle_deg: float
    tolerance: float
    effects: frozenset
    albedo: str
    method: str = "auto"


class SessionLight(NamedTuple):
    """An environment as the window needs it, unrotated.

    coefficients: (100, 3) float64 of radiance, bands 10. sky: (H, W, 3) float32 linear, canonical lat-long.
    warning: the repairs, or "".
    """

    coefficients: np.ndarray
    sky: np.ndarray
    warning: str


class FinishedShading(NamedTuple):
    """A finished shading. radiance: (V, 3) float32. sun_count, bounces: as of `Shading`. settings: in words.

    effects: those in the plan. predicted: its error, or None without a plan. seconds: time of the shading, without the
    work that is done once per scene. curve: (seconds, tolerance), what tolerances cost, from quick to exact; planned:
    the seconds of this one.
    """

    radiance: np.ndarray
    sun_count: int
    bounces: list
    settings: str
    effects: frozenset
    predicted: float | None
    seconds: float
    curve: Sequence[tuple[float, float]] = ()
    planned: float = 0.0


class SessionScene(NamedTuple):
    """A scene and all the lights and albedos that a session may choose from.

    environments: dict of name -> Environment, or what `Environment.load` takes. albedos: dict of name -> (V, 3)
    linear or None for white. options: LightingOptions; every wish brings its own tolerance. cache: as of `Relighter`.
    """

    scene: Scene
    environments: Mapping[str, Any]
    albedos: Mapping[str, NDArray | None]
    options: LightingOptions = LightingOptions()
    cache: "Cache | None" = None


class SessionLighting:
    """Lights a SessionScene.

    stages: as of `splat2mesh.base.progress.Stages`; its `advance` may raise to end an answer early.
    step: (kind, key) of the result in progress, or None.
    """

    def __init__(self, asked: SessionScene, stages: Any) -> None:
        scene, self.environments, self.albedos, options, cache = asked
        self.scene, self.stages = scene, stages
        self.step: tuple[str, Any] | None = None
        self._options = options
        self._relighter_of = lru_cache(SPARE)(self._new_relighter)
        self._relighter = Relighter(scene, self._options, stages=stages, cache=cache)
        self._foliage = self._relighter.precomputed.foliage
        self._loaded: tuple[str, Environment] | None = None
        self._sample: tuple[Any, NDArray] | None = None
        self._sent: dict[str, Any] = {}
        self._transfer_sent: Any = None

    def answers(self, wish: LightWish) -> Iterator[tuple[str, Any, Any]]:
        """Yield (kind, key, payload) for each result that the wish needs and that was not yielded before.

        Kinds in order: "unshadowed" ((V, K) float32), "light" (SessionLight), "transfer" ((V, K)), "shading"
        (FinishedShading), "bounced" ((3, V, K') float32: bounced light per coefficient), "error" (float). The receiver
        needs only the last result of each kind. Raises InputError for a light that cannot be read.
        """
        for kind, key in keys(wish).items():
            if self._sent.get(kind) != key:
                self.step = kind, key
                payload = getattr(self, f"_{kind}")(wish)
                self._sent[kind], self.step = key, None
                if payload is not None:
                    yield kind, key, payload

    def _light(self, wish: LightWish) -> SessionLight:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            environment = self._environment(wish)
            coefficients = environment.rotated(-environment.rotation_deg).sh(harmonics.MAX_BANDS)
        sky: Radiance = environment.radiance
        if sky.shape[1] > SKY_WIDTH:
            sky = pooled(sky, (SKY_WIDTH // 2, SKY_WIDTH))
        return SessionLight(coefficients, np.asarray(sky, np.float32), "; ".join(str(w.message) for w in caught))

    def _unshadowed(self, wish: LightWish) -> NDArray:
        return np.asarray(analytic(self.scene.normals, SPREAD_BANDS), np.float32)

    def _transfer(self, wish: LightWish) -> NDArray | None:
        relighter, plan = self._planned(wish)
        if plan is None:
            self._transfer_sent = None
            return None if relighter.method == "blinn-phong" else relighter.transfer
        transfer, done = relighter.precomputed.transfer(plan.settings)
        if done[:4] == self._transfer_sent:
            return None
        self._transfer_sent = done[:4]
        return np.ascontiguousarray(transfer[:, : plan.settings.bands**2])

    def _shading(self, wish: LightWish) -> FinishedShading:
        environment, albedo = self._environment(wish), self.albedos[wish.albedo]
        relighter, plan = self._planned(wish)
        whole = relighter.shading(environment, albedo)  # with all effects, once, which also checks the plan
        settings = restrict(whole.settings, wish.effects)
        start = time.perf_counter()
        shading = relighter.shading(environment, albedo, settings)
        seconds = time.perf_counter() - start
        predicted = None if plan is None else plan.error
        words = str(shading.settings)
        curve = [] if plan is None else [(row[0], row[1] / (SAFETY if plan.rays else 1.0)) for row in plan.curve]
        planned = 0.0 if plan is None else plan.seconds
        return FinishedShading(*shading[:3], words, whole.settings.effects, predicted, seconds, curve, planned)

    def _bounced(self, wish: LightWish) -> NDArray | None:
        albedo, (relighter, plan) = self.albedos[wish.albedo], self._planned(wish)
        if plan is None or albedo is None:
            return None
        rays = restrict(plan.settings, wish.effects).bounce_rays
        if not rays:
            return None
        from ..transfer.bounces import transfer_with_bounces

        plain = relighter.precomputed.transfer(plan.settings)[0][:, : SPREAD_BANDS**2]
        bounced, _ = transfer_with_bounces(plain, albedo, relighter.precomputed.interreflection(rays, plain))
        added = bounced - plain[:, :, None] * np.asarray(albedo, np.float32)[:, None, :]
        return np.ascontiguousarray(np.moveaxis(added, 2, 0))

    def _error(self, wish: LightWish) -> float:
        environment, albedo = self._environment(wish), self.albedos[wish.albedo]
        relighter, _ = self._planned(wish)
        whole = relighter.shading(environment, albedo)
        shown = relighter.shading(environment, albedo, restrict(whole.settings, wish.effects))
        return self._error_of(shown.radiance, whole.radiance, wish)

    def _error_of(self, shown: NDArray, whole: NDArray, wish: LightWish) -> float:
        """Relative L2 error of radiance (V, 3) on the sample, against rays to all parts of the light.

        Direct light comes from `transfer.reference`; bounced light is gathered by `SAMPLE_RAYS` rays from `whole`,
        the radiance (V, 3) of the scene with all effects.
        """
        from ..transfer.reference import reference

        environment, albedo = self._environment(wish), self.albedos[wish.albedo]
        occluder = self._relighter.occluder
        rows = np.random.default_rng(0).permutation(len(whole))[:SAMPLE_VERTICES]
        key = wish.environment, wish.angle_deg
        if self._sample is None or self._sample[0] != key:
            self._sample = key, reference(occluder, rows, environment, foliage=self._foliage)
        expected: NDArray = self._sample[1]
        if albedo is not None:
            expected = albedo[rows] * (expected + _gather(occluder, rows, whole, self._foliage))
        return float(np.linalg.norm(shown[rows] - expected) / max(float(np.linalg.norm(expected)), 1e-30))

    def _planned(self, wish: LightWish) -> tuple[Relighter, "Plan | None"]:
        """The Relighter of the wish's tolerance, and its Plan for the light, or None.

        All relighters share their traced results.
        """
        relighter: Relighter = self._relighter_of(wish.method, wish.tolerance)
        return relighter, relighter.plan_for(self._environment(wish), self.albedos[wish.albedo])

    def _new_relighter(self, method: str, tolerance: float) -> Relighter:
        options = replace(self._options, method=method, tolerance=tolerance)
        return Relighter(self.scene, options, stages=self.stages, precomputed=self._relighter.precomputed)

    def _environment(self, wish: LightWish) -> Environment:
        """The rotated Environment of a wish. The last one stays loaded."""
        if self._loaded is None or self._loaded[0] != wish.environment:
            source = self.environments[wish.environment]
            with self.stages.stage("environment"):
                self._loaded = wish.environment, source if isinstance(source, Environment) else Environment.load(source)
        environment = self._loaded[1]
        return environment.rotated(wish.angle_deg - environment.rotation_deg)


def keys(wish: LightWish) -> dict[str, Any]:
    """The dependencies of each kind of result: a dict in the order of `SessionLighting.answers`."""
    plan = wish.environment, wish.tolerance, wish.albedo, wish.method
    lit = (*plan, wish.angle_deg, wish.effects)
    return {
        "unshadowed": True,
        "light": wish.environment,
        "transfer": plan,
        "shading": lit,
        "bounced": (*plan, BOUNCES in wish.effects),
        "error": lit,
    }


def restrict(settings: Settings, effects: frozenset[str]) -> Settings:
    """The Settings restricted to `effects`."""
    if SHADOWS not in effects and settings.rays:
        return Settings("analytic", settings.bands)
    if SUN not in effects:
        settings = settings._replace(sun_tolerance=0.0)
    if VOLUME not in effects:
        settings = settings._replace(volume=0)
    return settings if BOUNCES in effects else settings._replace(bounce_rays=0, bounce_tolerance=0.0)


def check_albedos(scene: Scene, albedos: Mapping[str, NDArray | None]) -> dict[str, NDArray | None]:
    """`albedos` as a dict of name -> (V, 3) float32 or None. Raises InputError for one that does not fit the scene."""
    count = sum(len(chunk.vertices) for chunk in scene.chunks)
    if not albedos:
        raise InputError("the session needs at least one albedo: a dict of name -> (V, 3) linear, or None for white")
    checked = {}
    for name, albedo in albedos.items():
        if albedo is not None:
            albedo = checked_albedo(albedo, count, f"albedo {name!r}")
        checked[str(name)] = albedo
    return checked


def _gather(occluder: "Occluder", rows: NDArray, radiance: NDArray, foliage: "Foliage | None" = None) -> NDArray:
    """Light (R, 3) float32 that white vertices `rows` receive from a scene whose exit radiance is `radiance` (V, 3).

    A volume of a Foliage sees less of the sky than a surface: its occluded part takes the radiance that the rays meet.
    """
    from ..transfer.first_bounce import first_bounce

    met = np.zeros(len(rows), np.float32)
    light = first_bounce(occluder, np.asarray(radiance, np.float32), SAMPLE_RAYS, rows, met=met)
    if foliage is None:
        return light
    share, free, _ = foliage.seen(rows, fibonacci_sphere(SAMPLE_RAYS))
    hidden = met + share * (1.0 - free.mean(axis=1) - met)
    return light * (hidden / np.maximum(met, 1.0 / SAMPLE_RAYS)).astype(np.float32)[:, None]
