"""From a sample of the scene to a plan: the cheapest settings within an error, or the best within a time."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from splat2mesh.base.arrays import Mask, Radiance

from ..light.environment import Environment
from ..light.sun_split import DEFAULT_LIMIT
from ..options import DEFAULT_TOLERANCE, LightingOptions
from ..transfer.occluder import Occluder
from ..transfer.settings import BOUNCES, VOLUME, VOLUME_DIRECTIONS, VOLUME_ERROR, Settings
from ..transfer.store import Cache
from ..transfer.volume import Foliage
from . import costs
from .choice import SUN_TOLERANCES, Choice, Leaves, best_of, curve_of
from .effect_errors import EffectErrors
from .plan import Plan
from .sample import Sample, ray_seconds

UNSHADOWED = ("analytic", "neural-gash", "blinn-phong")
"""Methods that trace nothing, and march through nothing."""

SAMPLE_VERTICES, SAMPLE_DIRECTIONS = 384, 2048
"""Whatever the tolerance. Of 72 plans on three generated scenes, for tolerances of .005 to .1, as many as with 4,096
directions kept to it, 67, in as much work."""


UNMEASURED_VERTICES = 5000
"""Of a scene, up to which everything costs less than a sample and what it would choose (`scripts/bench unmeasured`)."""

UNMEASURED: tuple[tuple[float, dict[str, Any]], ...] = (
    (0.016, {}),
    (0.0095, {"bands": 10, "rays": 256, "sun_tolerance": SUN_TOLERANCES[1], "bounce_rays": 128}),
)
"""Settings beyond those without a plan that are taken there, quickest first, and before them their largest error under
six lights on seven generated shapes (the same script)."""


@dataclass(frozen=True, eq=False)
class PlannedScene:
    """A scene as its planning sees it.

    occluder: of the whole scene. albedo: (V, 3) linear, white without. foliage: where it has one. traced: (V,) bool,
    the vertices that light is traced for; all without. cache: its Cache, or None.
    """

    occluder: Occluder
    albedo: Radiance | None = None
    foliage: Foliage | None = None
    traced: Mask | None = None
    cache: Cache | None = None


def unmeasured(scene: PlannedScene, options: LightingOptions, angles: int = 1) -> Plan | None:
    """The Plan without a sample where that would cost more than it saves, else None. Arguments as of `planned`."""
    start, vertices, budget_s = time.perf_counter(), len(scene.occluder.origins), options.budget_s
    given = options.bands, options.rays, options.fixed_effects, options.fixed_method, scene.foliage, scene.traced
    if any(each is not None for each in given) or vertices > UNMEASURED_VERTICES:
        return None
    ray_s, curve = ray_seconds(scene.occluder, np.arange(vertices), 1)[0], list[tuple[float, float, Settings]]()
    for error, finer in UNMEASURED:
        settings = options.unplanned._replace(volume=0, **finer)
        if scene.albedo is None:
            settings = settings._replace(bounce_rays=0, bounce_tolerance=0.0)
        once, each = costs.seconds(settings, vertices, vertices, ray_s, DEFAULT_LIMIT)
        curve.append((once + angles * each, error, settings))
    if budget_s is None:
        known = [row for row in curve if row[1] <= options.accepted_error]
    else:  # the finest that it pays for; a sample would not be cheaper
        known = [row for row in curve[::-1] if row[0] <= budget_s] or curve
    if not known:
        return None
    (seconds, error, settings), took = known[0], time.perf_counter() - start
    tolerance = None if budget_s else options.accepted_error
    return Plan(settings, error, seconds, DEFAULT_LIMIT, tolerance, budget_s, 0, 0, [], curve, took)


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
