"""Candidate settings for a light on a scene: the cost and error of each, and the best of them."""

import math
import time
from collections.abc import Callable, Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from splat2mesh.base.arrays import Floats, Mask

from ..light import sun_split
from ..light.environment import Environment
from ..light.suns import Suns
from ..options import LightingOptions
from ..transfer.settings import BOUNCE_TOLERANCE, BOUNCES, SHADOWS, SUN, VOLUME, Settings
from . import costs
from .costs import RAYS
from .effect_errors import EffectErrors

SAFETY = 0.75
"""A plan is laid for this part of the tolerance: what a sample measures is off by a tenth or more, and what is done
is checked against the tolerance itself."""

SKIPPED = 0.35
"""Part of the tolerance that skipped shadows, and skipped bounces, may use up: squares add."""

BANDS = (2, 3, 4, 5, 6, 8, 10)

SUN_TOLERANCES = tuple(0.001 * 4.0**power for power in range(4))
"""What suns may be split to, whatever the tolerance, so that a looser one has every choice of a tighter one. What a
split leaves is estimated for walls that stand anywhere. Where edges of sunlight or bright sky beside the sun take much
of the tolerance, the finest is cheaper than the rays that would make up for them."""

SUN_WIDTH = 0.8
"""Assumed error of patches that shine as points, over the split's tolerance: 0.2 to 1.5 were measured."""

BUDGET_TOLERANCE = 0.005
"""For what follows a tolerance, where a time is given and not an error."""

MAX_SPLITS = len(SUN_TOLERANCES)
"""How often suns are looked for while a plan is made, in a budget once: that takes longer than all the rest of it."""

STOP_PART = 0.1  # of the tolerance, for the bounces after the last


class Leaves(NamedTuple):
    """Of leaves and grass: directions from which light comes to them, 0 where they are surfaces; the error of their
    being surfaces; seconds; how many vertices; the error as done."""

    directions: int
    error: float
    seconds: float
    vertices: int
    lost: float


class Candidate(NamedTuple):
    """Settings, the seconds that they take, and how far off they are."""

    seconds: float
    error: float
    settings: Settings


def _quickest(candidate: Candidate) -> tuple[float, float]:
    return candidate.seconds, candidate.error


def _most_exact(candidate: Candidate) -> tuple[float, float]:
    return candidate.error, candidate.seconds


class Choice:
    """All settings worth considering for what was measured, and the seconds that each takes from now on: suns that a
    plan has found are not sought again. until: `time.perf_counter` at the end of a budget; None without."""

    def __init__(
        self,
        measured: EffectErrors,
        environment: Environment,
        options: LightingOptions,
        tolerance: float,
        angles: int,
        leaves: Leaves | None,
        there: Callable[[Settings], tuple[bool, bool]],
        until: float | None = None,
    ) -> None:
        self._leaves, self._there = leaves, there
        self._known_there: dict[Settings, tuple[bool, bool]] = {}
        self._known_levels: dict[tuple[int, float], int] = {}
        self.measured, self._environment, self._angles = measured, environment, angles
        self._method, self._effects = options.fixed_method, options.fixed_effects
        self._bands, self._rays, self._until = options.bands, options.rays, until
        self._tolerance = tolerance if until is None else BUDGET_TOLERANCE
        self._target = SAFETY * tolerance
        self._splits: dict[tuple[int, float], tuple[Any, Suns, float]] = {}
        self._sun_factor = self._width_factor = 1.0  # of suns, found over expected; measured over planned
        sample = measured.sample
        self._vertices, solid = int(sample.sizes.sum()), sample.weights[sample.solid > 0.0].sum() * sample.traced_share
        self._shadowed, self._unshadowed = self._shadows(SKIPPED * self._tolerance)
        self._shooting = int(sample.sizes[self._shadowed].sum() * solid)
        self._candidates = list(self._all())

    def best(self) -> Candidate:
        """The quickest candidate within the target, or the most exact within the budget.

        Suns are found for the chosen one alone. Where they turn out more, or the rest less smooth, it may lose; others
        are tried where they save more than finding their suns takes.
        """
        while True:
            best = self._chosen(self._candidates)
            if self._is_known(best.settings):
                return best
            if len(self._splits) == (MAX_SPLITS if self._until is None else 1):
                return self._chosen([each for each in self._candidates if self._is_known(each.settings)])
            self._split((best.settings.bands, best.settings.sun_tolerance))
            self._candidates = list(self._all())

    def _chosen(self, candidates: list[Candidate]) -> Candidate:
        if self._until is not None:
            left = self._until - time.perf_counter()
            good = [each for each in candidates if each.seconds <= left]
            return min(good, key=_most_exact) if good else min(candidates, key=_quickest)
        good = [each for each in candidates if each.error <= self._target]
        if good:
            return min(good, key=_quickest)
        least = min(each.error for each in candidates)
        return min((each for each in candidates if each.error <= sun_split.ENOUGH * least), key=_quickest)

    def _is_known(self, settings: Settings) -> bool:
        """Whether its suns, if it has any, were found."""
        return not settings.sun_tolerance or (settings.bands, settings.sun_tolerance) in self._splits

    def curve(self) -> list[tuple[float, float, Settings]]:
        """[(seconds, error, Settings)]: every candidate that no quicker one equals, from quick to exact."""
        found: list[Candidate] = []
        for each in sorted(self._candidates, key=_quickest):
            if not found or each.error < 0.97 * found[-1].error:
                found.append(each)
        return [(each.seconds, each.error, each.settings) for each in found]

    def sun_count(self, settings: Settings) -> int:
        """The number of suns under the settings: found, or expected."""
        split = self._splits.get((settings.bands, settings.sun_tolerance))
        if split is not None:
            return len(split[1])
        return round(self._sun_factor * costs.expected_suns(settings.sun_tolerance)) if settings.sun_tolerance else 0

    def checked(self, settings: Settings, transfer: Floats, tolerance: float) -> float:
        """The error of the settings with the noise that a transfer (S, K) of the sample's rows really has; beyond the
        tolerance, by a closer look."""
        traced = None if settings.shadowed is None else np.array(settings.shadowed)[self.measured.sample.chunk]

        def error() -> float:
            return math.hypot(self.but_noise(settings), self.measured.check(transfer, traced, **self.rest(settings)))

        found = error()
        return error() if found > tolerance and self.measured.look_closer() else found

    def contributions(self, settings: Settings) -> list[tuple[str, float | None, str]]:
        """[(effect, error without it, decision)] for the table and the report."""
        measured, rows = self.measured, list[tuple[str, float | None, str]]()
        every = float(np.linalg.norm(measured.shadows))
        if settings.shadowed is not None:
            traced = f"traced in {sum(settings.shadowed)} of {len(settings.shadowed)} chunks"
            decision = f"{traced}; the others lose {self._unshadowed:.2%}"
        else:
            decision = "traced" if settings.rays else "skipped"
        rows.append((SHADOWS, every, decision))
        if settings.rays:
            plain = measured.truncation(settings.bands)
            count = self.sun_count(settings)
            rows.append((SUN, plain, f"split into {count}" if settings.sun_tolerance else "skipped"))
            rows.append(("bands", self._truncation(settings), f"{settings.bands} kept"))
            rows.append(("rays", self._noise(settings), f"{settings.rays} traced"))
        else:
            plain, count = measured.open_truncation(settings.bands), self.sun_count(settings)
            rows.append((SUN, plain, f"split into {count}" if settings.sun_tolerance else "skipped"))
            left = measured.open_truncation(settings.bands, **self.rest(settings))
            rows.append(("bands", left, f"{settings.bands} kept"))
        if self._leaves is not None:
            leaves = (
                f"{settings.volume} directions for {self._leaves.vertices:,} vertices, {self._leaves.seconds:.2f} s"
            )
            rows.append((VOLUME, self._leaves.error, leaves if settings.volume else "skipped"))
        if measured.bounced is None:
            rows.append((BOUNCES, None, "skipped: the surface is white, or they were not requested"))
        else:
            decision = f"{settings.bounce_rays} rays" if settings.bounce_rays else "skipped"
            rows.append((BOUNCES, float(measured.bounces[0]), decision))
        return rows

    def _shadows(self, skip: float) -> tuple[Mask, float]:
        """Which chunks trace rays, (C,) bool, and the error of the others; all if none must and the method is to."""
        shadowed = np.ones(len(self.measured.shadows), bool)
        if self._effects is None and self._method in (None, "raytraced"):
            shadowed = ~self.measured.unshadowed(skip)
            if self._method is not None and not shadowed.any():
                shadowed[:] = True
        return shadowed, float(np.linalg.norm(self.measured.shadows[~shadowed]))

    def _all(self) -> Iterator[Candidate]:
        yield from map(self._rated, self._analytic())
        yield from map(self._rated, self._raytraced())

    def _raytraced(self) -> Iterator[Settings]:
        """Settings with rays, where shadows or leaves may be wanted."""
        if self._method == "analytic" or (self._effects is not None and SHADOWS not in self._effects):
            return
        leafy = 0 if self._leaves is None else self._leaves.directions
        if not self._shadowed.any() and not leafy:
            return
        shadowed = None if self._shadowed.all() else tuple(map(bool, self._shadowed))
        all_bands = BANDS if self._bands is None else (self._bands,)
        all_rays = RAYS if self._rays is None else (self._rays,)
        for bands, suns, bounce_rays, rays in product(all_bands, self._sun_choices(), self._bounce_choices(), all_rays):
            stop = max(BOUNCE_TOLERANCE, STOP_PART * self._tolerance) if bounce_rays else 0.0
            yield Settings("raytraced", bands, rays, shadowed, suns, bounce_rays, stop, leafy)

    def _analytic(self) -> Iterator[Settings]:
        """Settings without rays, where none are requested."""
        leafy = self._leaves is not None and self._leaves.directions  # there is no light through leaves without shadows
        if self._method in (None, "analytic") and not self._effects and not leafy:
            for bands in BANDS if self._bands is None else (self._bands,):
                yield Settings("analytic", bands)
                if self._method is None and self._effects is None and not self._shadowed.any():
                    # A convex scene has a sun but no shadows.
                    yield from (Settings("analytic", bands, sun_tolerance=each) for each in self._sun_choices() if each)

    def _sun_choices(self) -> list[float]:
        if self._effects is None:
            return [0.0, *SUN_TOLERANCES]
        return list(SUN_TOLERANCES) if SUN in self._effects else [0.0]

    def _bounce_choices(self) -> list[int]:
        if self.measured.bounced is None:
            return [0]
        if self._effects is not None:
            return list(costs.BOUNCE_RAYS)
        small = self.measured.bounces[0] <= SKIPPED * self._tolerance
        return [0] if small and self._until is None else [0, *costs.BOUNCE_RAYS]

    def _rated(self, settings: Settings) -> Candidate:
        """The candidate: what the settings cost and how far off they are."""
        error, sample, there = self.but_noise(settings), self.measured.sample, self._is_there(settings)
        if settings.rays:
            error = math.hypot(error, self._noise(settings))
        once, each = costs.seconds(
            settings,
            self._vertices,
            self._shooting,
            sample.ray_s,
            self.sun_count(settings),
            sample.traced_share,
            there,
            sample.unsure,
        )
        if settings.sun_tolerance and self._is_known(settings):
            once -= costs.SPLIT * sample.ray_s
        once += self._leaves.seconds if self._leaves and settings.volume and not there[0] else 0.0
        return Candidate(once + self._angles * each, error, settings)

    def _is_there(self, settings: Settings) -> tuple[bool, bool]:
        """Whether transfer and bounces of the settings are there already: whatever the suns, and when bounces stop."""
        settings = settings._replace(sun_tolerance=0.0, bounce_tolerance=0.0)
        if settings not in self._known_there:
            self._known_there[settings] = self._there(settings)
        return self._known_there[settings]

    def but_noise(self, settings: Settings) -> float:
        """Predicted error of the settings except for the noise of their rays."""
        measured = self.measured
        parts = [*self.of_bounces(settings), 0.0 if self._leaves is None else self._leaves.lost]
        if settings.rays:
            parts += [self._truncation(settings), self._sun_width(settings)]
            parts += [0.0 if settings.shadowed is None else self._unshadowed]
        else:
            open_truncation = measured.open_truncation(settings.bands, **self.rest(settings))
            parts += [float(np.linalg.norm(measured.shadows)), open_truncation, self._sun_width(settings)]
        return math.hypot(*parts)

    def of_bounces(self, settings: Settings) -> tuple[float, float]:
        """Predicted errors of bounced light: of its rays, and of the bounces after the last."""
        return costs.bounce_error(settings.bounce_rays, float(self.measured.bounces[0])), settings.bounce_tolerance

    def _sun_width(self, settings: Settings) -> float:
        """Error of patches of light that shine as points: as measured, or as planned for by what was measured."""
        tolerance, key = settings.sun_tolerance, (settings.bands, settings.sun_tolerance)
        if key in self._splits:
            return max(SUN_WIDTH * tolerance, self._splits[key][2])
        if self._width_factor > 1.0:  # few bands keep suns from being as fine as they should be
            tolerance = max(tolerance, self.measured.truncation(settings.bands, self._level(*key)))
        return SUN_WIDTH * self._width_factor * tolerance

    def _truncation(self, settings: Settings) -> float:
        return self.measured.truncation(settings.bands, **self.rest(settings))

    def _noise(self, settings: Settings) -> float:
        deviation = costs.noise(settings.rays, settings.bands)
        return self.measured.ray_noise(deviation, settings.bands, **self.rest(settings))

    def rest(self, settings: Settings) -> dict[str, Any]:
        """The rest of the light beside the suns: an image where they were found, else a level."""
        if not settings.sun_tolerance:
            return {}
        key = settings.bands, settings.sun_tolerance
        if key in self._splits:
            return {"image": self._splits[key][0]}
        return {"level": self._level(*key)}

    def _level(self, bands: int, sun_tolerance: float) -> int:
        """The highest of LEVELS at which the light is cut off smooth enough for so many bands, or the smoothest."""
        key = bands, sun_tolerance
        if key not in self._known_levels:
            errors = [self.measured.truncation(bands, level) for level in range(len(sun_split.LEVELS))]
            good = (level for level, error in enumerate(errors) if error <= 0.5 * sun_tolerance)
            self._known_levels[key] = next(good, int(np.argmin(errors)))
        return self._known_levels[key]

    def _split(self, key: tuple[int, float]) -> None:
        rest, found = sun_split.split(self._environment, *key)
        planned, measured = rest.width if isinstance(rest, sun_split.Rest) else 0.0, 0.0
        self._sun_factor = max(1, len(found)) / costs.expected_suns(key[1])
        if len(found) and isinstance(rest, sun_split.Rest):
            unrotated = found.rotated(-self._environment.rotation_deg)
            measured = self.measured.sun_width(unrotated, rest.variances)
            self._width_factor = max(self._width_factor, measured / max(SUN_WIDTH * key[1], planned))
        self._splits[key] = (rest.radiance if len(found) else None), found, max(planned, measured)
