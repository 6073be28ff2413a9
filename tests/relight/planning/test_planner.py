"""Checks after the work: when rays are doubled, and when that is left be. The plan and its errors are given here."""

import math

import numpy as np
import pytest

from relight.options import LightingOptions
from relight.planning.plan import Plan
from relight.planning.planner import MOST_DOUBLINGS, UNMENDED, Planner
from relight.transfer.settings import Settings
from relight.transfer.store import Cache
from splat2mesh.base.progress import Stages

TOLERANCE = 0.01


class Known:
    """Of a Precomputed: transfers of no meaning, and which rays they were asked for with."""

    seed, foliage, cache = 0, None, Cache()

    def __init__(self):
        self.asked = []

    def transfer(self, settings):
        self.asked.append(settings.rays)
        return np.zeros((4, settings.bands**2), np.float32), settings


class Errors:
    """Of a Choice: the rest is fixed, and noise falls as the root of the rays: `noise` with one ray."""

    def __init__(self, rest, noise):
        self._rest, self._noise = rest, noise

    def but_noise(self, settings):
        return self._rest

    def checked(self, settings, rows, tolerance):
        assert rows.shape == (2, settings.bands**2)
        return math.hypot(self._rest, self._noise / settings.rays**0.5)

    def contributions(self, settings):
        return [("rays", 0.0, f"{settings.rays} traced")]


def after_check(rest, noise, rays=16, budget_s=None, given_rays=None):
    """(Plan, rays asked for) of a plan of 3 bands once it was checked."""
    known = Known()
    planner = Planner(known, LightingOptions(tolerance=TOLERANCE, rays=given_rays), Stages())
    settings = Settings("raytraced" if rays else "analytic", 3, rays)
    plan = Plan(settings, 0.005, 1.0, 0, TOLERANCE, budget_s, 2, 1, [], [], 0.0)
    plan.choice, plan.rows = Errors(rest, noise), np.array([0, 3])
    planner._check(plan)
    return plan, known.asked


@pytest.mark.parametrize("doublings", range(MOST_DOUBLINGS + 1))
def test_rays_are_doubled_until_their_noise_is_within_the_tolerance(doublings):
    # The noise of 16 rays, times 2**(-1/2) for each doubling, is just below the tolerance after so many.
    plan, asked = after_check(0.0, 0.99 * TOLERANCE * 4.0 * 2.0 ** (doublings / 2))
    assert asked == [16 * 2**count for count in range(doublings + 1)]
    assert plan.settings.rays == asked[-1] and plan.checked == pytest.approx(0.99 * TOLERANCE)
    assert plan.contributions == ([("rays", 0.0, f"{asked[-1]} traced")] if doublings else [])


def test_doubling_ends():
    plan, asked = after_check(0.0, 1.0)
    assert len(asked) == MOST_DOUBLINGS + 1 and plan.checked == pytest.approx(1.0 / asked[-1] ** 0.5)


@pytest.mark.parametrize(
    "rest,noise,times",
    [
        (1.01 * UNMENDED * TOLERANCE, 0.8 * TOLERANCE, 1),  # noise of less than the rest, which rays do not mend
        (
            0.99 * UNMENDED * TOLERANCE,
            0.8 * TOLERANCE,
            3,
        ),  # as noisy, with more room: half the noise fits
        (1.01 * UNMENDED * TOLERANCE, 1.1 * TOLERANCE, 2),  # noise of more than the rest: it is doubled once
    ],
)
def test_what_rays_cannot_mend_ends_their_doubling(rest, noise, times):
    assert math.hypot(rest, noise) > TOLERANCE
    assert len(after_check(rest, 4.0 * noise)[1]) == times


@pytest.mark.parametrize("given", [{"given_rays": 16}, {"budget_s": 1.0}])
def test_rays_that_are_given_and_budgets_are_not_exceeded(given):
    plan, asked = after_check(0.0, 1.0, **given)
    assert asked == [16] and plan.checked == pytest.approx(0.25)


def test_without_rays_the_prediction_is_the_check():
    plan, asked = after_check(0.5, 0.5, rays=0)
    assert asked == [] and plan.checked == plan.error
