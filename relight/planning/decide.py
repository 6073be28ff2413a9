"""From a sample of the scene to a plan: the cheapest settings within an error, or the best within a time."""

import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from splat2mesh.base.arrays import Integers, Mask, Radiance

from ..light.environment import Environment
from ..options import DEFAULT_TOLERANCE, LightingOptions
from ..transfer import volume
from ..transfer.occluder import Occluder
from ..transfer.settings import BOUNCES, VOLUME, Settings
from ..transfer.store import Cache
from .choice import BUDGET_TOLERANCE, SKIPPED, Choice, Leaves
from .effect_errors import EffectErrors
from .plan import Plan
from .sample import Sample

VOLUME_PART = 0.35
"""Share of the tolerance for the number of directions on leaves and grass."""

UNSHADOWED = ("analytic", "neural-gash", "blinn-phong")
"""Methods that trace nothing, and march through nothing."""

SAMPLE_VERTICES = 384
SAMPLE_DIRECTIONS, FEWEST, MOST = 28.6, 1024, 8192
"""Directions of the sample times the tolerance, rounded up to a power of two: their own noise stays below a third of
it; and the range that they keep to."""


@dataclass(frozen=True, eq=False)
class PlannedScene:
    """A scene as its planning sees it.

    occluder: of the whole scene. sizes: (C,) vertices of each chunk. albedo: (V, 3) linear, white without. foliage:
    where it has one. traced: (V,) bool, the vertices that light is traced for; all without. cache: its Cache, or None.
    """

    occluder: Occluder
    sizes: Sequence[int] | Integers
    albedo: Radiance | None = None
    foliage: volume.Foliage | None = None
    traced: Mask | None = None
    cache: Cache | None = None


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
    wish = tolerance if budget_s is None else BUDGET_TOLERANCE
    directions = 2 ** math.ceil(math.log2(min(max(SAMPLE_DIRECTIONS / wish, FEWEST), MOST)))
    sample = Sample(scene.occluder, scene.sizes, SAMPLE_VERTICES, directions, scene.traced, scene.cache)
    albedo, foliage = scene.albedo, scene.foliage
    if albedo is None and effects is not None and BOUNCES in effects:
        albedo = np.ones((int(np.sum(scene.sizes)), 3), np.float32)
    bouncing = albedo is not None and (effects is None or BOUNCES in effects)
    leaves = None
    if foliage is not None and options.fixed_method not in UNSHADOWED:
        thickened, direction_s = sample.thickened(foliage)
        measured = EffectErrors(thickened, environment, albedo, bouncing)
        error = measured.changed(sample.seen)
        leaves = leaves_for(error, measured.leafy, wish, effects, direction_s, len(foliage.rows))
    if leaves is None or not leaves.directions:
        measured = EffectErrors(sample, environment, albedo, bouncing)
    if budget_s is not None:  # what planning took is part of it; of one that is used up the least number is left
        left_s = budget_s - (time.perf_counter() - start)
        options = replace(options, budget_s=max(left_s, sys.float_info.min))
    choice = Choice(measured, environment, options, tolerance, angles, leaves, there)
    best = choice.best()
    return Plan(
        settings=best.settings,
        error=best.error,
        seconds=best.seconds - choice.found_s(best.settings),
        sun_count=choice.sun_count(best.settings),
        tolerance=None if budget_s else tolerance,
        budget_s=budget_s,
        vertices=len(sample.rows),
        rays=sample.rays,
        contributions=choice.contributions(best.settings),
        curve=choice.curve(),
        planning_s=time.perf_counter() - start,
        choice=choice,
        rows=sample.rows,
    )


def leaves_for(
    error: float, leafy: float, wish: float, effects: frozenset[str] | None, direction_s: float, vertices: int
) -> Leaves:
    """How leaves and grass are lit: as volumes if surfaces cost too much, or on request.

    error: of their being surfaces, relative to all light. leafy: their light over all. wish: the tolerance. effects:
    the effects that were requested; None if unspecified. direction_s: seconds for each direction from which light comes
    to them. vertices: how many of the scene they are. Returns Leaves with the fewest directions whose noise is within
    its part of the tolerance, or with the most there are.
    """
    if not (error > SKIPPED * wish if effects is None else VOLUME in effects):
        return Leaves(0, error, 0.0, vertices, error)
    good = [count for count in volume.DIRECTIONS if volume.noise(count) * leafy <= VOLUME_PART * wish]
    count = min(good, default=max(volume.DIRECTIONS))
    return Leaves(count, error, count * direction_s, vertices, volume.noise(count) * leafy)
