"""Plans of small scenes without a sample: everything costs less than that and what it would choose."""

import time
from typing import Any

import numpy as np

from ..light.sun_split import DEFAULT_LIMIT
from ..options import LightingOptions
from ..transfer.settings import Settings
from . import costs
from .choice import SUN_TOLERANCES
from .plan import Plan
from .sample import PlannedScene, ray_seconds

UNMEASURED_VERTICES = 5000
"""Of a scene, up to which this holds (`scripts/bench unmeasured`)."""

UNMEASURED: tuple[tuple[float, dict[str, Any]], ...] = (
    (0.016, {}),
    (0.0095, {"bands": 10, "rays": 256, "sun_tolerance": SUN_TOLERANCES[1], "bounce_rays": 128}),
)
"""Settings beyond those without a plan that are taken there, quickest first, and before them their largest error under
six lights on seven generated shapes (the same script)."""


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
