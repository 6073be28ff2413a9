"""Plans for the lights of one scene: made once for each, kept between runs, checked after the work and corrected."""

import json
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..options import DEFAULT_TOLERANCE, LightingOptions
from ..transfer.split_light import image_key
from ..transfer.store import array_key
from .decide import PlannedScene, planned
from .plan import Plan

if TYPE_CHECKING:
    from splat2mesh.base.progress import Stages

    from ..light.environment import Environment
    from ..transfer.precomputed import Precomputed
    from ..transfer.settings import Settings

MOST_DOUBLINGS = 4
"""How often the rays may be doubled when the sample shows more noise than was planned for."""

UNMENDED = 0.85
"""Part of the tolerance beyond which what rays cannot mend ends their doubling, once it is more than their noise: many
times as many would hardly help."""


class Planner:
    """Plans by LightingOptions that have a tolerance or a budget of seconds."""

    def __init__(self, precomputed: "Precomputed", options: LightingOptions, stages: "Stages") -> None:
        self._precomputed, self._stages, self._options = precomputed, stages, options
        self._tolerance = DEFAULT_TOLERANCE if options.tolerance is None else options.tolerance
        self._plans: dict[Any, Plan] = {}
        self._albedo: tuple[Any, Any] = (None, None)

    def plan(self, environment: "Environment", albedo: NDArray[np.floating] | None, angles: int = 1) -> Plan:
        """The Plan for an environment in all its rotations and an albedo, (V, 3) or None."""
        key = self._key(environment, albedo)
        if key not in self._plans:
            self._plans[key] = self._kept(key) or self._made(environment, albedo, angles)
        return self._plans[key]

    def settled(self, environment: "Environment", albedo: NDArray[np.floating] | None) -> "Settings":
        """The Settings of the plan, after their transfer was computed and checked on the sample.

        Where it shows more noise than was predicted, too much for the tolerance, the rays are doubled.
        """
        plan = self.plan(environment, albedo)
        if plan.checked is None:
            self._check(plan)
            cache = self._precomputed.cache
            cache.put("plan", self._key(environment, albedo), plan=np.array(json.dumps(plan.as_dict())))
        return plan.settings

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
                plan.checked = plan.choice.checked(settings, rows, self._tolerance)
            rest = plan.choice.but_noise(settings)
            hopeless = rest > UNMENDED * self._tolerance and plan.checked < 2.0**0.5 * rest
            if plan.checked <= self._tolerance or hopeless or plan.budget_s is not None or fixed_rays or not left:
                return
            plan.settings = settings._replace(rays=2 * settings.rays)
            plan.contributions = plan.choice.contributions(plan.settings)

    def _made(self, environment: "Environment", albedo: NDArray[np.floating] | None, angles: int) -> Plan:
        known = self._precomputed
        scene = PlannedScene(known.occluder, known.sizes, albedo, known.foliage, known.traced)
        with self._stages.stage("plan"):
            return planned(scene, environment, self._options, angles, known.there())

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
        )
        image = image_key(environment)
        return array_key(np.frombuffer(repr((image, self._albedo[1], wishes)).encode(), np.uint8))
