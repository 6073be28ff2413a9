"""Candidate settings for a light on a scene: the cost and error of each, and the best of them.

What is measured of a scene and a light does not depend on the tolerance, and a looser one has every choice of a tighter
one. So its plan never takes more time.
"""

import math
import time
from collections.abc import Callable, Iterator
from functools import lru_cache
from itertools import product
from typing import NamedTuple

from splat2mesh.base.arrays import Floats, Radiance

from ..light import sun_split
from ..light.environment import Environment
from ..options import LightingOptions
from ..sh.harmonics import MAX_BANDS
from ..transfer import FEW_BANDS
from ..transfer.settings import BOUNCE_TOLERANCE, BOUNCES, SHADOWS, SUN, VOLUME, Settings
from . import costs
from .costs import RAYS
from .effect_errors import EffectErrors

SAFETY = 0.75
"""A plan is laid for this part of the tolerance: what a sample measures is off by a tenth or more, and what is done
is checked against the tolerance itself."""

BANDS = tuple(range(FEW_BANDS, MAX_BANDS + 1))
"""To choose from; images of a transfer hold three at least."""

SUN_TOLERANCES = tuple(BOUNCE_TOLERANCE * 2.0**power for power in range(0, 10, 2))
"""What suns are split to, whatever the tolerance. What a split leaves is estimated for walls that stand anywhere. Where
edges of sunlight or bright sky beside the sun take much of the tolerance, the finest is cheaper than the rays that
would make up for them."""


class Leaves(NamedTuple):
    """Of leaves and grass: directions from which light comes to them, 0 where they are surfaces; the error of their
    being surfaces; seconds; how many vertices; the error as done."""

    directions: int
    error: float
    seconds: float
    vertices: int
    lost: float


class SunSplit(NamedTuple):
    """Suns of a tolerance: the rest of the light, an image (H, W, 3); how many; the error of their being points."""

    rest: Radiance | None
    suns: int
    width: float


class Candidate(NamedTuple):
    """Settings, the seconds that they take, and how far off they are."""

    seconds: float
    error: float
    settings: Settings


def _quickest(candidate: Candidate) -> tuple[float, float]:
    return candidate.seconds, candidate.error


def _most_exact(candidate: Candidate) -> tuple[float, float]:
    return candidate.error, candidate.seconds


def best_of(candidates: list[Candidate], tolerance: float, until: float | None = None) -> Candidate:
    """The quickest candidate within a tolerance or, where none is, about as exact as can be; the most exact one within
    a budget that ends at `until`, of `time.perf_counter`."""
    if until is not None:
        left = until - time.perf_counter()
        good = [each for each in candidates if each.seconds <= left]
        return min(good, key=_most_exact) if good else min(candidates, key=_quickest)
    target = max(SAFETY * tolerance, sun_split.ENOUGH * min(each.error for each in candidates))
    return min((each for each in candidates if each.error <= target), key=_quickest)


def curve_of(candidates: list[Candidate]) -> list[tuple[float, float, Settings]]:
    """[(seconds, error, Settings)]: every candidate that no quicker one equals, from quick to exact."""
    found: list[Candidate] = []
    for each in sorted(candidates, key=_quickest):
        if not found or each.error < 0.97 * found[-1].error:
            found.append(each)
    return [(each.seconds, each.error, each.settings) for each in found]


class Choice:
    """All settings worth considering for what was measured, and the seconds that each takes from now on: suns are
    found. until: `time.perf_counter` at the end of a budget; None without."""

    def __init__(
        self,
        measured: EffectErrors,
        environment: Environment,
        options: LightingOptions,
        angles: int,
        leaves: Leaves | None,
        there: Callable[[Settings], tuple[bool, bool]],
        until: float | None = None,
    ) -> None:
        self._leaves, self._there = leaves, lru_cache(None)(there)
        self.measured, self._angles = measured, angles
        self._method, self._effects = options.fixed_method, options.fixed_effects
        self._bands, self._rays, self._until = options.bands, options.rays, until
        self._splits = {0.0: SunSplit(None, 0, 0.0)}
        if self._effects is None or SUN in self._effects:
            self._find_suns(environment, options.budget_s)
        sample = measured.sample
        self._vertices, self._solid = len(sample.occluder.origins), sample.weights[sample.solid > 0.0].sum()
        self.candidates = list(self._all())

    def sun_count(self, settings: Settings) -> int:
        """The number of suns under the settings."""
        return self._splits[settings.sun_tolerance].suns

    def checked(self, settings: Settings, transfer: Floats, tolerance: float) -> float:
        """The error of the settings with the noise that a transfer (S, K) of the sample's rows really has; beyond the
        tolerance, by a closer look."""

        def error() -> float:
            return math.hypot(self.but_noise(settings), self.measured.check(transfer, self._rest(settings)))

        found = error()
        return error() if found > tolerance and self.measured.look_closer() else found

    def contributions(self, settings: Settings) -> list[tuple[str, float | None, str]]:
        """[(effect, error without it, decision)] for the table and the report."""
        measured, count = self.measured, self.sun_count(settings)
        rows: list[tuple[str, float | None, str]] = [
            (SHADOWS, measured.shadows, "traced" if settings.rays else "skipped"),
            (SUN, self._lost(settings, None), f"split into {count}" if settings.sun_tolerance else "skipped"),
            ("bands", self._lost(settings, self._rest(settings)), f"{settings.bands} kept"),
        ]
        if settings.rays:
            rows.append(("rays", self._noise(settings), f"{settings.rays} traced"))
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

    def _all(self) -> Iterator[Candidate]:
        yield from map(self._rated, self._analytic())
        yield from map(self._rated, self._raytraced())

    def _raytraced(self) -> Iterator[Settings]:
        """Settings with rays, where shadows or leaves may be wanted."""
        if self._method == "analytic" or (self._effects is not None and SHADOWS not in self._effects):
            return
        leafy = 0 if self._leaves is None else self._leaves.directions
        all_bands = BANDS if self._bands is None else (self._bands,)
        all_rays = RAYS if self._rays is None else (self._rays,)
        for bands, suns, bounce_rays, rays in product(all_bands, self._sun_choices(), self._bounce_choices(), all_rays):
            stop = BOUNCE_TOLERANCE if bounce_rays else 0.0
            yield Settings("raytraced", bands, rays, suns, bounce_rays, stop, leafy)

    def _analytic(self) -> Iterator[Settings]:
        """Settings without rays, where none are requested."""
        leafy = self._leaves is not None and self._leaves.directions  # there is no light through leaves without shadows
        if self._method in (None, "analytic") and not self._effects and not leafy:
            for bands in BANDS if self._bands is None else (self._bands,):
                yield Settings("analytic", bands)
                if self._method is None and self._effects is None:
                    # A convex scene has a sun but no shadows.
                    yield from (Settings("analytic", bands, sun_tolerance=each) for each in self._sun_choices() if each)

    def _sun_choices(self) -> list[float]:
        found = list(self._splits)
        return found if self._effects is None else found[1:] or found

    def _bounce_choices(self) -> list[int]:
        if self.measured.bounced is None:
            return [0]
        if self._effects is not None:
            return list(costs.BOUNCE_RAYS)
        return [0, *costs.BOUNCE_RAYS]

    def _rated(self, settings: Settings) -> Candidate:
        """The candidate: what the settings cost and how far off they are."""
        error, sample, there = self.but_noise(settings), self.measured.sample, self._is_there(settings)
        if settings.rays:
            error = math.hypot(error, self._noise(settings))
        once, each = costs.seconds(
            settings,
            self._vertices,
            int(self._vertices * self._solid * sample.traced_share),
            sample.ray_s,
            self.sun_count(settings),
            sample.traced_share,
            there,
            sample.unsure,
        )
        once += self._leaves.seconds if self._leaves and settings.volume and not there[0] else 0.0
        return Candidate(once + self._angles * each, error, settings)

    def _is_there(self, settings: Settings) -> tuple[bool, bool]:
        """Whether transfer and bounces of the settings are there already: whatever the suns, and when bounces stop."""
        return self._there(settings._replace(sun_tolerance=0.0, bounce_tolerance=0.0))

    def but_noise(self, settings: Settings) -> float:
        """Predicted error of the settings except for the noise of their rays."""
        parts = [*self.of_bounces(settings), 0.0 if self._leaves is None else self._leaves.lost]
        parts += [] if settings.rays else [self.measured.shadows]
        parts += [self._lost(settings, self._rest(settings)), self._splits[settings.sun_tolerance].width]
        return math.hypot(*parts)

    def of_bounces(self, settings: Settings) -> tuple[float, float]:
        """Predicted errors of bounced light: of its rays, and of the bounces after the last."""
        return costs.bounce_error(settings.bounce_rays, float(self.measured.bounces[0])), settings.bounce_tolerance

    def _lost(self, settings: Settings, rest: Radiance | None) -> float:
        """What the bands lose of a light beside the suns, or of all light, in their shadows or without any."""
        of = self.measured.truncation if settings.rays else self.measured.open_truncation
        return of(settings.bands, rest)

    def _noise(self, settings: Settings) -> float:
        deviation = costs.noise(settings.rays, settings.bands)
        return self.measured.ray_noise(deviation, settings.bands, self._rest(settings))

    def _rest(self, settings: Settings) -> Radiance | None:
        """The image of the light beside the suns; None for all light."""
        return self._splits[settings.sun_tolerance].rest

    def _find_suns(self, environment: Environment, budget_s: float | None) -> None:
        """Find suns of every tolerance, coarse ones first: finer ones than can be reached are the same again. In a
        budget none are sought after half of it."""
        late = math.inf if self._until is None or budget_s is None else self._until - budget_s / 2.0
        for tolerance in reversed(SUN_TOLERANCES):
            rest, suns = sun_split.split(environment, tolerance=tolerance)
            if isinstance(rest, sun_split.Rest):
                width = self.measured.sun_width(suns.rotated(-environment.rotation_deg), rest.variances)
                self._splits[tolerance] = SunSplit(rest.radiance, len(suns), max(rest.width, width))
                if rest.error > tolerance or time.perf_counter() > late:
                    return
