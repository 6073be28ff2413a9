"""Plans for the lights of one scene: made once for each, kept between runs, checked after the work and corrected."""

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..options import DEFAULT_TOLERANCE, LightingOptions
from ..transfer.filtering import NOISE_POWER
from ..transfer.split_light import image_key
from ..transfer.store import array_key
from .bounce_check import MOST_ROUNDS, bounce_errors, more_rays
from .decide import PlannedScene, planned, unmeasured
from .plan import Plan

if TYPE_CHECKING:
    from splat2mesh.base.progress import Stages

    from ..light.environment import Environment
    from ..transfer.bounces import Interreflection
    from ..transfer.precomputed import Precomputed
    from ..transfer.settings import Settings

MOST_DOUBLINGS = 4
"""How often the rays may be doubled when the sample shows more noise than was planned for."""

UNMENDED = (1.0 + 2.0**NOISE_POWER) ** -0.5
"""Part of the tolerance beyond which what rays cannot mend ends their doubling, once it is more than their noise: where
both are as large, the next doubling does not lead within the tolerance."""

CHECKED = "rays and bounces, suns for all bands, shadows everywhere"
"""What is checked after the work, and for what suns are found. Plans that earlier versions kept are made anew."""


class Planner:
    """Plans by LightingOptions that have a tolerance or a budget of seconds."""

    def __init__(self, precomputed: "Precomputed", options: LightingOptions, stages: "Stages") -> None:
        self._precomputed, self._stages, self._options = precomputed, stages, options
        self._tolerance = DEFAULT_TOLERANCE if options.tolerance is None else options.tolerance
        self._plans: dict[Any, Plan] = {}
        self._unbounced: dict[Any, tuple[float, int]] = {}  # all other errors, rounds so far
        self._albedo: tuple[Any, Any] = (None, None)

    def plan(self, environment: "Environment", albedo: NDArray[np.floating] | None, angles: int = 1) -> Plan:
        """The Plan for an environment in all its rotations and an albedo, (V, 3) or None."""
        key = self._key(environment, albedo)
        if key not in self._plans:
            self._plans[key] = self._kept(key) or self._made(environment, albedo, angles)
        return self._plans[key]

    def settled(self, environment: "Environment", albedo: NDArray[np.floating] | None) -> "Settings":
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
        environment: "Environment",
        albedo: NDArray[np.floating] | None,  # (V, 3), None if white
        direct: NDArray[np.float32],  # (V, 3) light on the white scene
        radiance: NDArray[np.float32],  # (V, 3) exit radiance, with bounces
        matrix: "Interreflection",  # that carried them
    ) -> "Settings | None":
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

    def _made(self, environment: "Environment", albedo: NDArray[np.floating] | None, angles: int) -> Plan:
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

    def _key(self, environment: "Environment", albedo: NDArray[np.floating] | None) -> str:
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
