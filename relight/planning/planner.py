"""Plans for the lights of one scene: made once for each, kept between runs, checked after the work and corrected."""

import json
import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance

from ..light.environment import Environment
from ..options import DEFAULT_TOLERANCE, LightingOptions
from ..transfer.filtering import NOISE_POWER
from ..transfer.settings import BOUNCES, VOLUME, VOLUME_DIRECTIONS, VOLUME_ERROR, Settings
from ..transfer.split_light import image_key
from ..transfer.store import array_key
from ..transfer.volume import Foliage
from .bounce_check import MOST_ROUNDS, bounce_errors, more_rays
from .choice import Choice, Leaves, best_of, curve_of
from .effect_errors import EffectErrors
from .plan import Plan
from .sample import PlannedScene, Sample
from .unmeasured import unmeasured

if TYPE_CHECKING:
    from splat2mesh.base.progress import Stages

    from ..transfer.bounces import Interreflection
    from ..transfer.precomputed import Precomputed

MOST_DOUBLINGS = 4
"""How often the rays may be doubled when the sample shows more noise than was planned for."""

UNMENDED = (1.0 + 2.0**NOISE_POWER) ** -0.5
"""Part of the tolerance beyond which what rays cannot mend ends their doubling, once it is more than their noise: where
both are as large, the next doubling does not lead within the tolerance."""

CHECKED = "rays and bounces, suns for all bands, shadows everywhere"
"""What is checked after the work, and for what suns are found. Plans that earlier versions kept are made anew."""

UNSHADOWED = ("analytic", "neural-gash", "blinn-phong")
"""Methods that trace nothing, and march through nothing."""

SAMPLE_VERTICES, SAMPLE_DIRECTIONS = 384, 2048
"""Whatever the tolerance. Of 72 plans on three generated scenes, for tolerances of .005 to .1, as many as with 4,096
directions kept to it, 67, in as much work."""


class Planner:
    """Plans by LightingOptions that have a tolerance or a budget of seconds."""

    def __init__(self, precomputed: "Precomputed", options: LightingOptions, stages: "Stages") -> None:
        self._precomputed, self._stages, self._options = precomputed, stages, options
        self._tolerance = DEFAULT_TOLERANCE if options.tolerance is None else options.tolerance
        self._plans: dict[Any, Plan] = {}
        self._unbounced: dict[Any, tuple[float, int]] = {}  # all other errors, rounds so far
        self._albedo: tuple[Any, Any] = (None, None)

    def plan(self, environment: Environment, albedo: NDArray[np.floating] | None, angles: int = 1) -> Plan:
        """The Plan for an environment in all its rotations and an albedo, (V, 3) or None."""
        key = self._key(environment, albedo)
        if key not in self._plans:
            self._plans[key] = self._kept(key) or self._made(environment, albedo, angles)
        return self._plans[key]

    def settled(self, environment: Environment, albedo: NDArray[np.floating] | None) -> Settings:
        """The Settings of the plan, after their transfer was computed and checked on the sample.

        Where it shows more noise than was predicted, too much for the tolerance, the rays are doubled. Bounced light is
        checked by `bounced`, once it was computed.
        """
        plan, key = self.plan(environment, albedo), self._key(environment, albedo)
        if plan.checked is None and plan.choice is not None:
            self._check(plan)
            if plan.settings.bounce_rays:
                predicted = math.hypot(*plan.choice.of_bounces(plan.settings))
                assert plan.checked is not None  # it was checked above
                self._unbounced[key] = math.sqrt(max(plan.checked**2 - predicted**2, 0.0)), 0
            else:
                self._keep(plan, key)
        return plan.settings

    def bounced(
        self,
        environment: Environment,
        albedo: NDArray[np.floating] | None,  # (V, 3), None if white
        direct: NDArray[np.float32],  # (V, 3) light on the white scene
        radiance: NDArray[np.float32],  # (V, 3) exit radiance, with bounces
        matrix: "Interreflection",  # that carried them
    ) -> Settings | None:
        """Settings with more bounce rays, where those of a light computed as `settled` says do not suffice; else None.

        The error is measured in the first light of an image, whatever its angle, and is in the plan from then on.
        """
        key = self._key(environment, albedo)
        if key not in self._unbounced:
            return None
        plan, (others, rounds) = self._plans[key], self._unbounced.pop(key)
        with self._stages.stage("check"):
            tint = np.float32(1.0) if albedo is None else albedo
            sample = plan.choice.measured.wide(radiance - tint * direct)
            found = bounce_errors(sample, tint, direct, radiance, matrix.hidden, self._precomputed.seed)
        plan.checked = math.hypot(others, found.whole)
        ended = plan.budget_s is not None or rounds == MOST_ROUNDS
        rays = None if ended else more_rays(matrix.rays, found, others, self._tolerance)
        if rays is None:
            self._keep(plan, key)
            return None
        self._unbounced[key] = others, rounds + 1
        plan.settings = plan.settings._replace(bounce_rays=rays)
        plan.contributions = plan.choice.contributions(plan.settings)
        return plan.settings

    def _keep(self, plan: Plan, key: str) -> None:
        self._precomputed.cache.put("plan", key, plan=np.array(json.dumps(plan.as_dict())))

    def _check(self, plan: Plan) -> None:
        fixed_rays = self._options.rays is not None
        for left in range(MOST_DOUBLINGS, -1, -1):
            settings = plan.settings
            if not settings.rays:
                plan.checked = plan.error
                return
            transfer = self._precomputed.transfer(settings)[0]
            with self._stages.stage("check"):
                rows = transfer[plan.rows, : settings.bands**2]
                accepted = self._tolerance if plan.budget_s is None else math.inf  # which pays for no closer look
                plan.checked = plan.choice.checked(settings, rows, accepted)
            rest = plan.choice.but_noise(settings)
            hopeless = rest > UNMENDED * self._tolerance and plan.checked < 2.0**0.5 * rest
            if plan.checked <= self._tolerance or hopeless or plan.budget_s is not None or fixed_rays or not left:
                return
            plan.settings = settings._replace(rays=2 * settings.rays)
            plan.contributions = plan.choice.contributions(plan.settings)

    def _made(self, environment: Environment, albedo: NDArray[np.floating] | None, angles: int) -> Plan:
        known = self._precomputed
        scene = PlannedScene(known.occluder, albedo, known.foliage, known.traced, known.cache)
        with self._stages.stage("plan"):
            return unmeasured(scene, self._options, angles) or planned(
                scene, environment, self._options, angles, known.there()
            )

    def _kept(self, key: str) -> Plan | None:
        kept = self._precomputed.cache.get("plan", key)
        try:
            return None if kept is None else Plan.from_dict(json.loads(str(kept["plan"])))
        except (KeyError, TypeError, ValueError):
            return None

    def _key(self, environment: Environment, albedo: NDArray[np.floating] | None) -> str:
        if self._albedo[0] is not albedo:
            self._albedo = albedo, array_key(albedo)
        options = self._options
        effects = None if options.fixed_effects is None else sorted(options.fixed_effects)
        fixed = options.fixed_method, options.bands, options.rays, effects
        foliage = self._precomputed.foliage
        wishes = (
            self._tolerance,
            options.budget_s,
            *fixed,
            self._precomputed.seed,
            None if foliage is None else foliage.key,
            CHECKED,
        )
        image = image_key(environment)
        return array_key(np.frombuffer(repr((image, self._albedo[1], wishes)).encode(), np.uint8))


def planned(
    scene: PlannedScene,
    environment: Environment,
    options: LightingOptions | None = None,  # of a method that can be planned
    angles: int = 1,  # for how many lights
    # Whether the transfer and the bounces of Settings are there already.
    there: Callable[[Settings], tuple[bool, bool]] = lambda settings: (False, False),
) -> Plan:
    """Measure a sample of the scene under all rotations of the light, and choose: a Plan."""
    start = time.perf_counter()
    options = (options or LightingOptions()).planned()
    budget_s, effects = options.budget_s, options.fixed_effects
    tolerance = DEFAULT_TOLERANCE if options.tolerance is None else options.tolerance
    sample = Sample(scene.occluder, SAMPLE_VERTICES, SAMPLE_DIRECTIONS, scene.traced, scene.cache)
    albedo, foliage = scene.albedo, scene.foliage
    if albedo is None and effects is not None and BOUNCES in effects:
        albedo = np.ones(scene.occluder.origins.shape, np.float32)
    bouncing = albedo is not None and (effects is None or BOUNCES in effects)
    light = environment, albedo, bouncing
    if foliage is not None and options.fixed_method not in UNSHADOWED:
        measured, leaves = _with_leaves(sample, foliage, light, effects is None or VOLUME in effects)
    else:
        measured, leaves = EffectErrors(sample, *light), None
    until = None if budget_s is None else start + budget_s  # what planning takes is part of it
    choice = Choice(measured, environment, options, angles, leaves, there, until)
    best = best_of(choice.candidates, tolerance, until)
    return Plan(
        settings=best.settings,
        error=best.error,
        seconds=best.seconds,
        sun_count=choice.sun_count(best.settings),
        tolerance=None if budget_s else tolerance,
        budget_s=budget_s,
        vertices=len(sample.rows),
        rays=sample.rays,
        contributions=choice.contributions(best.settings),
        curve=curve_of(choice.candidates),
        planning_s=time.perf_counter() - start,
        choice=choice,
        rows=sample.rows,
    )


def _with_leaves(
    sample: Sample,
    foliage: Foliage,
    light: tuple[Environment, Radiance | None, bool],  # of EffectErrors
    volume: bool,  # whether they are to be one
) -> tuple[EffectErrors, Leaves]:
    """What is measured of a scene with a Foliage, as volumes or as surfaces."""
    thickened, direction_s = sample.thickened(foliage)
    measured, vertices = EffectErrors(thickened, *light), len(foliage.rows)
    error = measured.changed(sample.seen)
    if not volume:
        return EffectErrors(sample, *light), Leaves(0, error, 0.0, vertices, error)
    seconds = VOLUME_DIRECTIONS * direction_s
    return measured, Leaves(VOLUME_DIRECTIONS, error, seconds, vertices, VOLUME_ERROR * measured.leafy)
